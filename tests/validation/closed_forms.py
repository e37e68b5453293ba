"""Checks against closed forms of mechanics: equilibria, frequencies, periods, friction, terminal velocity."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from asrsim.actuators import ACTUATORS
from asrsim.signals import Constant, PulseTrain, Step
from validation.check import Check
from validation.fitting import crossings, extremes, frequency, leapfrog_frequency, modal_frequencies
from validation.models import GRAVITY, LOAD, MOTOR_INERTIA, SETTINGS, Body, chain, column, run

INERTIA = LOAD.inertia + LOAD.mass * LOAD.reach**2
WEIGHT = LOAD.mass * GRAVITY * LOAD.reach
"""Gravity torque of the load in the horizontal position, N m."""
NO_FRICTION = {"motor_1_friction_torque": 0.0, "motor_2_friction_torque": 0.0}
STRIKER = Body(mass=1.0, reach=0.1, inertia=0.01)
"""Link that strikes a stop."""
INERTIA_OF_STRIKER = STRIKER.inertia + STRIKER.mass * STRIKER.reach**2
FREE_MOTOR = {"motor_1_friction_torque": 0.0, "motor_1_damping": 0.0, "motor_1_max_velocity": math.inf}


def elastic(actuator: str, parameters: Mapping[str, float]) -> tuple[float, ...]:
    """Parameters of the springs in the order of the law: those given, otherwise the defaults."""
    return tuple(parameters.get(parameter.name, parameter.default) for parameter in ACTUATORS.get(actuator).parameters)


def equilibrium(actuator: str, preset: float, parameters: Mapping[str, float]) -> float:
    """Position at which spring and weight balance while the motors stand at the references of 0.8 rad and the preset, rad."""
    from scipy.optimize import brentq

    law, values = ACTUATORS.get(actuator), elastic(actuator, parameters)
    theta = law.motor_references(0.8, preset)
    return float(
        brentq(lambda q: sum(law.elastic_torques(q, *theta, values)) - WEIGHT * math.sin(q), 0.0, 1.0, xtol=1e-16, rtol=1e-15)
    )


def static_equilibrium() -> Iterator[Check]:
    """Rest positions of the paper's eight settings: spring and weight balance there."""
    for name, (actuator, preset, parameters) in SETTINGS.items():
        result = run(
            chain(replace(LOAD, actuator=actuator, damping=0.065)),
            mode=3,
            references={"equilibrium_position": 0.8, "stiffness_preset": preset},
            parameters=parameters,
            duration=4.0,
        )
        error = abs(column(result, "link_position")[-1] - equilibrium(actuator, preset, parameters))
        yield Check(name=f"static equilibrium, {name}", figure=error, bound=1e-12, unit="rad", source="tau_el(q) = m g l sin q")


def motor_droop() -> Iterator[Check]:
    """Steady error of motors with a proportional controller in mode 6: tau / P under the spring torque tau of the motor."""
    for name in ("SEA 200", "AwAS-II .005", "BAVS .22", "qbMove .6"):
        actuator, preset, parameters = SETTINGS[name]
        law = ACTUATORS.get(actuator)
        result = run(
            chain(replace(LOAD, actuator=actuator, damping=0.065)),
            mode=6,
            duration=4.0,
            references={"equilibrium_position": 0.8, "stiffness_preset": preset},
            parameters=parameters | {k: v for k, v in NO_FRICTION.items() if k[6] <= str(law.motors)},
        )
        values = result.robot.actuators[0].values()
        references = law.motor_references(0.8, preset)
        worst = 0.0
        for i in range(1, law.motors + 1):
            droop = column(result, f"elastic_torque_{i}")[-1] / values[f"controller_{i}_proportional"]
            worst = max(worst, abs(column(result, f"motor_{i}_position")[-1] - (references[i - 1] - droop)))
        yield Check(name=f"droop of the motors, {name}", figure=worst, bound=1e-13, unit="rad", source="theta = r - tau_el / P")
        balance = column(result, "link_torque")[-1] - WEIGHT * math.sin(column(result, "link_position")[-1])
        yield Check(
            name=f"balance at the link, {name}", figure=abs(balance), bound=1e-12, unit="N m", source="tau_q = m g l sin q"
        )


def oscillation_frequency() -> Iterator[Check]:
    """Frequency of small free oscillations with one substep, compared with the theory of the scheme, asin(x) / x."""
    for name, (actuator, preset, parameters) in SETTINGS.items():
        step = 1e-4 if name == "AwAS-II .04" else 5e-4
        rest = equilibrium(actuator, preset, parameters)
        result = run(
            chain(replace(LOAD, actuator=actuator)),
            mode=3,
            duration=1.0,
            step=step,
            substeps=1,
            initial=[rest + 1e-5],
            references={"equilibrium_position": 0.8, "stiffness_preset": preset},
            parameters=parameters,
        )
        law = ACTUATORS.get(actuator)
        spring = law.stiffness(rest, *law.motor_references(0.8, preset), elastic(actuator, parameters))
        stiffness = spring + WEIGHT * math.cos(rest)
        expected = leapfrog_frequency(math.sqrt(stiffness / INERTIA), step)
        found = frequency(column(result, "link_position"), step)
        yield Check(
            name=f"frequency of small oscillations, {name}",
            figure=abs(found / expected - 1.0),
            bound=1e-7,
            source="sqrt(k / I) and asin(omega h / 2)",
        )


def two_mass_frequency() -> Iterator[Check]:
    """Frequency sqrt(k (1/J + 1/I)) at which motor and link oscillate against each other in mode 4 without losses."""
    step = 1e-3
    result = run(
        chain(replace(LOAD, actuator="sea", inertia=0.01)),
        mode=4,
        duration=2.0,
        step=step,
        substeps=1,
        motor_substeps=1,
        gravity=0.0,
        parameters={**FREE_MOTOR, "spring_stiffness": 200.0},
        references={"motor_1_torque": PulseTrain(high=0.2, width=0.01, period=10.0)},
    )
    omega = math.sqrt(200.0 * (1.0 / MOTOR_INERTIA + 1.0 / (0.01 + 0.2 * 0.04**2)))
    deflection = column(result, "motor_1_position") - column(result, "link_position")
    error = abs(frequency(deflection[50:], step) / leapfrog_frequency(omega, step) - 1.0)
    yield Check(
        name="frequency at which motor and link oscillate against each other",
        figure=error,
        bound=1e-10,
        source="sqrt(k (1/J + 1/I)) and asin(omega h / 2)",
    )


def modal() -> Iterator[Check]:
    """Frequencies of two joints with springs, compared with the eigenvalues of M^-1 K, without and with gravity."""
    step = 1e-3
    first = Body(actuator="sea", mass=0.5, reach=0.08, inertia=6e-4)
    robot = chain(first, Body(actuator="sea", mass=0.4, reach=0.07, inertia=5e-4))
    for gravity in (0.0, GRAVITY):
        result = run(
            robot, mode=3, duration=3.0, step=step, substeps=1, gravity=gravity, initial=[2e-6, -1e-6],
            references={"equilibrium_position": 0.0}, parameters={"spring_stiffness": 40.0},
        )  # fmt: skip
        inner, outer = 0.5 * 0.08**2 + 6e-4 + 0.4 * 0.1**2, 0.4 * 0.07**2 + 5e-4
        cross = 0.4 * 0.1 * 0.07
        mass = np.array([[inner + outer + 2.0 * cross, outer + cross], [outer + cross, outer]])
        second = gravity * 0.4 * 0.07
        weight = np.array([[gravity * (0.5 * 0.08 + 0.4 * 0.1) + second, second], [second, second]])
        squares = np.sort(np.real(np.linalg.eigvals(np.linalg.solve(mass, 40.0 * np.eye(2) + weight))))
        positions = np.column_stack([column(result, "link_position", j) for j in (0, 1)])
        found = modal_frequencies(positions, step, 2)
        errors = [abs(a / leapfrog_frequency(math.sqrt(b), step) - 1.0) for a, b in zip(found, squares, strict=True)]
        label = "under gravity" if gravity else "without gravity"
        yield Check(
            name=f"two modal frequencies, {label}",
            figure=max(errors),
            bound=1e-8,
            source="eigenvalues of M^-1 K and asin(omega h / 2)",
        )


def pendulum_period() -> Iterator[Check]:
    """Period of a free pendulum from 1 rad, compared with the complete elliptic integral."""
    from scipy.special import ellipk

    body = Body(mass=0.5, reach=0.2, inertia=1e-3)
    result = run(chain(body), duration=20.0, initial=[1.0])
    if result.samples is None:
        return
    through = crossings(result.samples.time, column(result, "link_position"))
    period = 2.0 * float(np.mean(np.diff(through)))
    inertia = body.inertia + body.mass * body.reach**2
    expected = 4.0 * math.sqrt(inertia / (body.mass * GRAVITY * body.reach)) * float(ellipk(math.sin(0.5) ** 2))
    yield Check(
        name="period of a pendulum at 1 rad",
        figure=abs(period / expected - 1.0),
        bound=3e-6,
        source="4 sqrt(I / m g l) K(sin 1/2)",
    )
    highest = extremes(column(result, "link_position"))
    yield Check(
        name="amplitude of a pendulum after 20 s",
        figure=abs(abs(highest[-1]) - 1.0),
        bound=1e-5,
        unit="rad",
        source="no losses",
    )


def coulomb_friction() -> Iterator[Check]:
    """Decay and slip of a joint with dry friction."""
    friction, stiffness, inertia = 0.02, 40.0, 2e-3
    body = Body(actuator="sea", mass=0.2, reach=0.04, inertia=inertia, friction=friction)
    total = inertia + body.mass * body.reach**2
    result = run(
        chain(body), mode=3, duration=1.0, gravity=0.0, step=1e-4, substeps=1, initial=[0.02],
        references={"equilibrium_position": 0.0}, parameters={"spring_stiffness": stiffness},
    )  # fmt: skip
    heights = np.concatenate([[0.02], np.abs(extremes(column(result, "link_position")))])
    turns = heights[: int(0.02 / (2.0 * friction / stiffness))]
    error = float(np.max(np.abs(np.diff(turns) + 2.0 * friction / stiffness)))
    yield Check(
        name="decay of a half swing under dry friction", figure=error, bound=1e-6, unit="rad", source="2 tau_f / k = 1 mrad"
    )
    torque = 0.05
    passive = replace(body, actuator=None)
    result = run(chain(passive), duration=1.0, gravity=0.0, external={"joint_1": Step(after=torque)})
    q = column(result, "link_position")
    expected = 0.5 * (torque - friction) / total
    error = abs(float(q[-1]) / expected - 1.0)
    yield Check(name="acceleration of a slipping joint", figure=error, bound=1e-9, source="(tau - tau_f) / I")


def terminal_velocity() -> Iterator[Check]:
    """Terminal velocity (tau - tau_f) / D of a motor with Dahl friction and damping in mode 4, with a slack spring."""
    for stepping in ("leapfrog", "euler", "toolbox"):
        result = run(
            chain(replace(LOAD, actuator="sea")),
            mode=4,
            duration=4.0,
            gravity=0.0,
            stepping=stepping,
            parameters={"spring_stiffness": 0.0, "motor_1_friction_torque": 0.1},
            references={"motor_1_torque": 1.2},
        )
        error = abs(column(result, "motor_1_velocity")[-1] - (1.2 - 0.1) / 0.2698)
        yield Check(
            name=f"terminal velocity of a motor, {stepping}",
            figure=error,
            bound=1e-12,
            unit="rad/s",
            source="(tau - tau_f) / D",
        )


def impacts() -> Iterator[Check]:
    """Logged velocity of a link that strikes its stop within a step and rests there, or is pushed back from this time on."""
    step, speed, start = 1e-3, 3.0, 20
    for name, push, source in (
        ("free", 0.0, "v before the impact, 0 after it"),
        ("pressed", 1.0, "v before the impact, 0 after it"),
        ("pushed back", -1.0, "v before the impact, tau / I (t - t_i) after it"),
    ):
        acceleration, worst = push / INERTIA_OF_STRIKER, 0.0
        for late in (0.1, 0.3, 0.45, 0.8):
            impact = (start + late) * step
            stop = speed * impact + 0.5 * acceleration * impact**2
            limits = f'<limit lower="-9" upper="{stop!r}" effort="99" velocity="99"/>'
            result = run(
                chain(replace(STRIKER, limits=limits)),
                gravity=0.0,
                duration=0.03,
                step=step,
                external={"joint_1": Constant(value=push)},
                initial_velocities={"joint_1": speed},
            )
            assert result.samples is not None
            time = result.samples.time
            after = min(acceleration, 0.0) * (time - impact)
            truth = np.where(time < impact, speed + acceleration * time, after)
            worst = max(worst, float(np.abs(column(result, "link_velocity") - truth).max()))
        # The time of the impact is taken from the mean speed of a step, which the torque changes.
        early = abs(acceleration) * step / (speed + acceleration * (start + 1) * step)
        yield Check(
            name=f"velocity in all samples next to an impact on a stop: a link that is {name}",
            figure=worst,
            bound=1e-9 + abs(acceleration) * early * step,
            unit="rad/s",
            source=source,
        )
