"""Positions at which the motors of a drive rest under the load of the springs, and roots of increasing functions."""

from __future__ import annotations

from collections.abc import Callable
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


def resting_motors(drive: Drive, position: Array, references: Array, *, limited: bool = True) -> tuple[Array, Array]:
    """Rest positions (positions, n) of motors and adjuster in rad with the link at `position` (n,) in rad, and the torques
    (springs, n) of the springs there in N m.

    references: references (positions, n) after the reference map, rad. A controller without integral action has the
    steady-state error tau_el / P. Ideal motors stand at their references. Friction is neglected.
    limited: whether the motors' largest torques and position stops apply.
    """
    resting, law = np.array(references, dtype=float), over_arrays(drive.actuator.elastic_torques)

    def load(motor: int, theta: Array) -> Array:
        """Torque (n,) of the springs on a motor at `theta` (n,), while the other motors stand at `resting`."""
        trial = resting.copy()
        trial[motor] = theta
        return np.asarray(law(position, *trial, drive.elastic)[motor])

    def missing(motor: int, holding: Array | None, theta: Array) -> Array:
        """Torque (n,) of the springs minus the torque of the motor. holding: torque of a controller with integral action."""
        torque = drive.proportional[motor] * (references[motor] - theta) if holding is None else holding
        most = drive.max_torque[motor] if limited else np.inf
        return np.asarray(load(motor, theta) - np.clip(torque, -most, most))

    torques = law(position, *resting, drive.elastic)
    for _ in range(ROUNDS if drive.mode.controller and drive.dynamic_motors else 0):
        loads = []
        for motor in range(drive.dynamic_motors):
            # At the reference, integral action balances the springs, up to the motor's largest torque.
            holding = load(motor, references[motor]) if drive.integral[motor] > 0.0 else None
            found = increasing_roots(partial(missing, motor, holding), references[motor])
            resting[motor] = np.clip(found, *drive.motor_ranges[motor]) if limited else found
            loads.append(load(motor, resting[motor]))
        torques = law(position, *resting, drive.elastic)
        # If each spring depends on one motor, one round leaves the loads unchanged and the search ends.
        if np.array_equal(loads, torques[: len(loads)]):
            break
    return resting, torques


@np.errstate(all="ignore")
def increasing_roots(function: Callable[[Array], Array], start: Array, farthest: float = FARTHEST) -> Array:
    """Roots (n,) of an increasing, elementwise `function`; without a root, the point at distance `farthest` from `start`.

    The bracket begins at `start` (n,) and is doubled up to `farthest`. Regula falsi (Illinois) then narrows the bracket; every
    third step is a bisection, so that the search ends for every function.
    """
    near = far = np.array(start, dtype=float)
    at_near = at_far = function(near)
    side, reach = -np.sign(at_near), 0.05
    short = side != 0.0
    while short.any():
        near, at_near = np.where(short, far, near), np.where(short, at_far, at_near)
        if reach == farthest:
            break
        reach = min(2.0 * reach, farthest)
        far = np.where(short, start + side * reach, far)
        at_far = function(far)
        short = at_far * side < 0.0
    low, high = np.minimum(near, far), np.maximum(near, far)
    at_low, at_high = np.where(side > 0.0, at_near, at_far), np.where(side > 0.0, at_far, at_near)
    last = np.full(np.shape(low), -1)
    for step in range(MOST_STEPS):
        least = TOLERANCE * np.maximum(1.0, np.abs(low))
        if np.all(high - low <= 2.5 * least):
            break
        # A step just beyond a converged end closes the bracket.
        secant = np.clip((low * at_high - high * at_low) / (at_high - at_low), low + least, high - least)
        middle = np.where((step % 3 == 2) | ~np.isfinite(secant), 0.5 * (low + high), secant)
        value = function(middle)
        above = value >= 0.0
        # Illinois: if an end stays for two steps, its value is halved, so that both ends move.
        kept, last = np.where(above == last, 0.5, 1.0), above
        at_low, at_high = np.where(above, kept * at_low, value), np.where(above, value, kept * at_high)
        high, low = np.where(above, middle, high), np.where(value <= 0.0, middle, low)
    return np.asarray(0.5 * (low + high))
