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
TOLERANCE = 1e-14
"""Width of the bracket at which a root search ends, rad or m (relative for values above 1)."""
FARTHEST = 1e6
"""Largest distance between a motor's reference and its position of rest, rad."""


def resting_motors(drive: Drive, position: Array, references: Array, *, limited: bool = True) -> Array:
    """Rest positions (positions, n) of motors and adjuster with the link at `position` (n,), rad.

    references: references (positions, n) after the reference map, rad. A controller without integral action has the
    steady-state error tau_el / P. Ideal motors stand at their references. limited: whether the motors' largest torques and
    position stops apply. Friction is neglected.
    """
    resting = np.array(references, dtype=float)
    if not (drive.mode.motor and drive.mode.controller):
        return resting
    law = over_arrays(drive.actuator.elastic_torques)

    def load(motor: int, theta: Array) -> Array:
        """Torque (n,) of the springs on a motor at `theta` (n,), while the other motors stand at `resting`."""
        trial = resting.copy()
        trial[motor] = theta
        return np.asarray(law(position, *trial, drive.elastic)[motor])

    for _ in range(ROUNDS):
        loads = []
        for motor in range(drive.dynamic_motors):
            most, ends = (drive.max_torque[motor], drive.motor_ranges[motor]) if limited else (np.inf, (-np.inf, np.inf))
            gain = np.inf if drive.integral[motor] > 0.0 else drive.proportional[motor]
            resting[motor] = np.clip(_balance(partial(load, motor), references[motor], gain, most), *ends)
            loads.append(load(motor, resting[motor]))
        # If each spring depends on one motor, one round leaves the loads unchanged and the search ends.
        if np.array_equal(loads, law(position, *resting, drive.elastic)[: len(loads)]):
            break
    return resting


def resting_integrals(drive: Drive, position: Array, resting: Array) -> Array:
    """Torque (motors, n) of each controller's integral action at rest, N m; 0 without integral action."""
    torques = over_arrays(drive.actuator.elastic_torques)(position, *resting, drive.elastic)
    rows = zip(torques, drive.integral, drive.max_torque, strict=False)
    return np.array([np.clip(torque, -most, most) * (gain > 0.0) for torque, gain, most in rows])


def _balance(load: Callable[[Array], Array], wanted: Array, gain: float, most: float) -> Array:
    """Positions (n,) at which a controller balances the load of a motor. wanted: references (n,), rad; gain: proportional gain,
    infinite for a controller with integral action; most: largest torque, N m."""
    here = load(wanted)
    if np.isinf(gain):
        # At rest the integral action balances the spring's torque, up to the motor's largest torque.
        holding = np.clip(here, -most, most)
        resting = wanted if np.array_equal(here, holding) else increasing_roots(lambda theta: load(theta) - holding, wanted)
        return np.where(here == holding, wanted, resting)
    # The load decreases as the motor moves away from its reference.
    reach = np.minimum(np.abs(here) / gain, 1.0) if gain > 0.0 else 1.0
    return increasing_roots(lambda theta: load(theta) - np.clip(gain * (wanted - theta), -most, most), wanted, reach, FARTHEST)


def increasing_roots(
    function: Callable[[Array], Array], start: Array, reach: float | Array = 0.1, farthest: float = FARTHEST
) -> Array:
    """Roots (n,) of an increasing, elementwise `function`; without a root, the point at distance `farthest` from `start`.

    The bracket begins at `start` (n,) with the width `reach`, which is doubled up to `farthest`. Regula falsi (Illinois) then
    narrows the bracket, with a bisection where three steps have not halved the bracket.
    """
    with np.errstate(all="ignore"):
        near, at_near = np.array(start, dtype=float), function(start)
        side, reach = -np.sign(at_near), np.broadcast_to(np.maximum(reach, TOLERANCE), near.shape)
        while True:
            far = start + side * reach
            at_far = function(far)
            beyond = at_far * side < 0.0
            near, at_near = np.where(beyond, far, near), np.where(beyond, at_far, at_near)
            beyond &= reach < farthest
            if not beyond.any():
                break
            reach = np.where(beyond, np.minimum(2.0 * reach, farthest), reach)
        low, high = np.where(side > 0.0, near, far), np.where(side > 0.0, far, near)
        at_low, at_high = np.where(side > 0.0, at_near, at_far), np.where(side > 0.0, at_far, at_near)
        widest, last = 0.5 * (high - low), np.full(np.shape(low), -1)
        for step in range(MOST_STEPS):
            width, least = high - low, 0.4 * TOLERANCE * np.maximum(1.0, np.abs(low))
            if np.all(width <= 2.5 * least):
                break
            secant = (low * at_high - high * at_low) / (at_high - at_low)
            bisected = ~np.isfinite(secant) | ((step % 3 == 2) & (width > widest))
            # A step just beyond a converged end closes the bracket.
            middle = np.where(bisected, 0.5 * (low + high), np.clip(secant, low + least, high - least))
            widest = 0.5 * width if step % 3 == 2 else widest
            value = function(middle)
            above = value >= 0.0
            # Illinois: if an end stays for two steps, its value is halved, so that both ends move.
            kept, last = np.where(above == last, 0.5, 1.0), above
            at_low, at_high = np.where(above, kept * at_low, value), np.where(above, value, kept * at_high)
            high, low = np.where(above, middle, high), np.where(value <= 0.0, middle, low)
    return 0.5 * (low + high)
