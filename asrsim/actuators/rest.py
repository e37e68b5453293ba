"""Where the motors of a drive come to rest under the springs' load, its link held."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

from asrsim.actuators.drive import Drive

ROOT_TOLERANCE = 1e-14
"""rad."""
ROUNDS = 50
"""Of motors whose springs depend on both; where they do not, two are enough."""
FARTHEST = 1e6
"""rad from its reference within which a motor that gives way is looked for."""


def resting_motors(drive: Drive, position: float, references: Sequence[float], *, limited: bool = True) -> tuple[float, ...]:
    """Positions of the motors at rest, rad, as the springs' law takes them: a controller without integral action gives way by
    tau_el / P.

    position: of the link, rad; references: of the motors, after the reference map. limited: a motor gives way at its largest
    torque, and stands on its stops. Friction is left out. For ideal motors these are the references themselves.
    """
    if not (drive.mode.motor and drive.mode.controller):
        return tuple(references)
    resting = list(references)
    for _ in range(ROUNDS):
        before = [*resting]
        for motor in range(drive.dynamic_motors):
            resting[motor] = _resting(drive, motor, position, references[motor], resting, limited)
        if resting == before or drive.dynamic_motors < 2:
            break
    return tuple(resting)


def resting_integrals(drive: Drive, position: float, resting: Sequence[float]) -> tuple[float, ...]:
    """N m that the integral action of each controller gives at rest; 0 where it has none."""
    if not (drive.mode.motor and drive.mode.controller):
        return ()
    law: Any = drive.actuator.elastic_torques
    torques = law(position, *resting, drive.elastic)
    limits = zip(torques, drive.integral, drive.max_torque, strict=False)
    return tuple(min(max(torque, -most), most) if gain > 0.0 else 0.0 for torque, gain, most in limits)


def _resting(drive: Drive, motor: int, position: float, wanted: float, positions: list[float], limited: bool) -> float:
    """Where one motor rests, rad, while the other stays at its place in `positions`."""
    gain, elastic = drive.proportional[motor], drive.elastic
    law: Any = drive.actuator.elastic_torques
    most = drive.max_torque[motor] if limited else math.inf
    low, high = drive.motor_ranges[motor] if limited else (-math.inf, math.inf)

    def load(theta: float) -> float:
        trial = [*positions]
        trial[motor] = theta
        try:
            return float(law(position, *trial, elastic)[motor])
        except OverflowError:
            return math.copysign(math.inf, theta - position)

    def imbalance(theta: float) -> float:
        return load(theta) - min(max(gain * (wanted - theta), -most), most)

    wanted_load = load(wanted)
    if drive.integral[motor] > 0.0:
        # In time the controller gives whatever holds the spring, up to the motor's largest torque.
        held = min(max(wanted_load, -most), most)
        rest = wanted if held == wanted_load else increasing_root(lambda theta: load(theta) - held, wanted, 1.0)[0]
    else:
        # The load only falls on the way; it may be infinite where that begins.
        rest = increasing_root(imbalance, wanted, min(abs(wanted_load) / gain, 1.0) if gain > 0.0 else 1.0)[0]
    return min(max(rest, low), high)


def increasing_root(
    function: Callable[[float], float], start: float, reach: float, farthest: float = FARTHEST
) -> tuple[float, float]:
    """The zero of a growing function, and 0. It is sought from `start` on as far as `reach`, then twice as far each time, up to
    `farthest`; where there is none so far, the last place that was tried and the function's value there."""
    first = value = function(start)
    side, last = -math.copysign(1.0, first), start
    while first != 0.0 and reach <= farthest:
        farther = start + side * reach
        value = function(farther)
        if value * first <= 0.0:
            return _root_between(function, last, farther), 0.0
        last, reach = farther, 2.0 * max(reach, ROOT_TOLERANCE)
    return last, value


def _root_between(function: Callable[[float], float], one: float, other: float) -> float:
    """A root between two points of opposite sign, to rounding."""
    from scipy.optimize import brentq

    low, high = min(one, other), max(one, other)
    at_low, at_high = function(low), function(high)
    if at_low == 0.0 or at_high == 0.0:
        return low if at_low == 0.0 else high
    if math.isinf(at_low) or math.isinf(at_high):
        return _bisect(function, low, high)
    return float(brentq(function, low, high, xtol=ROOT_TOLERANCE, rtol=1e-15))


def _bisect(function: Callable[[float], float], low: float, high: float) -> float:
    """Bisection, for laws that overflow on the way."""
    sign = math.copysign(1.0, function(low))
    while high - low > ROOT_TOLERANCE * max(1.0, abs(low)):
        middle = 0.5 * (low + high)
        if middle in (low, high):
            break
        if math.copysign(1.0, function(middle)) == sign:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)
