"""Gazebo's recorded runs with friction and limits: every difference explained by writing down what Gazebo does.

Gazebo 11 with ODE steps a free body on a hinge in maximal coordinates: velocities by semi-implicit Euler, the hinge as a
velocity constraint with an error reduction of 0.2, dry friction as a bounded torque that stops the joint, damping explicit,
rotations by quaternions (an angle of 2 atan(omega h / 2) a step). Its joint's torque is zeroed while the speed is above the
velocity limit and clipped at the effort limit. Written down in :func:`ode_hinge` this gives the recorded numbers back to
rounding; with a finer step it shows what the same model tends to.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator

import numpy as np

from asrsim.actuators import ACTUATORS
from asrsim.samples import Array
from asrsim.simulation.run import Run
from validation.check import DATA, Check
from validation.independent import CASES, GAZEBO_GRAVITY, equilibrium, positions, preset_of, rms, simulate_case

MASS, REACH, INERTIA, DAMPING, FRICTION = 0.2, 0.04, 1e-6, 0.065, 0.025
"""kg, m, kg m^2 about the centre of mass, N m s/rad, N m: the recorded runs' URDF."""
EFFORT, SPEED = 300.0, 100.0
"""N m, rad/s: limits in the runs that have them."""
KINDS = {"": (FRICTION, EFFORT, SPEED), "_nofric": (0.0, EFFORT, SPEED), "_ideal": (0.0, math.inf, math.inf)}
"""Runs by suffix: friction, effort limit, velocity limit."""


def ode_hinge(
    law: Callable[[float], float], *, step: float, duration: float, friction: float, effort: float, speed: float
) -> Array:
    """Positions (n,) in rad of the pendulum as Gazebo steps it; law: torque in N m at a position in rad."""
    turn, rate = 0.0, 0.0
    x, z, along, up = 0.0, -REACH, 0.0, 0.0
    found = np.empty(round(duration / step))
    for k in range(len(found)):
        found[k] = turn
        torque = law(turn)
        if abs(rate) > speed and torque * rate > 0.0:
            torque = 0.0
        torque = min(max(torque, -effort), effort) - DAMPING * rate
        lever = REACH * math.sin(turn), REACH * math.cos(turn)
        error = 0.2 / step * (x + lever[0]), 0.2 / step * (z + lever[1])
        fall = up - step * GAZEBO_GRAVITY
        after = on_hinge(along, fall, rate + step * torque / INERTIA, lever, error)
        if friction:
            answer = on_hinge(along, fall, rate + step * (torque + 1.0) / INERTIA, lever, error)[2] - after[2]
            held = min(max(-after[2] / answer, -friction), friction)
            after = on_hinge(along, fall, rate + step * (torque + held) / INERTIA, lever, error)
        along, up, rate = after
        x, z, turn = x + step * along, z + step * up, turn + 2.0 * math.atan(0.5 * rate * step)
    return found


def on_hinge(
    along: float, up: float, rate: float, lever: tuple[float, float], error: tuple[float, float]
) -> tuple[float, float, float]:
    """Velocities (m/s, m/s, rad/s) of the body with the hinge's impulse, from those that it would have without.

    lever: m from the centre of mass to the hinge's point of the body; error: m/s at which that point is to come back.
    """
    a = 1.0 / MASS + lever[1] ** 2 / INERTIA
    b = -lever[1] * lever[0] / INERTIA
    c = 1.0 / MASS + lever[0] ** 2 / INERTIA
    gap_x = -error[0] - (along + lever[1] * rate)
    gap_z = -error[1] - (up - lever[0] * rate)
    push_x = (c * gap_x - b * gap_z) / (a * c - b * b)
    push_z = (a * gap_z - b * gap_x) / (a * c - b * b)
    return along + push_x / MASS, up + push_z / MASS, rate + (lever[1] * push_x - lever[0] * push_z) / INERTIA


def spring_law(result: Run, case: str) -> Callable[[float], float]:
    """Torque of the case's ideal motors on the link, by position."""
    block = result.robot.actuators[0]
    law, values = ACTUATORS.get(block.actuator), block.values()
    elastic = tuple(values[parameter.name] for parameter in law.parameters)
    theta = law.motor_references(0.8, preset_of(case))
    return lambda q: sum(law.elastic_torques(q, *theta, elastic))


def recorded(case: str, kind: str) -> Array:
    """Positions (n,) in rad of Gazebo's run."""
    names = {run["run"]: run["columns"] for run in json.loads((DATA / "gazebo.json").read_text(encoding="utf-8"))["runs"]}
    name = f"dof1_m3_step_{case}{kind}"
    with np.load(DATA / "gazebo.npz") as runs:
        return np.asarray(runs[name][:, names[name].index("q")])


def reproduction() -> Iterator[Check]:
    """The written-down scheme gives Gazebo's numbers back: so nothing in them is unexplained."""
    for case in CASES:
        law = spring_law(simulate_case(case, duration=2e-3), case)
        # Where the spring is unstable rounding grows without bound: only the beginning can be compared.
        duration = 0.03 if case == "awas_s0.04" else 2.0
        worst = 0.0
        for kind, (friction, effort, speed) in KINDS.items():
            again = ode_hinge(law, step=1e-3, duration=duration, friction=friction, effort=effort, speed=speed)
            worst = max(worst, float(np.max(np.abs(again - recorded(case, kind)[: len(again)]))))
        yield Check(
            name=f"Gazebo's three runs by their scheme, {case}", figure=worst, bound=1e-10, unit="rad", source="gazebo.npz"
        )


def convergence() -> Iterator[Check]:
    """Gazebo's model with a fine step tends to ours: the velocity limit left out, which asrsim reports and does not enforce."""
    duration, fine = 0.25, 1e-5
    for case in CASES:
        for kind, (friction, effort, _) in KINDS.items():
            if kind == "_nofric":
                continue
            ours = simulate_case(case, kind, duration=duration)
            law = spring_law(ours, case)
            errors = []
            for step in (4.0 * fine, fine):
                path = ode_hinge(law, step=step, duration=duration, friction=friction, effort=effort, speed=math.inf)
                errors.append(path[:: round(1e-3 / step)])
            q = positions(ours)[: len(errors[0])]
            # First order: what is left at the finer step is a third of the difference.
            left = rms(errors[0] - errors[1]) / 3.0
            figure = rms(q - errors[1])
            label = "friction and effort limit" if kind == "" else "neither friction nor limits"
            yield Check(
                name=f"distance to Gazebo's model at 10 us, {label}, {case}",
                figure=figure, bound=2e-4 + 1.5 * left, unit="rad",
                source=f"step error left in it: {left:.1e}",
            )  # fmt: skip


def velocity_limit() -> Iterator[Check]:
    """What Gazebo's velocity limit does: it matters where the link is faster than 100 rad/s, and there only."""
    for case in ("sea_k200", "sea_k400", "bavs_p0.22", "qbmove_p0.6"):
        law = spring_law(simulate_case(case, duration=2e-3), case)
        paths = [
            ode_hinge(law, step=2e-5, duration=0.25, friction=FRICTION, effort=EFFORT, speed=speed)[::50]
            for speed in (SPEED, math.inf)
        ]
        effect = rms(paths[0] - paths[1])
        fast = case.startswith("sea")
        yield Check(
            name=f"effect of Gazebo's velocity limit over .25 s, {case}",
            figure=effect, bound=1e-3 if fast else 0.0, unit="rad", at_least=fast,
            source="torque zeroed above 100 rad/s" if fast else "never that fast",
        )  # fmt: skip


def toolbox_stepping() -> Iterator[Check]:
    """The released order of a step against Gazebo: all runs finish; what differs are coordinates, and it goes with the step."""
    stopped = 0
    for case, known in CASES.items():
        for kind, (friction, effort, speed) in KINDS.items():
            ours = simulate_case(case, kind, stepping="toolbox")
            stopped += ours.status != "complete"
            q, theirs = positions(ours), recorded(case, kind)
            if kind == "_ideal" and known is not None:
                count = min(len(q), len(theirs))
                off = float(np.max(np.abs(theirs[:count] - np.load(DATA / "ideal.npz")[case][:count, 1])))
                apart = float(np.max(np.abs(q[:count] - theirs[:count])))
                yield Check(
                    name=f"largest distance to Gazebo's run over Gazebo's own error, toolbox stepping, {case}",
                    figure=apart / off, bound=1.0, source=f"{apart:.1e} rad of {off:.1e}",
                )  # fmt: skip
            if not kind:
                step, duration = 2e-5, 0.25
                path = ode_hinge(
                    spring_law(ours, case), step=step, duration=duration, friction=friction, effort=effort, speed=speed
                )
                fine = positions(simulate_case(case, kind, stepping="toolbox", step=step, duration=duration))[: len(path)]
                yield Check(
                    name=f"distance to Gazebo's model at 20 us, toolbox stepping, {case}",
                    figure=float(np.max(np.abs(fine - path))), bound=1e-4, unit="rad", source="Gazebo resolves the springs",
                )  # fmt: skip
    yield Check(
        name=f"of {len(CASES) * len(KINDS)} recorded runs, toolbox stepping stops", figure=stopped, bound=0, source="Gazebo"
    )


def resting_places() -> Iterator[Check]:
    """With friction a link rests wherever spring and weight differ by less than it: both simulators' links do."""
    for case in CASES:
        if case == "awas_s0.04":
            continue
        ours = simulate_case(case, "")
        law = spring_law(ours, case)
        for who, end in (("asrsim", float(positions(ours)[-1])), ("Gazebo", float(recorded(case, "")[-1]))):
            excess = abs(law(end) - MASS * GAZEBO_GRAVITY * REACH * math.sin(end))
            place = f"{1e3 * (end - equilibrium(ours, case)):+.3g} mrad from the frictionless one"
            yield Check(
                name=f"resting place under friction, {case}, {who}: {place}", figure=excess / FRICTION, bound=1.0 + 1e-6,
                source="torque to hold, share of tau_f",
            )  # fmt: skip
