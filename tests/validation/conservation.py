"""Checks of conservation: energy and momentum without losses, and no gain of energy without input."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from asrsim.actuators import ACTUATORS
from asrsim.samples import Array
from asrsim.signals import PulseTrain, Signal
from asrsim.simulation.run import Run
from support.pinocchio_model import PinocchioModel
from validation.check import Check
from validation.fitting import orders
from validation.models import FRICTION_STIFFNESS, MOTOR_INERTIA, PROPORTIONAL, Body, chain, column, run

LOSSLESS = {"motor_1_friction_torque": 0.0, "motor_1_damping": 0.0, "motor_1_max_velocity": math.inf, "motor_1_max_torque": 1e3}
BODY = Body(mass=0.4, reach=0.05, inertia=2e-3)
INERTIA = BODY.inertia + BODY.mass * BODY.reach**2


def motors(actuator: str, values: Mapping[str, float]) -> dict[str, float]:
    """Parameters `values` for motor 1, and for motor 2 if the actuator has one."""
    both = dict(values)
    if ACTUATORS.get(actuator).motors == 2:
        both |= {name.replace("_1_", "_2_"): value for name, value in values.items()}
    return both


def free_energy(result: Run, *, gravity: float) -> Array:
    """Energy of link, motors and springs at whole steps of a run without losses, J."""
    law = ACTUATORS.get(result.robot.actuators[0].actuator)
    speed = column(result, "link_velocity")
    energy = 0.5 * INERTIA * speed**2 + column(result, "spring_energy")
    energy -= BODY.mass * gravity * BODY.reach * np.cos(column(result, "link_position"))
    for i in range(1, law.motors + 1):
        energy += 0.5 * MOTOR_INERTIA * column(result, f"motor_{i}_velocity") ** 2
    return np.asarray(energy)


KICK = PulseTrain(high=0.6, width=0.05, period=1e3)
"""Torque of the push at the start of a run, N m."""


def energy_and_momentum() -> Iterator[Check]:
    """Energy and momentum of link and motors after a push in mode 4 without losses: both are constant."""
    for actuator, parameters in (("sea", {"spring_stiffness": 200.0}), ("qbmove", {}), ("bavs", {}), ("awas_ii", {})):
        drifts = []
        for step in (1e-3, 5e-4):
            result = run(
                chain(replace(BODY, actuator=actuator)),
                mode=4,
                duration=2.0,
                step=step,
                substeps=1,
                motor_substeps=1,
                gravity=0.0,
                parameters=motors(actuator, LOSSLESS) | parameters,
                references={"motor_1_torque": KICK, **({"motor_2_torque": 0.02} if actuator == "awas_ii" else {})},
            )
            after = slice(round(0.06 / step), None)
            energy = free_energy(result, gravity=0.0)[after]
            drifts.append(float(np.ptp(energy) / np.mean(energy)))
        name = ACTUATORS.get(actuator).title
        yield Check(name=f"energy without losses, {name}", figure=drifts[0], bound=3e-4, source="constant; mode 4")
        yield Check(name=f"order of the energy error, {name}", figure=orders(drifts)[0], bound=1.9, at_least=True, source="2")
        momentum = INERTIA * column(result, "link_velocity")[after]
        for i in range(1, ACTUATORS.get(actuator).motors + 1):
            momentum = momentum + MOTOR_INERTIA * column(result, f"motor_{i}_velocity")[after]
        error = float(np.max(np.abs(momentum / 0.03 - 1.0)))
        yield Check(
            name=f"momentum without losses, {name}", figure=error, bound=1e-12, source="torque of the push times its duration"
        )


LINK = Body(mass=0.5, reach=0.08, inertia=6e-4, length=0.1)
"""Link of the free pendulums."""


def long_swings() -> Iterator[Check]:
    """Energy change of free pendulums with two and three links after 10 s."""
    for name, start, bound in (("double", [1.5, 0.5], 2e-3), ("triple", [1.5, 0.5, -1.0], 4e-2)):
        robot, changes = chain(*[LINK] * len(start)), []
        model, still = PinocchioModel(robot.text, [joint.name for joint in robot.moving_joints]), np.zeros(len(start))
        lifting = model.energy(np.append(math.pi, still[1:]), still) - model.energy(still, still)
        for step in (1e-3, 2.5e-4):
            samples = run(robot, initial=start, duration=10.0, step=step, substeps=1).samples
            if samples is not None:
                q, speed = samples.values["link_position"], samples.values["link_velocity"]
                changes.append(abs(model.energy(q[-1], speed[-1]) - model.energy(q[0], speed[0])) / lifting)
        yield Check(
            name=f"energy of a free pendulum after 10 s, {name}",
            figure=changes[0],
            bound=bound,
            source="constant; error relative to the energy that lifts the pendulum",
        )
        yield Check(
            name=f"order of the energy error of a free pendulum, {name}",
            figure=orders(changes, 4.0)[0],
            bound=1.5,
            at_least=True,
            source="2",
        )


PRESETS = {"sea": 0.0, "qbmove": 0.3, "bavs": 0.1, "awas_ii": 0.01}


def passivity() -> Iterator[Check]:
    """Gain of energy without input: none. The leapfrog's energy oscillates by up to (omega h)^2 / 4 below a constant."""
    for actuator in PRESETS:
        for mode in (3, 4, 6):
            share = max(energy_gain(actuator, mode, friction=loss, damping=loss) for loss in (0.0, 0.02))
            yield Check(
                name=f"gain of energy without input, {ACTUATORS.get(actuator).title}, mode {mode}",
                figure=share,
                bound=1.001,
                source="fraction of the oscillation (omega h)^2 / 4",
            )
    share = energy_gain("sea", 6, friction=0.0, damping=0.0, stepping="toolbox", derivative=0.0)
    yield Check(
        name="gain of energy, toolbox stepping, Series elastic actuator, mode 6, no derivative gain",
        figure=share,
        bound=10.0,
        at_least=True,
        source="this stepping is not passive: the check can fail",
    )


def energy_gain(
    actuator: str, mode: int, *, friction: float, damping: float, stepping: str = "leapfrog", derivative: float = 4.5
) -> float:
    """Largest rise of the energy above an earlier value, as a fraction of the oscillation that theory gives."""
    law = ACTUATORS.get(actuator)
    values = {"motor_1_friction_torque": friction, "motor_1_damping": damping, "motor_1_max_velocity": math.inf}
    if mode == 6:
        values["controller_1_derivative"] = derivative
    result = run(
        chain(replace(BODY, actuator=actuator, damping=damping)), mode=mode, duration=1.5, substeps=1, motor_substeps=1,
        gravity=0.0, initial=[0.2], parameters=motors(actuator, values) if mode > 3 else {}, references=_still(actuator, mode),
        stepping=stepping,
    )  # fmt: skip
    energy = 0.5 * INERTIA * column(result, "link_velocity") ** 2 + column(result, "spring_energy")
    stiffest = float(np.max(column(result, "stiffness")))
    fastest = stiffest / INERTIA
    for i in range(1, law.motors + 1 if mode > 3 else 0):
        energy = energy + 0.5 * MOTOR_INERTIA * column(result, f"motor_{i}_velocity") ** 2
        # Bristles and controllers act as springs.
        energy += column(result, f"friction_torque_{i}") ** 2 / (2.0 * FRICTION_STIFFNESS)
        spring = stiffest + (FRICTION_STIFFNESS if friction else 0.0)
        if mode == 6:
            goal = law.motor_references(0.0, PRESETS[actuator])[i - 1]
            energy += 0.5 * PROPORTIONAL * (goal - column(result, f"motor_{i}_position")) ** 2
            spring += PROPORTIONAL
        fastest = max(fastest, stiffest / INERTIA + spring / MOTOR_INERTIA)
    energy = (energy - _least(result, mode))[60:]
    swing = 1.0 / (1.0 - 0.25 * fastest * result.scenario.step**2) - 1.0
    lowest = np.minimum.accumulate(energy)
    # At rest, energies differ only by rounding errors.
    moving = lowest > 1e-6 * energy[0]
    return float(np.max(energy[moving] / lowest[moving] - 1.0)) / swing


def _still(actuator: str, mode: int) -> dict[str, Signal | float]:
    """Constant references. In mode 4, a push at the start moves the motors."""
    if mode == 4:
        return {"motor_1_torque": KICK, "motor_2_torque": 0.02 if ACTUATORS.get(actuator).adjuster else 0.0}
    return {"equilibrium_position": 0.0, "stiffness_preset": PRESETS[actuator]}


def _least(result: Run, mode: int) -> float:
    """Energy that the preset stores in springs and controllers at rest at q = 0, J."""
    from scipy.optimize import fsolve

    block = result.robot.actuators[0]
    law, values = ACTUATORS.get(block.actuator), block.values()
    elastic = tuple(values[parameter.name] for parameter in law.parameters)
    goals = law.motor_references(0.0, PRESETS[block.actuator])
    if mode == 4:
        return 0.0
    if mode == 3 or law.motors == 1:
        return law.elastic_energy(0.0, *goals, elastic)

    def excess(theta: Array) -> list[float]:
        torques = law.elastic_torques(0.0, float(theta[0]), float(theta[1]), elastic)
        return [PROPORTIONAL * (goal - angle) - torque for goal, angle, torque in zip(goals, theta, torques, strict=True)]

    theta = fsolve(excess, np.array(goals) * (1.0 - 1e-3), xtol=1e-13)
    held = sum(0.5 * PROPORTIONAL * (goal - angle) ** 2 for goal, angle in zip(goals, theta, strict=True))
    return law.elastic_energy(0.0, float(theta[0]), float(theta[1]), elastic) + float(held)
