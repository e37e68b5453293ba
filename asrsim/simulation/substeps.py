"""Number of substeps that a run needs, from the mass matrix and the largest stiffness that the springs can reach.

The coupled step is stable for omega h < 2 with omega = sqrt(lambda_max(M^-1 diag(stiffness))); the default substep h satisfies
omega h <= 0.2, for which the relative error of the frequency is at most (omega h)^2 / 24 = 0.17 %.
"""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from asrsim.errors import UnresolvedSpringError
from asrsim.registry.steppings import stepping_called
from asrsim.robot.couplings import Couplings, uncoupled
from asrsim.robot.dynamics import RobotModel
from asrsim.samples import Array
from asrsim.scenario.data import Scenario
from asrsim.scenario.load import MAX_STEPS
from asrsim.simulation.drives import EXTERNAL_TORQUE, SteppedJoint
from asrsim.simulation.inputs import sampled_signals
from asrsim.simulation.layout import EXTERNAL, GOALS
from asrsim.simulation.reach import reachable_stiffness

SAMPLES = 2000
"""Number of equal intervals of a run, at whose ends the references are sampled."""
CONFIGURATIONS = 8
"""Number of random joint positions, in addition to the initial positions, at which the mass matrix is computed."""

TARGET = 0.2
"""Largest omega h with the automatic number of substeps. The value is chosen for accuracy; above 2 the step is unstable."""
MOTOR_TARGET = 0.3
"""Largest omega h of motor and spring with a fixed link, with the automatic number of motor substeps."""
UNSTABLE = 2.0
"""Value of omega h above which a spring gains energy in every step."""
DAMPED = 1.0
"""Product of damping rate and h above which an explicit damper gains energy in every step."""
COARSE = 0.5
"""Value of omega h above which a spring is no longer resolved well."""
FADING = 0.1
"""Largest product of h and the rate of a torque that acts explicitly (friction that decreases with speed, dampers of stages)
with the automatic number of substeps.
"""
STEEPEST = math.sqrt(2.0 / math.e)
"""Largest magnitude of the slope of exp(-x^2)."""
FRICTIONS = ("friction_torque", "stribeck_friction", "load_friction")
"""Parameters of a motor that cause friction. If any of these parameters is above 0, the stiffness of the friction's bristles
limits the step.
"""
RINGING = 0.5
"""Largest allowed ratio of the amplitudes in successive steps, for a strongly damped motion that changes its sign in every
step.
"""
MOST_MOTOR_SUBSTEPS = 10_000
"""Largest number of motor substeps in a substep. The motor of a real drive needs about ten motor substeps."""


@dataclass(frozen=True, kw_only=True)
class Resolution:
    """Numbers of substeps, and the values from which these numbers follow."""

    substeps: int
    motor_substeps: int
    motor_frequency: float
    """Largest natural frequency of a motor with a fixed link, rad/s."""
    omega_h: float
    """Largest natural frequency of the links on their springs, multiplied by the substep."""
    stiffness: tuple[float, ...]
    """Largest reachable stiffness of each joint in N m/rad."""
    link_implicitness: float
    """Weight of the new velocity in the damping of the links: 1/2 is the midpoint rule; larger values damp fast modes."""


def resolution_of(
    scenario: Scenario, drives: Sequence[SteppedJoint], model: RobotModel | None, *, softer: float = 1.0
) -> Resolution:
    """Numbers of substeps for a run of these joints. Raises UnresolvedSpringError if the allowed number is not sufficient.
    softer: fraction of the largest reachable stiffness of the springs that the substeps need to resolve.
    """
    sampled = sampled_signals(scenario, drives, np.linspace(0.0, scenario.duration, SAMPLES + 1))
    for j, drive in enumerate(drives):
        ranges = scenario.ranges_of(drive.name)
        for column, name in enumerate((EXTERNAL_TORQUE, *drive.references)):
            if name in ranges:
                # Assume the largest changes, which are jumps of the reference between its smallest and its largest value.
                sampled[column, j, 1::4], sampled[column, j, 3::4] = ranges[name]
    # Without a model, the engine prescribes the motion of the links. Springs then need no substeps, so assume huge masses.
    masses, loads = 1e9 * np.eye(len(drives))[None], np.max(np.abs(sampled[EXTERNAL]), axis=1)
    couplings = uncoupled(len(drives)) if model is None else model.couplings
    places = couplings.expand(_configurations(drives))
    if model is not None:
        masses = model.mass_matrix(places)
        held = couplings.fold_sizes(loads, places) + np.abs(model.gravity_torques(places))
        loads = np.max(np.atleast_2d(held), axis=0)
    inertias = np.diagonal(masses, axis1=1, axis2=2).max(axis=0)
    # The spring of a follower moves the inertia of its master, divided by the squared ratio. Limit the ratio of a follower that
    # hardly moves.
    ratios = np.maximum(np.abs(np.atleast_2d(couplings.ratios(places))).max(axis=0), 1e-6)
    inertias, loads = inertias[couplings.master] / ratios**2, loads[couplings.master] / ratios
    reach = reachable_stiffness(drives, sampled[GOALS:].swapaxes(0, 1), loads, inertias, scenario.duration / SAMPLES)
    stiffness = [softer * (k + _bound(drive, "stiffness_bound")) for drive, k in zip(drives, reach, strict=True)]
    return _resolve(scenario, drives, couplings, places, masses, stiffness)


def _configurations(drives: Sequence[SteppedJoint]) -> list[list[float]]:
    """Joint positions for which the mass matrix is computed: the initial positions, and random positions within the limits."""
    # Use the random generator of the standard library, since importing numpy.random takes longer than a short run.
    generator = random.Random(0)
    pairs = [(max(low, -math.pi), min(high, math.pi)) for low, high in (drive.joint.stops for drive in drives)]
    initial = [drive.initial_position for drive in drives]
    return [initial, *([generator.uniform(low, max(low, high)) for low, high in pairs] for _ in range(CONFIGURATIONS))]


def _bound(drive: SteppedJoint, law: str) -> float:
    """Sum over all springs of the bounds of the joint's stages. law: name of the bound, such as `stiffness_bound`."""
    total = 0.0
    for stage in drive.stages:
        for i in range(1, drive.motors + 1):
            own = drive.stage_constants(stage, i)
            total += 0.0 if own is None else getattr(stage, law)(own)
    return total


def _resolve(
    scenario: Scenario,
    drives: Sequence[SteppedJoint],
    couplings: Couplings,
    places: Array,
    masses: Array,
    stiffness: Sequence[float],
) -> Resolution:
    """Numbers of substeps. places: the relevant joint positions (m, n); masses: mass matrices (m, n, n) at these positions;
    stiffness: stiffness of each joint in N m/rad.

    The released code has no substeps, and also runs springs that the step does not resolve.
    """
    stepping, step = stepping_called(scenario.stepping), scenario.step
    limited = [min(k, 1e12) if stepping.released else k for k in stiffness]
    for drive, k in zip(drives, limited, strict=True):
        if not math.isfinite(k):
            raise UnresolvedSpringError(
                f"the stiffness of joint '{drive.name}' is not finite at a deflection that its spring can reach: limit the "
                "deflection (max_deflection)"
            )
    gains = [
        drive.values["controller_1_proportional"] if drive.mode and drive.mode.number == 1 else k
        for drive, k in zip(drives, limited, strict=True)
    ]
    dampers = [_bound(drive, "damping_bound") for drive in drives]
    rate = _fastest(masses, couplings.fold_gains(dampers, places))[0]
    omega, shape = _fastest(masses, couplings.fold_gains(gains, places))
    group = couplings.master == int(np.argmax(np.abs(shape)))
    frequency, column = math.sqrt(omega), int(np.argmax(np.where(group, gains, -1.0)))
    stiffest = drives[column].name
    needed = _count(frequency * step / TARGET)
    substeps = 1 if stepping.released else scenario.substeps
    if substeps is None:
        if needed > scenario.max_substeps:
            raise UnresolvedSpringError(
                f"the spring of joint '{stiffest}' can reach {stiffness[column]:.4g} N m/rad: its frequency of "
                f"{frequency / math.tau:.4g} Hz cannot be resolved, since a step of {step:g} s would need {needed:.12g} "
                f"substeps and `max_substeps` is {scenario.max_substeps}. Lower the step, raise this limit, soften the spring, "
                "limit its deflection (max_deflection), or narrow the reference_ranges of a run whose references are set from "
                "outside"
            )
        # Friction that decreases with speed makes motions grow. This growth limits the step only for accuracy. The step cannot
        # become unstable, since the friction is bounded.
        mobilities = np.diagonal(np.linalg.inv(masses), axis1=1, axis2=2).max(axis=0)
        mobilities = (mobilities[couplings.master] * np.atleast_2d(couplings.ratios(places) ** 2).max(axis=0)).tolist()
        joints = [drive.joint for drive in drives]
        growths = (j.stribeck_friction / j.stribeck_velocity * m for j, m in zip(joints, mobilities, strict=True))
        fading = max(STEEPEST * max(growths), rate)
        substeps = int(max(needed, min(scenario.max_substeps, _count(fading * step / FADING))))
    h = step / substeps
    if rate * h >= DAMPED:
        raise UnresolvedSpringError(
            f"the dampers of the springs are unstable with {substeps} substeps of {h:g} s: damping * substep / inertia is "
            f"{rate * h:.3g}, the limit is {DAMPED:g}. Use at least {_count(rate * step / FADING):.12g} substeps (or leave the "
            "number automatic)"
        )
    if frequency * h >= UNSTABLE and not stepping.released:
        raise UnresolvedSpringError(
            f"the spring of joint '{stiffest}' is unstable with {substeps} substeps of {h:g} s: angular frequency times "
            f"substep is omega h = {frequency * h:.3g}, the limit is 2. Use at least {needed:.12g} substeps (or leave the "
            "number automatic)"
        )
    dampings = [link_damping(drive, k) for drive, k in zip(drives, limited, strict=True)]
    decay = h * _fastest(masses, couplings.fold_gains(dampings, places))[0]
    frequencies, motor_growths = zip(*map(_motor_rates, drives, limited), strict=True)
    rates = max(max(frequencies) / MOTOR_TARGET, max(motor_growths) / FADING)
    motor_substeps = 1 if stepping.released else scenario.motor_substeps or _count(rates * h)
    if motor_substeps > MOST_MOTOR_SUBSTEPS:
        fastest = max(range(len(drives)), key=lambda j: max(frequencies[j] / MOTOR_TARGET, motor_growths[j] / FADING))
        own, whose = drives[fastest].drive, f"the motors of joint '{drives[fastest].name}'"
        if own is not None:
            whose += f" (inertia {min(own.motor_inertia):.4g} kg m^2)"
        raise UnresolvedSpringError(
            f"{whose} cannot be resolved: they would need {motor_substeps:.4g} motor substeps in a substep of {h:g} s, and at "
            f"most {MOST_MOTOR_SUBSTEPS} are possible. Correct the motor's inertia (mot_J), gains or friction, or lower the "
            "step"
        )
    total = float(scenario.steps) * substeps * motor_substeps
    if total > MAX_STEPS:
        raise UnresolvedSpringError(
            f"the run would need {total:.4g} steps, counting {substeps} substeps and {motor_substeps} motor substeps; at most "
            f"{MAX_STEPS:g} are possible. Shorten the duration, or soften the stiffest spring, of joint '{stiffest}'"
        )
    motor_substeps = int(motor_substeps)
    return Resolution(
        substeps=substeps,
        motor_substeps=motor_substeps + 1 - motor_substeps % 2,
        motor_frequency=max(frequencies),
        omega_h=frequency * h,
        stiffness=tuple(stiffness),
        link_implicitness=_implicitness(decay, stepping.implicitness),
    )


def _count(ratio: float) -> float:
    """Smallest whole number of substeps that is at least `ratio`, and at least 1; infinite if the ratio is infinite or NaN."""
    return max(1, math.ceil(ratio - 1e-9)) if ratio < math.inf else math.inf


def link_damping(drive: SteppedJoint, stiffness: float) -> float:
    """Largest viscous damping of the link in N m s/rad, with the derivative action of its controller."""
    law = drive.link_damping
    following = 2.0 * law.ratio * math.sqrt(law.inertia * stiffness) if law and law.ratio else 0.0
    return max(drive.constant_damping + drive.link_brake + following, 0.0)


def _implicitness(decay: float, least: float) -> float:
    """Weight w of the new velocity in the velocity on which damping acts; at least `least`. With damping c, inertia I and
    `decay` f = c h / I, a substep multiplies the velocity of a damped mode by (1 - (1 - w) f) / (1 + w f). The midpoint rule, w
    = 1/2, is of second order, but with this rule a strongly damped velocity changes its sign in every step. So w is increased
    until this factor is not below -`RINGING`.
    """
    return max(least, (decay - 1.0 - RINGING) / (decay * (1.0 + RINGING))) if decay > 1.0 else least


def _fastest(masses: Array, gains: Array) -> tuple[float, Array]:
    """Largest eigenvalue of M^-1 diag(gains) over the mass matrices (m, n, n) with gains (n,) or (m, n), and the eigenvector of
    this eigenvalue.
    """
    root = np.sqrt(gains)
    values, vectors = np.linalg.eigh(root[..., :, None] * np.linalg.inv(masses) * root[..., None, :])
    largest = int(values[:, -1].argmax())
    return float(values[largest, -1]), vectors[largest, :, -1]


def _motor_rates(drive: SteppedJoint, stiffness: float) -> tuple[float, float]:
    """Largest natural frequency of the joint's motors in rad/s, from spring, controller and bristles, with a fixed link, and
    the largest rate in 1/s of a torque on the motors that acts explicitly (friction that decreases with speed, stages). This
    rate is the slope of the torque over the speed, divided by the inertia.
    """
    own, frequency, growth = drive.drive, 0.0, 0.0
    damping = _bound(drive, "damping_bound") + _bound(drive, "ground_damping_bound")
    stiffness += _bound(drive, "ground_stiffness_bound")
    for i, inertia in enumerate(own.motor_inertia if own else ()):
        motor = {
            name: drive.values[f"motor_{i + 1}_{name}"] for name in (*FRICTIONS, "friction_stiffness", "stribeck_velocity")
        }
        springs = stiffness + (own.proportional[i] if own and own.mode.controller else 0.0)
        if any(motor[name] for name in FRICTIONS):
            springs += motor["friction_stiffness"]
        frequency = max(frequency, math.sqrt(max(springs, 0.0) / inertia))
        fading = STEEPEST * (motor["stribeck_friction"] / motor["stribeck_velocity"])
        growth = max(growth, fading / inertia, damping / inertia)
    return frequency, growth
