"""Number of substeps that a run needs, from the mass matrix and the largest stiffness that the springs can reach.

The coupled step is stable for omega h < 2 with omega = sqrt(lambda_max(M^-1 diag(stiffness))); the default substep h satisfies
omega h <= 0.2, where the relative error of the frequency is (omega h)^2 / 24 = 0.17 %.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from asrsim.actuators.vectorised import energy_law, over_arrays
from asrsim.errors import UnresolvedSpringError
from asrsim.samples import Array
from asrsim.simulation.drives import SteppedJoint

TARGET = 0.2
"""Largest omega h with the automatic number of substeps, chosen for accuracy; above 2 the step is unstable."""
MOTOR_TARGET = 0.3
"""Largest omega h of motor and spring with a fixed link, with the automatic number of motor substeps."""
OVERSHOOT = 2.0
"""Safety factor: a step load deflects an undamped spring twice as far as a slowly applied load. The factor also applies to the
speeds of the references."""
UNSTABLE = 2.0
"""omega h above which a spring gains energy in every step."""
COARSE = 0.5
"""omega h above which a spring is no longer resolved well."""
FADING = 0.1
"""Largest product of growth rate and h with the automatic number of substeps, where friction decreases with speed."""
STEEPEST = math.sqrt(2.0 / math.e)
"""Largest magnitude of the slope of exp(-x^2)."""
FRICTIONS = ("friction_torque", "stribeck_friction", "load_friction")
"""Parameters of a motor that cause friction. If any of these parameters is above 0, the stiffness of the friction's bristles
limits the step."""
RINGING = 0.5
"""Largest allowed ratio of the amplitudes in successive steps, for a strongly damped motion that changes its sign in every
step."""
STANDING = 1e-3
"""Distance in rad between a joint and its first reference below which no initial jump of the motor is assumed."""


@dataclass(frozen=True, kw_only=True)
class Resolution:
    """Numbers of substeps and the values from which they follow."""

    substeps: int
    motor_substeps: int
    frequency: float
    """Largest natural frequency omega of the links on their springs, rad/s."""
    motor_frequency: float
    omega_h: float
    """Largest natural frequency of the links on their springs, multiplied by the substep."""
    stiffness: tuple[float, ...]
    """Largest reachable stiffness of each joint in N m/rad."""
    link_implicitness: float
    """Weight of the new velocity in the damping of the links: 1/2 is the midpoint rule; larger values damp fast modes."""


def reachable_stiffness(drive: SteppedJoint, references: Array, *, interval: float, load: float, inertia: float) -> float:
    """Largest stiffness in N m/rad that the joint's spring can reach in this run; a run that exceeds this stiffness gets a
    warning.

    references: values (columns, n), sampled every `interval` s over the run; load: bound of the torques of gravity and of
    external torques on the link in N m; inertia: largest inertia that the joint can carry in kg m^2. A spring is deflected at
    most to max_deflection, and by no more than its pretension (half the references' spread) plus the deflections by load and
    motion. Ideal motors jump with their references. Motors with dynamics are at most as fast as their references or their speed
    limit; they deflect the springs at most until the springs have absorbed the joint's kinetic energy at this speed, and the
    springs' torque is at most the motors' largest torque (with a safety factor) plus the load.
    """
    actuator: Any = drive.actuator
    mode = drive.mode
    if actuator is None or mode is None or not mode.spring:
        return 0.0
    limit = drive.values.get("max_deflection", math.pi)
    # The released code moves an adjuster by a motor, in mode 4 by a torque: the adjuster's range is not known beforehand.
    torque_driven = drive.stepping.released and mode.direct
    sigma = float(references[1][np.argmax(np.abs(references[1]))]) if actuator.adjuster and not torque_driven else 0.0

    def torque_at(deflection: float) -> float:
        deflections = [_positions(drive, [d] * actuator.motors, sigma) for d in (deflection, -deflection)]
        return float(max(abs(part) for positions in deflections for part in _torques(drive, positions)))

    goals = drive.goals(references)[: actuator.motors]
    centre = goals.mean(axis=0)
    spread = float(np.max(np.abs(goals - centre))) if not mode.direct else 0.0
    offset = abs(float(centre[0]) - drive.initial_position)
    changes = np.abs(np.diff(centre))
    change = float(np.max(changes)) if len(changes) else 0.0
    if mode.motor:
        motors = range(1, actuator.motors + 1)
        pull = max(min(drive.electric(i).limit, drive.electric(i).stall) for i in motors)
        speed = fastest = max(drive.values[f"motor_{i}_max_velocity"] for i in motors)
        if mode.direct:
            torques = [drive.electric(i).torque_of(np.abs(goals[i - 1])) for i in motors]
            pull = min(pull, float(np.max(torques)))
            spread = _largest_below(torque_at, pull, limit)
        elif offset < STANDING:
            speed = min(fastest, OVERSHOOT * change / interval)
        moved = _caught(drive, spread, sigma, 0.5 * inertia * speed * speed, limit)
        bound = min(torque_at(min(spread + moved, limit)), OVERSHOOT * pull) + OVERSHOOT * load
    else:
        bound = torque_at(min(spread + max(offset, change), limit)) + OVERSHOOT * load
    reach = _largest_below(torque_at, bound, limit)
    grid = np.linspace(-reach, reach, 9).tolist()
    best = 0.0
    for deflections in product(grid, repeat=actuator.motors):
        value = abs(actuator.stiffness(0.0, *_positions(drive, deflections, sigma), drive.elastic))
        best = max(best, value) if math.isfinite(value) else math.inf
    if drive.hysteresis is not None:
        # Where a motion reverses, hysteresis adds a stiffness: the hysteresis torque divided by the hysteresis deflection.
        best += actuator.motors * drive.hysteresis[0] / drive.hysteresis[1]
    return best


def _caught(drive: SteppedJoint, spread: float, sigma: float, energy: float, limit: float) -> float:
    """Deflection at which the springs have absorbed `energy` J, starting from the pretension `spread`."""
    if drive.actuator is None or not math.isfinite(energy):
        return limit
    law = over_arrays(energy_law(drive.actuator))
    others = [-spread] * (drive.actuator.motors - 1)
    placed = [np.full(2, place) for place in _positions(drive, [spread, *others], sigma)]
    if drive.actuator.motors == 1 and not drive.actuator.adjuster:
        placed[1][:] = -spread

    def absorbed(deflection: float) -> float:
        points = np.array([-deflection, 0.0])
        stored = law(points, *placed, drive.elastic)
        return float(stored[0] - stored[1])

    return _largest_below(absorbed, energy, limit)


def _positions(drive: SteppedJoint, deflections: Sequence[float], adjusted: float) -> tuple[float, ...]:
    """Positions that the laws take as arguments, for a link at 0: motor positions equal to these deflections, and the
    adjuster's position."""
    rest = [adjusted] if drive.actuator is not None and drive.actuator.adjuster else [0.0] * (2 - len(deflections))
    return (*deflections, *rest)


def _torques(drive: SteppedJoint, positions: Sequence[float]) -> Any:
    """Torque of each spring in N m, with the link at 0."""
    actuator: Any = drive.actuator
    try:
        return actuator.elastic_torques(0.0, *positions, drive.elastic) if actuator else (0.0, 0.0)
    except (OverflowError, ZeroDivisionError):
        return math.inf, math.inf


def _largest_below(law: Callable[[float], float], bound: float, limit: float) -> float:
    """Largest deflection, at most `limit`, at which the torque is below `bound`. The function bisects a monotone law."""
    if bound <= 0.0:
        return 0.0
    if law(limit) <= bound:
        return limit
    low, high = 0.0, limit
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if law(middle) <= bound else (low, middle)
    return high


def resolve(
    drives: Sequence[SteppedJoint],
    masses: Sequence[Array],
    stiffness: Sequence[float],
    *,
    step: float,
    substeps: int | None,
    motor_substeps: int | None,
    cap: int,
    explicit: bool,
) -> Resolution:
    """Numbers of substeps; raises UnresolvedSpringError if more than `cap` are needed.

    explicit: whether damping acts on the last velocity; masses: mass matrices (n, n) in the relevant configurations; stiffness:
    stiffness of each joint in N m/rad.
    """
    gains = [
        drive.values["controller_1_proportional"] if drive.mode and drive.mode.number == 1 else k
        for drive, k in zip(drives, stiffness, strict=True)
    ]
    omega, shape = _fastest(masses, gains)
    frequency = math.sqrt(omega)
    stiffest = drives[int(np.argmax(np.abs(shape)))].name if len(drives) else ""
    needed = max(1, math.ceil(frequency * step / TARGET - 1e-9))
    if substeps is None:
        if needed > cap:
            raise UnresolvedSpringError(
                f"the spring of joint '{stiffest}' can reach {max(stiffness):.4g} N m/rad: its {frequency / math.tau:.4g} Hz "
                f"cannot be resolved, since a step of {step:g} s would need {needed} substeps and the cap is {cap}. Lower the "
                f"step, raise substep_cap, soften the spring or limit its deflection (max_deflection)"
            )
        fading = max((_fading(drive, masses, j) for j, drive in enumerate(drives)), default=0.0)
        substeps = max(needed, min(cap, math.ceil(fading * step / FADING - 1e-9)))
    h = step / substeps
    limit = frequency * h
    if limit >= UNSTABLE:
        raise UnresolvedSpringError(
            f"the spring of joint '{stiffest}' is unstable with {substeps} substeps of {h:g} s: omega h = {limit:.3g}, "
            f"the limit is 2. Use at least {needed} substeps (or leave the number automatic)"
        )
    steep = max((_motor_fading(drive) for drive in drives), default=0.0)
    motor_frequency = max((_motor_frequency(drive, k) for drive, k in zip(drives, stiffness, strict=True)), default=0.0)
    if motor_substeps is None:
        motor_substeps = max(1, math.ceil(motor_frequency * h / MOTOR_TARGET - 1e-9), math.ceil(steep * h / FADING - 1e-9))
    motor_substeps += 1 - motor_substeps % 2
    return Resolution(
        substeps=substeps,
        motor_substeps=motor_substeps,
        frequency=frequency,
        motor_frequency=motor_frequency,
        omega_h=limit,
        stiffness=tuple(float(k) for k in stiffness),
        link_implicitness=_implicitness(masses, list(map(_damping, drives, stiffness)), h, 0.0 if explicit else 0.5),
    )


def _damping(drive: SteppedJoint, stiffness: float) -> float:
    """Largest viscous damping of the link in N m s/rad, with the derivative action of its controller."""
    law = drive.link_damping
    following = 2.0 * law.ratio * math.sqrt(law.inertia * stiffness) if law and law.ratio else 0.0
    return drive.constant_damping + drive.link_brake + following


def _implicitness(masses: Sequence[Array], dampings: Sequence[float], substep: float, least: float) -> float:
    """Weight w of the new velocity in the velocity on which damping acts; at least `least`. With damping c, inertia I and f = c
    h / I, a substep multiplies the velocity of a damped mode by (1 - (1 - w) f) / (1 + w f). The midpoint rule, w = 1/2, has
    second order, but then a strongly damped velocity changes its sign in every step. So w is increased until this factor is not
    below -`RINGING`.
    """
    root = np.sqrt(np.maximum(dampings, 0.0))
    fastest = substep * _fastest(masses, np.square(root).tolist())[0] if root.any() else 0.0
    if not fastest > 1.0 or not math.isfinite(fastest):
        return least
    return max(least, (fastest - 1.0 - RINGING) / (fastest * (1.0 + RINGING)))


def _fastest(masses: Sequence[Array], gains: Sequence[float]) -> tuple[float, Array]:
    """Largest eigenvalue of M^-1 diag(gains) over the configurations, and the eigenvector of this eigenvalue."""
    root = np.sqrt(np.asarray(gains, dtype=float))
    best, shape = 0.0, root
    for mass in masses:
        if not np.all(np.isfinite(root)):
            return math.inf, np.where(np.isfinite(root), 0.0, 1.0)
        values, vectors = np.linalg.eigh(root[:, None] * np.linalg.inv(mass) * root[None, :])
        index = int(np.argmax(np.abs(values))) if values.size else 0
        if values.size and abs(values[index]) > best:
            best, shape = float(abs(values[index])), vectors[:, index]
    return best, shape


def _fading(drive: SteppedJoint, masses: Sequence[Array], j: int) -> float:
    """Largest growth rate in 1/s of the motion of joint `j` where its friction decreases with speed. This rate limits the step
    for accuracy only, since bounded friction is stable at any step."""
    joint = drive.joint
    if not joint.stribeck_friction:
        return 0.0
    return STEEPEST * joint.stribeck_friction / joint.stribeck_velocity * max(float(np.linalg.inv(m)[j, j]) for m in masses)


def _motor_fading(drive: SteppedJoint) -> float:
    """Largest growth rate in 1/s of the motion of the joint's motors where their friction decreases with speed."""
    values, motors = drive.values, range(1, drive.dynamic_motors + 1)
    steep = (
        values[f"motor_{i}_stribeck_friction"] / (values[f"motor_{i}_stribeck_velocity"] * values[f"motor_{i}_inertia"])
        for i in motors
    )
    return STEEPEST * max(steep, default=0.0)


def _motor_frequency(drive: SteppedJoint, stiffness: float) -> float:
    """Largest natural frequency of a motor in rad/s, from spring, controller and bristles, with a fixed link."""
    frequency = 0.0
    for index in range(1, drive.dynamic_motors + 1):
        springs = stiffness
        if drive.mode and drive.mode.controller:
            springs += drive.electric(index).gain * drive.values[f"controller_{index}_proportional"]
        if any(drive.values[f"motor_{index}_{name}"] for name in FRICTIONS):
            springs += drive.values[f"motor_{index}_friction_stiffness"]
        frequency = max(frequency, math.sqrt(max(springs, 0.0) / drive.values[f"motor_{index}_inertia"]))
    return frequency
