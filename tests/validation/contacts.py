"""Checks of contacts: a sliding box, a pushed box, bodies at rest."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from asrsim.samples import Array
from asrsim.scenario import Scenario
from asrsim.scenario.data import World, WorldObject
from asrsim.signals import Constant
from asrsim.simulation.run import Run, simulate
from validation.check import Check, engine
from validation.models import Body, chain, read

FRICTION = 0.23
"""Coulomb coefficient of the paper's box (section 4.2.3)."""
EDGE = 0.2
MASS = 2.0
WEIGHT = MASS * 9.81
STOPPING = {"bullet": {1e-3: 1e-4, 2e-4: 1e-5}, "mujoco": {1e-3: 3e-2, 2e-4: 1e-2}}
"""Bounds by engine and step in s. MuJoCo's contacts are softer, and a fast box hops."""


def box(x: float = 0.0, y: float = 0.0) -> WorldObject:
    """The box on the ground."""
    return WorldObject(
        name="box", shape="box", size=(EDGE, EDGE, EDGE), mass=MASS, friction=FRICTION, position=(x, y, 0.5 * EDGE)
    )


def slide(tilt: float, *, duration: float = 1.0) -> Run:
    """Run of a box on the ground far from the robot. tilt: sideways fraction of gravity."""
    robot = chain(Body())
    scenario = Scenario(
        name="slide",
        robot=robot.path,
        gravity=(9.81 * tilt, 0.0, -9.81),
        duration=duration,
        base_position=(10.0, 0.0, 5.0),
        engine=engine(),
        world=World(ground=True, objects=(box(),)),
    )
    return simulate(scenario, robot)


def box_positions(result: Run) -> Array:
    """Positions (n, 3) of the box, m."""
    if result.samples is None:
        raise ValueError("the run kept no samples")
    return result.samples.bodies["box"][:, :3]


def sliding() -> Iterator[Check]:
    """Acceleration (tilt - mu) g of a box above the slip threshold, and rest below it."""
    tilt = 0.4
    speed = np.diff(box_positions(slide(tilt))[:, 0]) / 1e-3
    expected = (tilt - FRICTION) * 9.81
    found = (speed[-1] - speed[499]) / (len(speed) - 500) / 1e-3
    yield Check(
        name="acceleration of a sliding box",
        figure=abs(found / expected - 1.0),
        bound={"bullet": 1e-4}.get(engine(), 3e-4),
        source="(tan - mu) g",
    )
    still = box_positions(slide(0.95 * FRICTION))
    yield Check(
        name="displacement of a box at .95 of the slip force",
        figure=abs(float(still[-1, 0] - still[100, 0])),
        bound=1e-5,
        unit="m",
        source="0, since the force is below mu m g",
    )


def pusher(reach: float = 1.0) -> Any:
    """Passive slide along x with a ball at its tip. reach: distance to its stop, m."""
    ball = '<collision><origin xyz="0 0 0"/><geometry><sphere radius="0.02"/></geometry></collision>'
    limits = f'<limit lower="-1" upper="{reach!r}" effort="1000" velocity="100"/>'
    return chain(Body(mass=1.0, reach=0.0, inertia=1e-3, axis="1 0 0", prismatic=True, limits=limits, collision=ball))


def push(force: Any, *, duration: float, reach: float = 1.0, **fields: Any) -> Run:
    """Run in which a ball pushes the box along x at half its height. force: signal in N; reach: stroke of the ball, m."""
    robot = pusher(reach)
    scenario = Scenario(
        name="push",
        robot=robot.path,
        duration=duration,
        base_position=(-0.5 * EDGE - 0.0201, 0.0, 0.5 * EDGE),
        external_torques={"joint_1": force},
        world=World(ground=True, objects=(box(),)),
        engine=engine(),
        **fields,
    )
    return simulate(scenario, robot)


def stopping() -> Iterator[Check]:
    """Stopping distance of a box that slides freely after a push."""
    for speed, reach in ((0.3, 0.05), (2.4, 0.5)):
        force = 0.5 * (MASS + 1.0) * speed**2 / reach + FRICTION * WEIGHT
        duration = round(2.0 * reach / speed + speed / (FRICTION * 9.81) + 0.3, 2)
        for step in (1e-3, 2e-4):
            result = push(Constant(value=force), duration=duration, reach=reach, step=step)
            if result.samples is None:
                return
            x = box_positions(result)[:, 0]
            pushed = np.linalg.norm(result.samples.contacts["box/robot"], axis=1) > 0.0
            free = int(np.flatnonzero(pushed)[-1]) + round(0.01 / step)
            found = (x[free + 1] - x[free]) / step
            distance = x[-1] - 0.5 * (x[free] + x[free + 1])
            error = abs(float(distance * 2.0 * FRICTION * 9.81 / found**2) - 1.0)
            yield Check(
                name=f"stopping distance of a box, {found:.2g} m/s, step {1e3 * step:g} ms",
                figure=error,
                bound=STOPPING.get(engine(), STOPPING["mujoco"])[step],
                source="v^2 / (2 mu g)",
            )


def resting() -> Iterator[Check]:
    """Contact forces and positions at rest of a box on a box on the ground."""
    robot = chain(Body())
    place = (0.02, 0.0, EDGE + 0.05)
    small = WorldObject(name="small", shape="box", size=(0.1, 0.1, 0.1), mass=1.0, friction=0.9, position=place)
    gravity = np.array([1.0, 0.5, -9.81])
    for label, objects in (("", (box(), small)), (", named in the other order", (small, box()))):
        scenario = Scenario(
            name="rest",
            robot=robot.path,
            duration=1.0,
            base_position=(10.0, 0.0, 5.0),
            engine=engine(),
            gravity=tuple(gravity.tolist()),
            world=World(ground=True, objects=objects),
        )
        samples = simulate(scenario, robot).samples
        if samples is None:
            return
        for pair, mass in (("box/ground", MASS + 1.0), ("small/box", 1.0), ("box/small", -1.0)):
            error = float(np.max(np.abs(samples.contacts[pair][-100:] + mass * gravity)))
            name = f"rest on a slope: force on {pair.replace('/', ' by ')}{label}"
            yield Check(
                name=name,
                figure=error,
                bound=1e-3,
                unit="N",
                source="weights of the boxes, normal to the slope and along the slope",
            )
        sunk = float(np.max(np.abs(samples.bodies["small"][-1, :3] - place)))
        yield Check(name=f"box on a box, way from where it was put{label}", figure=sunk, bound=1e-4, unit="m", source="0")


def landing() -> Iterator[Check]:
    """Contact force of a floating robot that falls onto a slope and lies there, held by friction."""
    gravity = np.array([1.0, 0.5, -9.81])
    shape = '<collision><origin xyz="0 0 0"/><geometry><box size="0.4 0.3 0.1"/></geometry></collision>'
    inertia = '<inertia ixx="0.03" iyy="0.05" izz="0.06" ixy="0" ixz="0" iyz="0"/>'
    part = '<inertial><origin xyz="{at}"/><mass value="{mass}"/>' + inertia + "</inertial>"
    robot = read(
        f'<robot name="body"><link name="body">{part.format(at="0.02 0 0", mass=3)}{shape}</link>'
        f'<link name="arm">{part.format(at="0 0 0.02", mass=0.5)}</link><joint name="j" type="revolute"><parent link="body"/>'
        '<child link="arm"/><axis xyz="0 1 0"/><limit lower="-0.1" upper="0.1" effort="9" velocity="9"/>'
        '<dynamics damping="0.5"/></joint></robot>'
    )
    scenario = Scenario(
        name="land",
        robot=robot.path,
        duration=2.0,
        fixed_base=False,
        base_position=(0.0, 0.0, 0.06),
        engine=engine(),
        gravity=tuple(gravity.tolist()),
        world=World(ground=True),
    )
    samples = simulate(scenario, robot).samples
    if samples is None:
        return
    error = float(np.max(np.abs(samples.contacts["robot/ground"][-100:] + 3.5 * gravity)))
    yield Check(name="force on a fallen robot by the ground", figure=error, bound=5e-2, unit="N", source="its weight")
    height = abs(float(samples.bodies["body"][-1, 2]) - 0.05)
    yield Check(name="height of a fallen robot", figure=height, bound=1e-4, unit="m", source="half its thickness")
