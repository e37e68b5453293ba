"""Energy of springs and motors: what the motors did, what was lost in them, and what they hold."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from asrsim.actuators.hysteresis import dahl_energies
from asrsim.actuators.vectorised import energy_over_arrays, over_arrays
from asrsim.samples import Array
from asrsim.simulation.flows import (
    CUT,
    DRIVE,
    FRICTION,
    HEAT,
    LAGGED,
    LINK,
    LOST,
    POSITION,
    SPEED,
    SPRING_1,
    SPRING_2,
    WORK,
    held,
)
from asrsim.simulation.groups import MOTOR_1, MOTOR_2, Group


def change(values: Array) -> Array:
    """From row to row: of arrays (joints, n + 1), (joints, n)."""
    return values[:, 1:] - values[:, :-1]


class SpringMeter:
    """Springs and motors of a group of joints; arrays are (joints, n), raw records (columns, joints, n + 1)."""

    def __init__(self, group: Group, motors: Array, substep: float) -> None:
        """motors: numbers of the group's, (2, joints, 6), as :func:`asrsim.simulation.flows.constants_of` has them."""
        self.group = group
        self.substep = substep
        self._law = energy_over_arrays(group.actuator)
        self._elastic = group.elastic
        self._limits = motors.transpose(0, 2, 1)[:, :, :, None]
        self._held = np.zeros((group.motors, len(group.drives), 1), dtype=bool)
        """Whether each motor was held at the row before."""
        self._electric = any(drive.electric_motors for drive in group.drives)
        self._bristles = any(drive.hysteresis for drive in group.drives)
        self.rare = self._electric or self._bristles
        """Whether there is more to it than what every spring and motor has."""
        # Where motors have no dynamics their work follows from the energy's changes.
        self._changes = not group.motors or group.actuator.adjuster
        self._torques = over_arrays(group.actuator.elastic_torques)
        self._inertias = [group.value(f"motor_{index}_inertia") for index in range(1, group.motors + 1)]

    def twin(self) -> SpringMeter:
        """The same, going on from here."""
        return copy.copy(self)

    def balance(
        self, beyond: Array, flows: Array, sides: Mapping[int, Array], jumps: Sequence[int], ends: Any, *, held: bool
    ) -> tuple[Array, Any]:
        """Energy in J of springs and of motors where it counts; `flows` are put right where they are not those of every motor.

        beyond: raw records (columns, all joints, n + 2); jumps: steps in which an input jumps, with `sides` as in
        :meth:`asrsim.simulation.energy.EnergyMeter.add`; ends: rows at which energies count; held: a motor is at a limit.
        """
        pick = self.group.pick
        beyond = beyond[:, pick]
        sides = {row: both[:, pick] for row, both in sides.items()}
        raw = beyond[:, :, :-1]
        places = raw[POSITION], raw[MOTOR_1], raw[MOTOR_2]
        absorbed: Any = 0.0
        pushed: Any = 0.0
        if self._changes or self._bristles:
            energy = self._energy(*places)
            if self._bristles:
                kept, flows[LAGGED, pick], pushed = self._hysteresis(raw)
                energy = energy + kept
                absorbed = flows[LAGGED, pick]
            absorbed = change(energy) + absorbed
            stored = energy[:, ends]
        else:
            stored = self._energy(*(place[:, ends] for place in places))
        cut = np.zeros(raw.shape[2] - 1, dtype=bool)
        cut[jumps] = True
        if not self.group.motors:
            released = flows[LINK, pick] + flows[CUT, pick]
            flows[WORK, pick] = self._ideal(raw, cut, released + absorbed, pushed)
            return stored, 0.0
        if held or self._held.any():
            self._stop(beyond, flows, sides)
        if self.group.actuator.adjuster:
            flows[WORK, pick] += self._adjuster(raw, cut, _twice(raw, SPRING_1, sides), absorbed)
        if self._electric:
            flows[HEAT, pick] = self._heat(raw)
        speeds = (raw[motor + SPEED][:, ends] for motor in (MOTOR_1, MOTOR_2))
        kinetic: Any = 0.0
        for inertia, speed in zip(self._inertias, speeds, strict=False):
            kinetic = kinetic + (0.5 * inertia) * (speed * speed)
        return stored, kinetic

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

    def _heat(self, raw: Array) -> Array:
        """J of the windings over the steps."""
        total: Any = 0.0
        found = self.group.electricity(raw)
        for i in range(1, self.group.motors + 1):
            power = self.group.value(f"motor_{i}_resistance") * np.nan_to_num(found[f"motor_{i}_current"]) ** 2
            total = total + 0.5 * self.substep * (power[:, 1:] + power[:, :-1])
        return np.asarray(total)

    def _energy(self, q: Array, theta_1: Array, theta_2: Array) -> Array:
        return self._law(q, theta_1, theta_2, self._elastic)

    def _stop(self, beyond: Array, flows: Array, sides: Mapping[int, Array]) -> None:
        """Put right what motors lose at their stops and limits of speed.

        These take what is left over: the shock, and the torque that they hold. A kick that a limit cuts short shows in its own
        row or in those beside it.
        """
        raw, total, around = beyond[:, :, :-1], np.zeros(beyond[0, :, 2:].shape), np.zeros(beyond[0, :, 2:].shape, dtype=bool)
        motors = zip((MOTOR_1, MOTOR_2), (SPRING_1, SPRING_2), self._inertias, strict=False)
        begun, self._held = self._held, self._held.copy()
        for i, (motor, spring, inertia) in enumerate(motors):
            limits, half, speed = self._limits[i], 0.5 * change(raw[motor]), raw[motor + SPEED]
            stuck = held(beyond[motor], beyond[motor + SPEED], limits)
            self._held[i] = stuck[:, -3:-2]
            near = stuck[:, :-2] | stuck[:, 1:-1] | stuck[:, 2:]
            near[:, 1:] |= stuck[:, :-3]
            near[:, :1] |= begun[i]
            left = _twice(raw, motor + DRIVE, sides) * half - _twice(raw, spring, sides) * half
            left -= change((0.5 * inertia) * (speed * speed))
            total = total + np.where(near, left, (_twice(raw, motor + FRICTION, sides) + limits[0] * half) * half)
            around |= near
        pick = self.group.pick
        flows[LOST, pick] = np.where(around, total, flows[LOST, pick])

    def _ideal(self, raw: Array, cut: Array, absorbed: Array, pushed: Any) -> Array:
        """Work in J of motors that are where they should be: the energy's change by their motion, link at its mean place.

        In a step in which they jump (cut) their work is what the rest has absorbed, in J. pushed: their work on the hysteresis.
        """
        q, theta_1, theta_2 = raw[POSITION], raw[MOTOR_1], raw[MOTOR_2]
        middle = 0.5 * (q[:, :-1] + q[:, 1:])
        before = self._energy(middle, theta_1[:, :-1], theta_2[:, :-1])
        return np.asarray(np.where(cut, absorbed, self._energy(middle, theta_1[:, 1:], theta_2[:, 1:]) - before + pushed))

    def _adjuster(self, raw: Array, cut: Array, spring: Array, absorbed: Array) -> Array:
        """Work in J of an adjuster, which is where it should be: the energy's change by its motion at fixed deflection."""
        q, theta, lever = raw[POSITION], raw[MOTOR_1], raw[MOTOR_2]
        middle, motor = 0.5 * (q[:, :-1] + q[:, 1:]), 0.5 * (theta[:, :-1] + theta[:, 1:])
        work = self._energy(middle, motor, lever[:, 1:]) - self._energy(middle, motor, lever[:, :-1])
        # In a step in which it jumps its work is what spring, link and motor have absorbed.
        return np.asarray(np.where(cut, absorbed + spring * (0.5 * change(q) - 0.5 * change(theta)), work))


def _twice(raw: Array, column: int, sides: Mapping[int, Array]) -> Array:
    """Twice the means (joints, n) over the steps between rows of a column; times half of what moved it is work."""
    values: Array = raw[column]
    sums: Array = values[:, :-1] + values[:, 1:]
    for row, (before, after) in sides.items():
        if row < sums.shape[1]:
            sums[:, row] += after[:, column] - values[:, row]
        if row:
            sums[:, row - 1] += before[:, column] - values[:, row]
    return sums
