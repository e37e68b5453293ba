"""Largest stiffness that the springs of a run can reach.

A spring is deflected at most to max_deflection. Its deflection is also at most its pretension (half the difference between the
references) plus the deflections that load and motion cause. Ideal motors jump with their references. Motors with dynamics are
at most as fast as their references or their speed limit; they deflect the springs at most until the springs have absorbed the
joint's kinetic energy at this speed, and the springs' torque is at most the motors' largest torque (with a safety factor) plus
the load.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import product
from typing import Any

import numpy as np

from asrsim.actuators.drive import Drive
from asrsim.actuators.rest import alike
from asrsim.actuators.vectorised import energy_law, over_arrays
from asrsim.samples import Array
from asrsim.simulation.drives import SteppedJoint

STANDING = 1e-3
"""Distance in rad between a joint and its first reference below which no initial jump of the motor is assumed."""
OVERSHOOT = 2.0
"""Safety factor of the loads, of the largest torques of the motors and of the speeds of the references. A step load deflects an
undamped spring twice as far as a slowly applied load."""
PARTS, ROUNDS = 32, 6
"""PARTS: number of parts into which each round of a search divides the remaining range of deflections; ROUNDS: number of
rounds. The result is accurate to 1e-9 of the largest deflection."""
PLACES = 9
"""Number of deflections of each spring at which the stiffness is computed, from one end of the spring's range to the other
end."""


def reachable_stiffness(
    drives: Sequence[SteppedJoint], references: Array, loads: Array, inertias: Array, interval: float
) -> list[float]:
    """Largest stiffness in N m/rad that each joint's spring can reach; a run that exceeds this stiffness gets a warning. The
    result is 0 without a spring, and infinite where a law is not finite.

    references: values (joints, columns, n), sampled every `interval` s over the run; loads: bounds (joints,) of the torques of
    gravity and of external torques on the links in N m; inertias: largest inertias (joints,) that the joints can carry in
    kg m^2.
    """
    found = np.zeros(len(drives))
    sprung = [(j, one.drive) for j, one in enumerate(drives) if one.drive is not None and one.drive.mode.spring]
    for rows in alike([drive for _, drive in sprung]):
        joints = [sprung[row][0] for row in rows]
        own = [(drives[j], sprung[row][1]) for j, row in zip(joints, rows, strict=True)]
        found[joints] = _stiffness(own, references[joints], loads[joints], inertias[joints], interval)
    return [float(stiffness) for stiffness in found]


def _stiffness(
    own: Sequence[tuple[SteppedJoint, Drive]], references: Array, loads: Array, inertias: Array, interval: float
) -> Array:
    """Largest stiffness (joints,) of joints with the same actuator and mode."""
    joints, drives = zip(*own, strict=True)
    actuator, mode = drives[0].actuator, drives[0].mode
    count = actuator.motors
    springs = _Springs(joints, drives, references)
    limits = np.array([drive.values.get("max_deflection", math.pi) for drive in drives])
    goals = np.array([drive.goals(values)[:count] for drive, values in zip(drives, references, strict=True)])
    centre = goals.mean(axis=1)
    spread = np.zeros(len(own)) if mode.direct else np.abs(goals - centre[:, None]).max(axis=(1, 2))
    offset = np.abs(centre[:, 0] - [joint.initial_position for joint in joints])
    change = np.abs(np.diff(centre)).max(axis=1, initial=0.0)
    if mode.motor:
        pull, speed = (np.array([max(getattr(drive, name)) for drive in drives]) for name in ("max_torque", "max_velocity"))
        if mode.direct:
            torques = [
                [electric.torque_of(np.abs(goal)).max() for electric, goal in zip(drive.electric, values, strict=True)]
                for drive, values in zip(drives, goals, strict=True)
            ]
            pull = np.minimum(pull, np.max(torques, axis=1))
            spread = _largest_below(springs.torque, pull, limits)
        else:
            standing = offset < STANDING
            speed[standing] = np.minimum(speed, OVERSHOOT * change / interval)[standing]
        pretension = [spread[:, None], *[-spread[:, None]] * (count - 1)]
        stored = springs.largest(springs.energy, np.zeros((len(own), 1)), pretension)

        def absorbed(deflection: Array) -> Array:
            """Energy in J that pretensioned springs absorb when the link moves by `deflection`."""
            energy = springs.largest(springs.energy, -deflection, pretension)
            return energy - stored

        # The link moves until the springs have absorbed its kinetic energy.
        moved = _largest_below(absorbed, 0.5 * inertias * speed * speed, limits)
        reached = springs.torque(np.minimum(spread + moved, limits)[:, None])[:, 0]
        bound = np.minimum(reached, OVERSHOOT * pull)
    else:
        bound = springs.torque(np.minimum(spread + np.maximum(offset, change), limits)[:, None])[:, 0]
    reach = _largest_below(springs.torque, bound + OVERSHOOT * loads, limits)
    grid = [list(places) for places in zip(*product(np.linspace(-1.0, 1.0, PLACES).tolist(), repeat=count), strict=True)]
    deflections = [reach[:, None] * places for places in grid]
    largest: Array = springs.largest(actuator.stiffness, np.zeros_like(deflections[0]), deflections).max(axis=1)
    return largest


class _Springs:
    """Springs of joints with the same actuator. Deflections and results are (joints, n)."""

    def __init__(self, joints: Sequence[SteppedJoint], drives: Sequence[Drive], references: Array) -> None:
        actuator, mode = drives[0].actuator, drives[0].mode
        self.energy = energy_law(actuator)
        self._torques, self._motors = actuator.elastic_torques, actuator.motors
        presets = np.zeros(len(joints))
        # The released code moves an adjuster by a motor and, in mode 4, by a torque. The range of this adjuster is then not
        # known in advance.
        if actuator.adjuster and not (joints[0].stepping.released and mode.direct):
            column = references[:, 1]
            presets = np.take_along_axis(column, np.abs(column).argmax(axis=1)[:, None], axis=1)[:, 0]
        self._rest = [presets[:, None]] * (joints[0].positions - actuator.motors)
        self._elastic = tuple(np.array(values)[:, None] for values in zip(*(drive.elastic for drive in drives), strict=True))

    def largest(self, law: Callable[..., Any], link: Array, motors: Sequence[Array]) -> Array:
        """Largest magnitude of the values of a law with link and motors at these positions; infinite where a value is not
        finite."""
        values = np.abs(over_arrays(law)(link, *motors, *self._rest, self._elastic))
        values = np.where(np.isfinite(values), values, np.inf)
        return values if values.ndim == link.ndim else values.max(axis=0)

    def torque(self, deflection: Array) -> Array:
        """Largest torque in N m of a spring that is deflected in one direction or the other."""
        both = np.hstack([deflection, -deflection])
        one, other = np.hsplit(self.largest(self._torques, np.zeros_like(both), [both] * self._motors), 2)
        return np.maximum(one, other)


def _largest_below(law: Callable[[Array], Array], bounds: Array, limits: Array) -> Array:
    """Largest deflections (joints,), at most `limits`, at which a monotone law (joints, n) -> (joints, n) is below `bounds`."""
    low, width = np.zeros_like(limits), limits.copy()
    free = law(limits[:, None])[:, 0] <= bounds
    for _ in range(ROUNDS):
        width = width / PARTS
        above = ~(law(low[:, None] + width[:, None] * np.arange(1.0, PARTS)) <= bounds[:, None])
        # The end of the last part need not be evaluated, since the law exceeds its bound there or `free` is true.
        low = low + width * np.where(above.any(axis=1), above.argmax(axis=1), PARTS - 1)
    return np.where(bounds <= 0.0, 0.0, np.where(free, limits, low + width))
