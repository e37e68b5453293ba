"""Positions at which the motors of a drive rest under the load of the springs, and roots of increasing functions."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from asrsim.actuators.drive import Drive
from asrsim.actuators.vectorised import Array, over_arrays

ROUNDS = 50
"""Largest number of rounds over the motors; one round is enough if each spring depends on one motor."""
MOST_STEPS = 120
"""Largest number of function evaluations of a root search; about fifteen are usual."""
TOLERANCE = 4e-15
"""Smallest step of a root search, rad or m (relative for values above 1)."""
FARTHEST = 1e6
"""Largest distance between a motor's reference and its position of rest, rad."""


def spring_torques(drives: Sequence[Drive], position: Array, references: Sequence[Array]) -> Array:
    """Torques (joints, n) in N m of the springs on the links at `position` (joints, n) in rad, with the motors at rest.

    references: references of each drive, (positions, n) or (positions, 1), as in `resting_motors`.
    """
    torques = np.zeros_like(position)
    for rows in alike(drives):
        goals = np.stack([references[row] for row in rows], axis=1)
        torques[rows] = resting_motors([drives[row] for row in rows], position[rows], goals)[1].sum(axis=0)
    return torques


def alike(drives: Sequence[Drive]) -> list[list[int]]:
    """Numbers of the drives, in groups with the same actuator and mode."""
    groups = defaultdict(list)
    for number, drive in enumerate(drives):
        groups[drive.actuator, drive.mode].append(number)
    return [*groups.values()]


def resting_motors(drives: Sequence[Drive], position: Array, references: Array, *, limited: bool = True) -> tuple[Array, Array]:
    """Rest positions (positions, joints, n) of motors and adjusters in rad with the links at `position` (joints, n) in rad, and
    the torques (springs, joints, n) of the springs there in N m.

    drives: drives with the same actuator and mode. references: references (positions, joints, n) after the reference map, rad.
    A controller without integral action has the steady-state error tau_el / P. Ideal motors stand at their references. Friction
    is neglected. limited: whether the motors' largest torques and position stops apply.
    """
    resting, springs = references + np.zeros_like(position), over_arrays(drives[0].actuator.elastic_torques)
    motors = drives[0].dynamic_motors if drives[0].mode.controller else 0
    elastic = tuple(np.array(values)[:, None] for values in zip(*(drive.elastic for drive in drives), strict=True))

    def law(position: Array, *positions: Array) -> Array:
        ends = list(positions)
        for row, drive in enumerate(drives if any(drive.stages for drive in drives) else ()):
            for motor in range(drive.actuator.motors):
                ends[motor] = ends[motor].copy()
                ends[motor][row] = position[row] + drive.placed(motor + 1, ends[motor][row] - position[row])
        return springs(position, *ends, elastic)

    def numbers(name: str) -> Array:
        """Numbers (..., motors, joints, 1) of the motors."""
        return np.array([getattr(drive, name) for drive in drives]).T[..., None]

    if not motors:
        return resting, law(position, *resting)
    wanted, gain, integral = resting[:motors].copy(), numbers("proportional"), numbers("integral")
    most, (low, high) = numbers("max_torque"), numbers("motor_ranges")
    if not limited:
        most, low, high = (np.full_like(most, bound) for bound in (np.inf, -np.inf, np.inf))

    def pulls(theta: Array) -> Array:
        """Torques (springs, joints, n) of the springs with the motors at `theta` (motors, joints, n)."""
        return law(position, *theta, *resting[motors:])

    def missing(own: slice, holding: Array, theta: Array) -> Array:
        """Torques of the springs minus the torques of some motors at `theta`, while the others stand at `resting`. holding:
        torques of integral action."""
        trial = resting[:motors].copy()
        trial[own] = theta
        torque = np.where(integral[own] > 0.0, holding, gain[own] * (wanted[own] - theta))
        return np.asarray(pulls(trial)[:motors][own] - np.minimum(np.maximum(torque, -most[own]), most[own]))

    def search(own: slice) -> Array:
        """Positions at which these motors rest, each as if the others did not move."""
        # At the reference, integral action balances the springs, up to the motor's largest torque.
        trial = resting[:motors].copy()
        trial[own] = wanted[own]
        holding = pulls(trial)[:motors][own] if integral[own].any() else np.zeros(())
        found = increasing_roots(partial(missing, own, holding), wanted[own], slope=gain[own], apart=True)
        return np.clip(found, low[own], high[own])

    # Usually each spring depends on one motor, and one search finds all motors.
    found = search(slice(motors))
    torques = pulls(found)
    if motors == 1 or all(_alone(pulls, wanted, found, torques, motor) for motor in range(motors)):
        return np.concatenate([found, resting[motors:]]), torques
    for _ in range(ROUNDS):
        loads = []
        for motor in range(motors):
            resting[motor] = search(slice(motor, motor + 1))[0]
            loads.append(pulls(resting[:motors])[motor])
        torques = pulls(resting[:motors])
        if np.array_equal(loads, torques[:motors]):
            break
    return resting, torques


def _alone(pulls: Callable[[Array], Array], wanted: Array, found: Array, torques: Array, motor: int) -> bool:
    """Whether the torque on a motor does not depend on the other motors. found: positions of the motors with these torques;
    wanted: other positions."""
    trial = wanted.copy()
    trial[motor] = found[motor]
    return np.array_equal(pulls(trial)[motor], torques[motor])


@np.errstate(all="ignore")
def increasing_roots(
    function: Callable[[Array], Array], start: Array, farthest: float = FARTHEST, slope: Array | float = 0.0, *,
    apart: bool = False,
) -> Array:  # fmt: skip
    """Roots (...) of an increasing, elementwise `function`; without a root, the point at distance `farthest` from `start`.

    The bracket begins at `start` (...) and is doubled up to `farthest`. Regula falsi (Illinois) then narrows the bracket; every
    third step is a bisection, so that the search ends for every function. slope: estimate of the function's slope (0 if
    unknown), from which the width of the first bracket follows. apart: whether each entry of the first axis is a search of its
    own, whose roots do not depend on the other entries; else all searches end together.
    """
    near = far = np.array(start, dtype=float)
    at_near = at_far = function(near)
    side, reach = -np.sign(at_near), np.clip(0.5 * np.abs(at_near) / slope, 1e-9, 0.05)
    short = side != 0.0
    while short.any():
        near, at_near = np.where(short, far, near), np.where(short, at_far, at_near)
        reach = np.minimum(2.0 * reach, farthest)
        far = np.where(short, start + side * reach, far)
        at_far = function(far)
        short = (at_far * side < 0.0) & (far != near)
    low, high = np.minimum(near, far), np.maximum(near, far)
    at_low, at_high = np.where(side > 0.0, at_near, at_far), np.where(side > 0.0, at_far, at_near)
    last = np.full(np.shape(low), -1)
    for step in range(MOST_STEPS):
        least = TOLERANCE * np.maximum(1.0, np.abs(low))
        wide = ~(high - low <= 2.5 * least)
        if not wide.any():
            break
        going = wide.any(axis=tuple(range(1, wide.ndim)), keepdims=True) if apart else True
        # A step just beyond a converged end closes the bracket.
        secant = np.clip((low * at_high - high * at_low) / (at_high - at_low), low + least, high - least)
        middle = np.where((step % 3 == 2) | ~np.isfinite(secant), 0.5 * (low + high), secant)
        value = function(middle)
        above = value >= 0.0
        # Illinois: if an end stays for two steps, its value is halved, so that both ends move.
        kept, last = np.where(above == last, 0.5, 1.0), above
        at_low, at_high = np.where(above, kept * at_low, value), np.where(above, value, kept * at_high)
        high, low = np.where(above & going, middle, high), np.where((value <= 0.0) & going, middle, low)
    return np.asarray(0.5 * (low + high))
