"""Positions at which the motors of a drive rest under the load of the springs, and roots of increasing functions."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from asrsim.actuators.drive import Drive
from asrsim.actuators.vectorised import Array, over_arrays

ROUNDS = 50
"""Largest number of rounds over the motors of a drive; one round is enough if each spring depends on one motor only."""
MOST_STEPS = 120
"""Largest number of function evaluations of a root search; about fifteen are usual."""
TOLERANCE = 4e-15
"""Smallest step of a root search in rad or m; for values above 1, relative to the value."""
FARTHEST = 1e6
"""Largest distance between a motor's reference and its position of rest, rad."""
NUDGE = 1e-6
"""Step of the finite differences that give the stiffness, rad (m)."""
LONGEST = 0.2
"""Largest step of Newton's method in rad (m), limited since springs and gravity are strongly nonlinear."""
FLAT = 1e-3
"""Smallest stiffness in N m/rad (N/m) that Newton's method assumes, so that its steps stay finite."""
NEAR = 1e-3
"""Largest step of the motors in rad after which no further step is needed, since the remaining error is of second order in the
step."""
ROUNDING = 1e-12
"""Distance in rad beyond the border of a controller's range at which a step that crosses this border ends."""
INTEGRATING = 1e9
"""Stiffness in N m/rad that Newton's method assumes for a controller with integral action: far stiffer than any spring."""


def spring_torques(drives: Sequence[Drive], position: Array, references: Sequence[Array]) -> Array:
    """Torques (joints, n) in N m of the springs on the links at `position` (joints, n) in rad, with the motors at rest.

    references: references of each drive, (positions, n) or (positions, 1), as in `resting_motors`.
    """
    torques = np.zeros_like(position)
    for rows in alike(drives):
        goals = np.stack([references[row] for row in rows], axis=1)
        own = [drives[row] for row in rows]
        torques[rows] = own[0].actuator.on_link(resting_motors(own, position[rows], goals)[1])
    return torques


def alike(drives: Sequence[Drive]) -> list[list[int]]:
    """Indices of the drives, in one list for each group of drives with the same actuator and mode."""
    groups = defaultdict(list)
    for number, drive in enumerate(drives):
        groups[drive.actuator, drive.mode].append(number)
    return [*groups.values()]


def resting_motors(drives: Sequence[Drive], position: Array, references: Array, *, limited: bool = True) -> tuple[Array, Array]:
    """Rest positions of motors, and the torques of their springs, with the links at `position`; see `MotorsAtRest`."""
    return MotorsAtRest(drives, references, limited=limited).under(position)


class MotorsAtRest:
    """Motors at rest under the load of their springs, for links at given positions.

    A controller without integral action has the steady-state error tau_el / P, where tau_el is the torque of the spring on the
    motor. Motors without controllers stand at their references. Friction is neglected.
    """

    def __init__(self, drives: Sequence[Drive], references: Array, *, limited: bool = True) -> None:
        """drives: drives with the same actuator and mode. references: references (positions, joints, n) after the reference
        map, rad. limited: whether the motors' largest torques and position stops apply."""
        self._references = references
        self._springs, self._on_link = over_arrays(drives[0].actuator.elastic_torques), drives[0].actuator.on_link
        self._motors = drives[0].dynamic_motors if drives[0].mode.controller else 0
        self._elastic = tuple(np.array(values)[:, None] for values in zip(*(drive.elastic for drive in drives), strict=True))
        self._staged = [(row, drive) for row, drive in enumerate(drives) if drive.stages]

        def numbers(name: str, *several: int) -> Array:
            """Values (..., motors, joints, 1) of an attribute of the drives. several: number of values of the attribute per
            motor."""
            found = np.array([getattr(drive, name)[: self._motors] for drive in drives])
            return found.reshape(len(drives), self._motors, *several).T[..., None]

        self._gain, self._integral, self._most = numbers("proportional"), numbers("integral"), numbers("max_torque")
        self._ranges = numbers("motor_ranges", 2)
        if not limited:
            self._most, self._ranges = np.full_like(self._most, np.inf), np.full_like(self._ranges, np.inf)
            self._ranges[:1] = -np.inf
        self._followed: tuple[Array, Array, Array] | None = None
        """Positions of the links and of the motors after the last step of `follow`, and changes of the motors' positions per
        displacement of their links."""

    def under(self, position: Array) -> tuple[Array, Array]:
        """Rest positions (positions, joints, n) of motors and adjusters in rad with the links at `position` (joints, n) in rad,
        and the torques (springs, joints, n) of the springs there in N m."""
        resting, motors = self._references + np.zeros_like(position), self._motors
        if not motors:
            return resting, self._law(position, *resting)
        wanted, (low, high) = resting[:motors].copy(), self._ranges

        def pulls(theta: Array) -> Array:
            """Torques (springs, joints, n) of the springs with the motors at `theta` (motors, joints, n)."""
            return self._law(position, *theta, *resting[motors:])

        def search(own: slice) -> Array:
            """Rest positions of the motors `own`, each found as if the other motors did not move."""
            trial, gain, most, integral = resting[:motors].copy(), self._gain[own], self._most[own], self._integral[own]
            integrating, least = bool(integral.any()), -most
            # With integral action, the controller's torque at rest balances the torque of the springs at the reference, up to
            # the motor's largest torque.
            trial[own] = wanted[own]
            holding = pulls(trial)[:motors][own] if integrating else np.zeros(())

            def missing(theta: Array) -> Array:
                """Torques of the springs minus the torques of the controllers, with the motors `own` at `theta` and the other
                motors at `resting`."""
                trial[own] = theta
                torque = gain * (wanted[own] - theta)
                if integrating:
                    torque = np.where(integral > 0.0, holding, torque)
                return np.asarray(pulls(trial)[:motors][own] - np.minimum(np.maximum(torque, least), most))

            return np.clip(increasing_roots(missing, wanted[own], slope=gain, apart=True), low[own], high[own])

        # Usually each spring depends on only one motor. One search then finds the rest positions of all motors.
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

    def follow(self, position: Array) -> tuple[Array, Array]:
        """Torques (joints, n) in N m on the links at `position` (joints, n) in rad with the motors at rest, and the changes of
        these torques per displacement of the links. A search of the links' positions by Newton's method needs the torques and
        the changes.

        The motors begin at their references. In each call, the motors follow the links by a step of Newton's method, and by
        further steps if that step was long. Torques and changes are linearised about the last step.
        """
        motors, (low, high), (gain, least, most) = self._motors, self._ranges, self._unstrained
        if self._followed is None:
            ends = self._references + np.zeros_like(position)
        else:
            before, ends, rates = self._followed
            ends[:motors] = np.clip(ends[:motors] + rates * (position - before), low, high)
        for _ in range(ROUNDS):
            theta = ends[:motors].copy()
            pulls, changes = self._displaced(position, ends)
            below, above = theta < least, theta > most
            strained = below | above
            driven = np.minimum(np.maximum(gain * (self._references[:motors] - theta), -self._most), self._most)
            # Matrices (joints, n, motors, motors) of the equations for the motors' equilibrium, and derivatives with respect to
            # the link position.
            slopes = changes[:motors].transpose(1, 3, 0, 2)
            stiffness = np.where(strained, FLAT, gain).transpose(1, 2, 0)
            matrix = slopes[..., 1:] + stiffness[..., None] * np.eye(motors)
            sides = np.stack([(pulls[:motors] - driven).transpose(1, 2, 0), slopes[..., 0]], axis=-1)
            step, rates = -np.linalg.solve(matrix, sides).transpose(3, 2, 0, 1)
            aim = theta + np.minimum(np.maximum(step, -LONGEST), LONGEST)
            # A step ends at the position at which a controller reaches its largest torque, since the controller's stiffness
            # changes there.
            aim = np.where(below, np.minimum(aim, least + ROUNDING), np.where(above, np.maximum(aim, most - ROUNDING), aim))
            ends[:motors] = np.clip(aim, low, high)
            moved = ends[:motors] - theta
            settled = strained == ((ends[:motors] < least) | (ends[:motors] > most))
            if settled.all() and not np.abs(moved).max(initial=0.0) > NEAR:
                break
        # A motor that is pressed against its stop does not follow its link.
        rates = np.where((aim <= low) | (aim >= high), 0.0, rates)
        self._followed = position, ends, rates
        of_link, of_motors = self._on_link(changes[:, :, 0]), self._on_link(changes[:, :, 1:]).swapaxes(0, 1)
        pull = self._on_link(pulls) + np.sum(of_motors * moved, axis=0)
        return pull, of_link + np.sum(of_motors * rates, axis=0)

    @cached_property
    def _unstrained(self) -> tuple[Array, Array, Array]:
        """Stiffness in N m/rad of the controllers in Newton's method, and the smallest and largest positions (motors, joints,
        n) of the motors at which the controllers' torques do not exceed the largest torques."""
        gain = np.maximum(np.where(self._integral > 0.0, INTEGRATING, self._gain), FLAT)
        references = self._references[: self._motors]
        return gain, references - self._most / gain, references + self._most / gain

    def _displaced(self, position: Array, ends: Array) -> tuple[Array, Array]:
        """Torques (springs, joints, n) of the springs with the links at `position` and the motors at `ends`, and the changes
        (springs, joints, 1 + motors, n) of these torques per displacement of the link, and of each motor."""
        places = np.repeat(np.stack([position, *ends])[:, :, None], 2 + self._motors, axis=2)
        for moved in range(1 + self._motors):
            places[moved, :, 1 + moved] += NUDGE
        torques = self._law(*places.reshape(*places.shape[:2], -1)).reshape(-1, *places.shape[1:])
        return torques[:, :, 0], (torques[:, :, 1:] - torques[:, :, :1]) / NUDGE

    def _law(self, position: Array, *positions: Array) -> Array:
        """Torques (springs, joints, n) of the springs with the links at `position` and the motors at `positions` (joints,
        n)."""
        ends = list(positions)
        for row, drive in self._staged:
            for motor in range(drive.actuator.motors):
                ends[motor] = ends[motor].copy()
                ends[motor][row] = position[row] + drive.placed(motor + 1, ends[motor][row] - position[row])
        return self._springs(position, *ends, self._elastic)


def _alone(pulls: Callable[[Array], Array], wanted: Array, found: Array, torques: Array, motor: int) -> bool:
    """Whether the torque of the spring on a motor does not depend on the other motors. found: positions of the motors at which
    the springs have the torques `torques`; wanted: other positions to compare."""
    trial = wanted.copy()
    trial[motor] = found[motor]
    return np.array_equal(pulls(trial)[motor], torques[motor])


@np.errstate(all="ignore")
def increasing_roots(
    function: Callable[[Array], Array],
    start: Array,
    farthest: float = FARTHEST,
    slope: Array | float = 0.0,
    *,
    apart: bool = False,
    tolerance: float = TOLERANCE,
) -> Array:
    """Roots (...) of an increasing, elementwise `function`; without a root, the point at distance `farthest` from `start`.

    The bracket begins at `start` (...) and is doubled up to `farthest`. Regula falsi (Illinois) then narrows the bracket; every
    third step is a bisection, so that the search ends for every function. slope: estimate of the function's slope (0 if
    unknown), from which the width of the first bracket follows. apart: whether each entry of the first axis is a separate
    search, whose roots do not depend on the other entries; if not, all searches end together. tolerance: smallest step,
    relative for values above 1.
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
    last: Any = None
    for step in range(MOST_STEPS):
        least = tolerance * np.maximum(1.0, np.abs(low))
        wide = ~(high - low <= 2.5 * least)
        if not wide.any():
            break
        middle = 0.5 * (low + high)
        if step % 3 != 2:
            secant = (low * at_high - high * at_low) / (at_high - at_low)
            # A step just beyond a converged end closes the bracket. Do not use np.clip, which takes twice as long.
            middle = np.where(np.isfinite(secant), np.minimum(np.maximum(secant, low + least), high - least), middle)
        value = function(middle)
        above, below = value >= 0.0, value <= 0.0
        # Illinois method: if an end stays for two steps, its value is halved, so that the two ends move.
        kept, last = 1.0 if last is None else np.where(above == last, 0.5, 1.0), above
        at_low, at_high = np.where(above, kept * at_low, value), np.where(above, value, kept * at_high)
        if apart:
            going = wide.any(axis=tuple(range(1, wide.ndim)), keepdims=True)
            above, below = above & going, below & going
        high, low = np.where(above, middle, high), np.where(below, middle, low)
    return np.asarray(0.5 * (low + high))
