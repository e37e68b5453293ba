"""Energy of springs and motors: what the motors did, what was lost in them, and what they hold."""

from __future__ import annotations

import copy
from collections.abc import Callable
from functools import reduce
from typing import Any

import numpy as np

from asrsim.actuators.hysteresis import dahl_energies
from asrsim.actuators.vectorised import energy_over_arrays, over_arrays
from asrsim.samples import Array
from asrsim.simulation.groups import MOTOR_1, MOTOR_2, Group

POSITION, VELOCITY, TORQUE, APPLIED, DAMPING, SPRING_1, SPRING_2 = 0, 1, 2, 3, 4, 5, 6
"""Columns of the raw record (:data:`asrsim.simulation.substep.RAW`)."""
FLOWS = 7
"""Kinds of energy that a joint's springs give or take."""
WORK, LOST, DAMPED, LINK, CUT, HEAT, LAGGED = range(FLOWS)
"""Work of the motors, losses in them, by the link's damping, work on the link, taken by the effort limit, heat of windings,
lost in hysteresis: J since the start."""
MOTOR_VALUES = ("inertia", "damping", "min_position", "max_position")
"""Parameters of a motor that its balance needs, beside its greatest speed."""
FULL = 1.0 - 1e-9
"""Share of its greatest speed at which a motor is held."""

Twice = Callable[[int], Array]
"""Twice the means over the steps (joints, n) of a column: times half of what moved it is work."""


def change(values: Array) -> Array:
    """From row to row: of arrays (joints, n + 1), (joints, n)."""
    return values[:, 1:] - values[:, :-1]


def within(values: Array, low: Any, high: Any) -> bool:
    """Whether all of (joints, n) are between their limits, numbers or (joints, 1): what is asked often is seldom otherwise."""
    if isinstance(low, float) and isinstance(high, float):
        return bool(values.max() < high and values.min() > low)
    return bool(((values.max(axis=1, keepdims=True) < high) & (values.min(axis=1, keepdims=True) > low)).all())


class SpringMeter:
    """Springs and motors of a group of joints; arrays are (joints, n), raw records (columns, joints, n + 1)."""

    def __init__(self, group: Group, substep: float) -> None:
        self.group = group
        self.substep = substep
        self._law = energy_over_arrays(group.actuator)
        self._elastic = group.elastic
        self._held = [np.zeros((len(group.drives), 1), dtype=bool) for _ in range(group.motors)]
        """Whether each motor was held at the row before."""
        self.electric = any(drive.electric_motors for drive in group.drives)
        self._bristles = any(drive.hysteresis for drive in group.drives)
        # Where motors have no dynamics their work follows from the energy's changes.
        self._changes = not group.motors or group.actuator.adjuster
        self._torques = over_arrays(group.actuator.elastic_torques)
        self._motors = [
            (
                *(group.value(f"motor_{index}_{name}") for name in MOTOR_VALUES),
                FULL * group.value(f"motor_{index}_max_velocity"),
            )
            for index in range(1, group.motors + 1)
        ]

    def twin(self) -> SpringMeter:
        """The same, going on from here."""
        twin = copy.copy(self)
        twin._held = list(self._held)
        return twin

    def balance(
        self, beyond: Array, twice: Twice, half: Array, released: Array, cut: Array, ends: Any
    ) -> tuple[Array, Array, Array, dict[int, Array]]:
        """Work of the motors over the steps, energy in springs and in motors where it counts, and losses over the steps by
        flow, all in J.

        beyond: raw records (columns, joints, n + 2); half: rad, of what the links moved; released: J that the springs gave;
        cut (n,): steps in which an input jumps; ends: rows at which energies count.
        """
        raw = beyond[:, :, :-1]
        flows: dict[int, Array] = {}
        places = raw[POSITION], raw[MOTOR_1], raw[MOTOR_2]
        absorbed: Any = 0.0
        pushed: Any = 0.0
        if self._changes or self._bristles:
            energy = self._energy(*places)
            if self._bristles:
                kept, flows[LAGGED], pushed = self._hysteresis(raw)
                energy = energy + kept
            absorbed = change(energy) + flows.get(LAGGED, 0.0)
            stored = energy[:, ends]
        else:
            stored = self._energy(*(place[:, ends] for place in places))
        if not self.group.motors:
            return self._ideal(raw, cut, released + absorbed, pushed), stored, np.zeros_like(stored), flows
        motors = [self._motor(index, beyond, twice, ends) for index in range(1, self.group.motors + 1)]
        work, flows[LOST], kinetic = (reduce(np.add, parts) for parts in zip(*motors, strict=True))
        if self.group.actuator.adjuster:
            work = work + self._adjuster(raw, cut, twice(SPRING_1), absorbed, half)
        return work, stored, kinetic, flows

    def _hysteresis(self, raw: Array) -> tuple[Array, Array, Array]:
        """Energy in the springs' hysteresis, loss in it over the steps, and work of the motors' motion on it, in J."""
        q, group = raw[POSITION], self.group
        level, length = group.value("hysteresis_torque"), group.value("hysteresis_deflection")
        plain = self._torques(q, raw[MOTOR_1], raw[MOTOR_2], self._elastic)
        kept: Array = np.zeros_like(q)
        lost = np.zeros_like(q[:, 1:])
        pushed = np.zeros_like(lost)
        for i, (motor, spring) in enumerate(((MOTOR_1, SPRING_1), (MOTOR_2, SPRING_2))[: group.actuator.motors]):
            torque = raw[spring] - plain[i]
            stored, loss = dahl_energies(torque, raw[motor] - q, level, length)
            kept, lost = kept + stored, lost + loss
            pushed += 0.5 * (torque[:, 1:] + torque[:, :-1]) * change(raw[motor])
        return kept, lost, pushed

    def heat(self, raw: Array) -> Array:
        """J of the windings over the steps; raw: (columns, all joints, n + 1)."""
        total: Any = 0.0
        found = self.group.electricity(raw)
        for i in range(1, self.group.motors + 1):
            power = self.group.value(f"motor_{i}_resistance") * np.nan_to_num(found[f"motor_{i}_current"]) ** 2
            total = total + 0.5 * self.substep * (power[:, 1:] + power[:, :-1])
        return np.asarray(total)

    def _energy(self, q: Array, theta_1: Array, theta_2: Array) -> Array:
        return self._law(q, theta_1, theta_2, self._elastic)

    def _motor(self, index: int, beyond: Array, twice: Twice, ends: Any) -> tuple[Array, Array, Array]:
        """Work of motor `index` and what it lost over the steps, and its kinetic energy where it counts, in J."""
        base = MOTOR_1 if index == 1 else MOTOR_2
        places, speeds = beyond[base], beyond[base + 1]
        position, velocity = places[:, :-1], speeds[:, :-1]
        inertia, damping, low, high, fastest = self._motors[index - 1]
        half = change(position)
        half *= 0.5
        work = twice(base + 2)
        work *= half
        lost = twice(base + 3)
        lost += (4.0 * damping / self.substep) * half
        lost *= half
        before = self._held[index - 1]
        if before.any() or not (within(places, low, high) and within(speeds, -fastest, fastest)):
            # A stop and a speed limit take what is left over: the shock, and the torque that they hold. A kick that a limit
            # cuts short shows in its own row or in those beside it.
            held = (places >= high) | (places <= low) | (np.abs(speeds) >= fastest)
            self._held[index - 1] = held[:, -3:-2]
            near = held[:, :-2] | held[:, 1:-1] | held[:, 2:]
            near[:, 1:] |= held[:, :-3]
            near[:, :1] |= before
            spring = twice(SPRING_1 if index == 1 else SPRING_2) * half
            lost = np.where(near, work - spring - change((0.5 * inertia) * (velocity * velocity)), lost)
        counted = velocity[:, ends]
        return work, lost, (0.5 * inertia) * (counted * counted)

    def _ideal(self, raw: Array, cut: Array, absorbed: Array, pushed: Any) -> Array:
        """Work in J of motors that are where they should be: the energy's change by their motion, link at its mean place.

        In a step in which they jump (cut) their work is what the rest has absorbed, in J. pushed: their work on the hysteresis.
        """
        q, theta_1, theta_2 = raw[POSITION], raw[MOTOR_1], raw[MOTOR_2]
        middle = 0.5 * (q[:, :-1] + q[:, 1:])
        before = self._energy(middle, theta_1[:, :-1], theta_2[:, :-1])
        return np.asarray(np.where(cut, absorbed, self._energy(middle, theta_1[:, 1:], theta_2[:, 1:]) - before + pushed))

    def _adjuster(self, raw: Array, cut: Array, spring: Array, absorbed: Array, half: Array) -> Array:
        """Work in J of an adjuster, which is where it should be: the energy's change by its motion at fixed deflection."""
        q, theta, lever = raw[POSITION], raw[MOTOR_1], raw[MOTOR_2]
        middle, motor = 0.5 * (q[:, :-1] + q[:, 1:]), 0.5 * (theta[:, :-1] + theta[:, 1:])
        work = self._energy(middle, motor, lever[:, 1:]) - self._energy(middle, motor, lever[:, :-1])
        # In a step in which it jumps its work is what spring, link and motor have absorbed.
        return np.asarray(np.where(cut, absorbed + spring * (half - 0.5 * change(theta)), work))
