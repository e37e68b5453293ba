"""Contacts and wrenches: a box that slides, a box that is pushed, a force on a link."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from asrsim.samples import Array
from asrsim.scenario import Scenario
from asrsim.scenario.data import World, WorldObject, Wrench
from asrsim.signals import Constant, Ramp, Sinusoid
from asrsim.simulation.run import Run, simulate
from validation.check import Check
from validation.models import Body, chain, column, run

FRICTION = 0.23
"""Coulomb coefficient of the paper's box (section 4.2.3)."""
EDGE = 0.2
MASS = 2.0
WEIGHT = MASS * 9.81


def box(x: float = 0.0, y: float = 0.0) -> WorldObject:
    """The box on the ground."""
    return WorldObject(
        name="box", shape="box", size=(EDGE, EDGE, EDGE), mass=MASS, friction=FRICTION, position=(x, y, 0.5 * EDGE)
    )


def slide(tilt: float, *, duration: float = 1.0) -> Run:
    """A box on the ground under gravity with a sideways share `tilt`; a robot far away."""
    robot = chain(Body())
    scenario = Scenario(
        name="slide", robot=robot.path, gravity=(9.81 * tilt, 0.0, -9.81), duration=duration, base_position=(10.0, 0.0, 5.0),
        world=World(ground=True, objects=(box(),)),
    )  # fmt: skip
    return simulate(scenario, robot)


def box_positions(result: Run) -> Array:
    """(n, 3) m."""
    if result.samples is None:
        raise ValueError("the run kept no samples")
    return result.samples.bodies["box"][:, :3]


def sliding() -> Iterator[Check]:
    """Above the threshold a box accelerates by (tilt - mu) g, below it stays."""
    tilt = 0.4
    speed = np.diff(box_positions(slide(tilt))[:, 0]) / 1e-3
    expected = (tilt - FRICTION) * 9.81
    found = (speed[-1] - speed[499]) / (len(speed) - 500) / 1e-3
    yield Check(name="acceleration of a sliding box", figure=abs(found / expected - 1.0), bound=1e-4, source="(tan - mu) g")
    still = box_positions(slide(0.95 * FRICTION))
    yield Check(
        name="movement of a box at .95 of the slip threshold", figure=abs(float(still[-1, 0] - still[100, 0])), bound=1e-5,
        unit="m", source="0 below mu m g",
    )  # fmt: skip


def pusher() -> Any:
    """A slide along x with a ball at its tip, passive."""
    ball = '<collision><origin xyz="0 0 0"/><geometry><sphere radius="0.02"/></geometry></collision>'
    return chain(Body(mass=1.0, reach=0.0, inertia=1e-3, axis="1 0 0", prismatic=True, limits=LIMITS, collision=ball))


LIMITS = '<limit lower="-1" upper="1" effort="1000" velocity="100"/>'


def push(force: Any, *, duration: float) -> Run:
    """A ball at the height of the box's middle pushes it along x with `force`, a signal in N."""
    robot = pusher()
    scenario = Scenario(
        name="push", robot=robot.path, duration=duration, base_position=(-0.5 * EDGE - 0.0201, 0.0, 0.5 * EDGE),
        external_torques={"joint_1": force}, world=World(ground=True, objects=(box(),)),
    )  # fmt: skip
    return simulate(scenario, robot)


def slip_threshold() -> Iterator[Check]:
    """A push that rises slowly: the box goes at mu times its load (the ball carries some of its weight by its own friction)."""
    result = push(Ramp(final=6.0, start=0.5, duration=6.0), duration=6.0)
    x = box_positions(result)[:, 0]
    if result.samples is None:
        return
    ground = result.samples.contacts["box/ground"]
    moved = int(np.argmax(x - x[400] > 1e-5))
    # From the threshold on box and ball accelerate with the push's excess: x = rate t^3 / (6 m), 1 N/s.
    late = (6.0 * (MASS + 1.0) * float(x[moved] - x[400])) ** (1.0 / 3.0)
    found = float(result.samples.time[moved]) - 0.5 - late
    error = abs(found / (FRICTION * float(ground[moved, 2])) - 1.0)
    yield Check(name="force at which a pushed box slips", figure=error, bound=3e-3, source="mu times the box's load")
    sliding = ground[moved + 100 :]
    error = float(np.max(np.abs(sliding[:, 0] / sliding[:, 2] / FRICTION - 1.0)))
    yield Check(name="friction of the pushed box while it slides", figure=error, bound=1e-3, source="mu times its load")


def link_wrench() -> Iterator[Check]:
    """A force at a point of a link is the torque of its lever about the joint, in either frame."""
    body = Body(mass=0.5, reach=0.08, inertia=6e-4, damping=0.02)
    wave = Sinusoid(amplitude=2.0, frequency=1.0)
    point = (0.0, 0.0, -0.1)
    across = Wrench(link="link_1", force=(wave, None, None), point=point, frame="link")
    pushed = run(chain(body), duration=1.0, wrenches=(across,))
    turned = run(chain(body), duration=1.0, external={"joint_1": Sinusoid(amplitude=-0.2, frequency=1.0)})
    error = float(np.max(np.abs(column(pushed, "link_position") - column(turned, "link_position"))))
    yield Check(
        name="force across a link against its torque", figure=error, bound=1e-12, unit="rad", source="lever times force"
    )
    down = Wrench(link="link_1", force=(None, None, Constant(value=-0.5 * 9.81)), point=(0.0, 0.0, -0.08))
    lifted = run(chain(body), duration=1.0, initial=[0.5], wrenches=(down,))
    heavier = run(chain(body), duration=1.0, initial=[0.5], gravity=2.0 * 9.81)
    error = float(np.max(np.abs(column(lifted, "link_position") - column(heavier, "link_position"))))
    yield Check(
        name="force down at the centre of mass against gravity", figure=error, bound=1e-12, unit="rad", source="m g twice"
    )
