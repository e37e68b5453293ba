"""Where the energy goes: work of the motors, stored in springs, lost, given to the link; and what does not add up.

The sums are of second order in the step, so with the default stepping the residual falls as h^2; in a run that is
not resolved it does not, and that is how divergence shows before any number overflows.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from asrsim.actuators.hysteresis import dahl_energies
from asrsim.actuators.vectorised import energy_over_arrays, over_arrays
from asrsim.samples import Array
from asrsim.simulation.drives import SteppedJoint
from asrsim.simulation.groups import MOTOR_1, MOTOR_2, Group

POSITION, VELOCITY, TORQUE, APPLIED, DAMPING, SPRING_1, SPRING_2 = 0, 1, 2, 3, 4, 5, 6
"""Columns of the raw record (:data:`asrsim.simulation.substep.RAW`)."""
FLOWS = 7
WORK, LOST, DAMPED, LINK, CUT, HEAT, LAGGED = range(FLOWS)
"""Work of the motors, losses in them, by the link's damping, work on the link, taken by the effort limit, heat of windings,
lost in hysteresis: J since the start."""
FLOW_OF = {
    "motor_work": WORK, "friction_loss": LOST, "damping_loss": DAMPED, "link_work": LINK, "limit_loss": CUT,
    "winding_loss": HEAT, "hysteresis_loss": LAGGED,
}  # fmt: skip
ENERGIES = (*FLOW_OF, "spring_energy", "energy_residual")
"""Quantities that a meter gives."""

MOTOR_VALUES = ("inertia", "damping", "min_position", "max_position", "max_velocity")
"""Parameters of a motor that its balance needs."""

Mean = Callable[[int], Array]
"""Means over the steps (joints, n) of a column."""


def _change(values: Array) -> Array:
    """From row to row: of arrays (joints, n + 1), (joints, n)."""
    return values[:, 1:] - values[:, :-1]


class EnergyMeter:
    """Running energies of each joint in J since the start."""

    def __init__(self, drives: Sequence[SteppedJoint], groups: Sequence[Group], substep: float, *, whole: bool) -> None:
        """groups: of the joints with springs; whole: energies of every row are asked for, not only the balance at the last."""
        self._rows = slice(None) if whole else slice(-1, None)
        self._springs = [_Springs(group, substep, whole=whole) for group in groups]
        joints = len(drives)
        self._stiffness = np.array([[drive.passive_stiffness] for drive in drives])
        self._rests = np.array([[drive.joint.spring_reference] for drive in drives])
        self._sprung = np.array([[bool(drive.mode and drive.mode.spring)] for drive in drives])
        self._totals = np.zeros((FLOWS, joints))
        self._start: Array | None = None
        self.turnover = np.zeros(joints)
        """J: energy that went through each joint, the scale of a residual."""
        self.residual = np.zeros(joints)
        """J that vanished in each actuator, at the last row; negative where a spring gave more than it held."""
        self.given = np.zeros(joints)
        """J: work of actuators and external torques on the links, less what their damping took, up to the last row."""

    def __deepcopy__(self, memo: Any) -> EnergyMeter:
        """A meter that goes on from here: what never changes is shared."""
        twin = copy.copy(self)
        twin.turnover, twin.residual, twin.given = self.turnover.copy(), self.residual.copy(), self.given.copy()
        twin._springs = [springs.twin() for springs in self._springs]
        return twin

    @staticmethod
    def quantities(drive: SteppedJoint) -> tuple[str, ...]:
        """What a joint has of it."""
        if drive.mode is None:
            return ()
        names = ["motor_work", "link_work"]
        if drive.mode.spring:
            names += ["spring_energy", "energy_residual"]
            if drive.joint.effort is not None:
                names += ["limit_loss"]
        if drive.dynamic_motors:
            names += ["friction_loss"]
        if any(drive.values[f"motor_{i}_resistance"] for i in drive.electric_motors):
            names += ["winding_loss"]
        if drive.hysteresis is not None:
            names += ["hysteresis_loss"]
        if drive.joint.damping or drive.link_damping:
            names += ["damping_loss"]
        return tuple(names)

    def add(self, raw: Array, ahead: Array, *, external: Array, sides: Mapping[int, Array]) -> dict[str, Array]:
        """Energies (joints, n) at the rows of raw (columns, joints, n + 1) but for the last; (joints, 1) at the end, if that
        will do.

        ahead: the row after those, (columns, joints, 1); external: torques (joints, n + 1); sides: means over the two halves
        of a kick that an input cuts, by row of `raw`: what pushes jumps, and the trapezoid rule must not go across.
        """
        joints, n = raw.shape[1], raw.shape[2] - 1
        cut = np.zeros(n, dtype=bool)
        for row in sides:
            cut[max(row - 1, 0) : row + 1] = True

        def mean(values: Array, column: int, pick: Any = slice(None)) -> Array:
            """Means (joints, n) over the steps between rows of `values` (joints, n + 1), `column` of the sides."""
            means = values[:, :-1] + values[:, 1:]
            means *= 0.5
            for row, (before, after) in sides.items():
                if row < n:
                    means[:, row] += 0.5 * (after[pick, column] - values[:, row])
                if row:
                    means[:, row - 1] += 0.5 * (before[pick, column] - values[:, row])
            return means

        def pushed(pick: Any, column: int) -> Array:
            return mean(raw[column, pick], column, pick)

        moved = _change(raw[POSITION])
        link = mean(raw[APPLIED], APPLIED)
        running = np.zeros((FLOWS, joints, n + 1))
        running[:, :, 0] = self._totals
        flows = running[:, :, 1:]
        if (raw[TORQUE] != raw[APPLIED]).any():
            np.multiply(mean(raw[TORQUE], TORQUE) - link, moved, out=flows[CUT])
        link *= moved
        pushed_in = mean(external, -1)
        if self._stiffness.any():
            middle = 0.5 * (raw[POSITION, :, :-1] + raw[POSITION, :, 1:])
            pushed_in += self._stiffness * (self._rests - middle)
        pushed_in *= moved
        flows[WORK] = flows[LINK] = link
        if raw[DAMPING].any():
            np.multiply(mean(raw[DAMPING], DAMPING), -moved, out=flows[DAMPED])
        self.given += (link + pushed_in - flows[DAMPED]).sum(axis=1)
        stored = np.zeros((joints, n))
        kinetic = np.zeros((joints, n))
        for springs in self._springs:
            pick = springs.group.pick
            flows[WORK, pick], flows[LOST, pick], stored[pick], kinetic[pick], flows[LAGGED, pick] = springs.balance(
                raw[:, pick], ahead[:, pick], partial(pushed, pick), moved[pick], link[pick] + flows[CUT, pick], cut
            )
            if springs.electric:
                flows[HEAT, pick] = springs.heat(raw)
        through = np.abs(flows[WORK]) + np.abs(link) + np.abs(pushed_in)
        turnover = through.sum(axis=1)
        self.turnover += np.nansum(through, axis=1) if np.isnan(turnover).any() else turnover
        for kind in running:
            if kind[:, 1:].any():
                np.cumsum(kind, axis=1, out=kind)
            else:
                # Most robots have no effort limit in their way, and many no damping: those sums stay as they are.
                kind[:, 1:] = kind[:, :1]
        self._totals = running[:, :, -1].copy()
        if self._start is None:
            self._start = (stored[:, 0] + kinetic[:, 0])[:, None]
        at, stored, kinetic = running[:, :, :-1][:, :, self._rows], stored[:, self._rows], kinetic[:, self._rows]
        residual = at[WORK] - at[LOST] - at[LINK] - self._sprung * at[CUT] - at[LAGGED] - (stored + kinetic - self._start)
        self.residual = residual[:, -1].copy()
        return {name: at[flow] for name, flow in FLOW_OF.items()} | {"spring_energy": stored, "energy_residual": residual}


class _Springs:
    """Springs and motors of a group of joints; arrays are (joints, n), raw records (columns, joints, n + 1)."""

    def __init__(self, group: Group, substep: float, *, whole: bool) -> None:
        self.group = group
        self.substep = substep
        self._law = energy_over_arrays(group.actuator)
        self._elastic = group.elastic
        self._held = [np.zeros((len(group.drives), 1), dtype=bool) for _ in range(group.motors)]
        """Whether each motor was held at the row before."""
        self.electric = any(drive.electric_motors for drive in group.drives)
        self._bristles = any(drive.hysteresis for drive in group.drives)
        # Where motors have no dynamics their work follows from the energy's changes.
        self._whole = whole or self._bristles or not group.motors or group.actuator.adjuster
        self._torques = over_arrays(group.actuator.elastic_torques)
        self._motors = [
            tuple(group.value(f"motor_{index}_{name}") for name in MOTOR_VALUES) for index in range(1, group.motors + 1)
        ]

    def twin(self) -> _Springs:
        """The same, going on from here."""
        twin = copy.copy(self)
        twin._held = list(self._held)
        return twin

    def balance(
        self, raw: Array, ahead: Array, mean: Mean, moved: Array, released: Array, cut: Array
    ) -> tuple[Array, Array, Array, Array, Array]:
        """Work of the motors and losses over the steps, energy in springs and motors at their starts, losses in hysteresis, all
        in J.

        moved: rad of the links; released: J that the springs gave; cut (n,): steps in which an input jumps.
        """
        # Of springs with motors only the ends of a block count, unless all rows are asked for.
        ends = slice(None) if self._whole else [0, -2]
        energy: Array = np.zeros_like(raw[POSITION])
        energy[:, ends] = self._energy(*(raw[column][:, ends] for column in (POSITION, MOTOR_1, MOTOR_2)))
        lost: Array = np.zeros_like(released)
        damped: Array = np.zeros_like(released)
        pushed: Array = damped
        if self._bristles:
            kept, damped, pushed = self._hysteresis(raw)
            energy = energy + kept
        if not self.group.motors:
            ideal = self._ideal(raw, cut, released + _change(energy) + damped, pushed)
            return ideal, lost, energy[:, :-1], np.zeros_like(released), damped
        work: Array = np.zeros_like(released)
        kinetic: Array = np.zeros_like(released)
        for index in range(1, self.group.motors + 1):
            motor_work, motor_loss, motion = self._motor(index, raw, ahead, mean)
            work += motor_work
            lost += motor_loss
            kinetic += motion
        if self.group.actuator.adjuster:
            work += self._adjuster(raw, cut, mean(SPRING_1), _change(energy) + damped, moved)
        return work, lost, energy[:, :-1], kinetic, damped

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
            pushed += 0.5 * (torque[:, 1:] + torque[:, :-1]) * _change(raw[motor])
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

    def _motor(self, index: int, raw: Array, ahead: Array, mean: Mean) -> tuple[Array, Array, Array]:
        """Work of motor `index`, what it lost over the steps, and its kinetic energy at their starts, in J."""
        base = MOTOR_1 if index == 1 else MOTOR_2
        position, velocity = raw[base], raw[base + 1]
        inertia, damping, low, high, fastest = self._motors[index - 1]
        moved = _change(position)
        work = mean(base + 2) * moved
        kinetic = (0.5 * inertia) * (velocity * velocity)
        lost = (mean(base + 3) + (damping / self.substep) * moved) * moved
        # A stop and a speed limit take what is left over: the shock, and the torque that they hold. A kick that a limit cuts
        # short shows in its own row or in those beside it.
        places = np.concatenate([position, ahead[base]], axis=1)
        speeds = np.concatenate([velocity, ahead[base + 1]], axis=1)
        held = (places >= high) | (places <= low) | (np.abs(speeds) >= fastest * (1.0 - 1e-9))
        before = self._held[index - 1]
        self._held[index - 1] = held[:, -3:-2]
        if held.any() or before.any():
            near = held[:, :-2] | held[:, 1:-1] | held[:, 2:]
            near[:, 1:] |= held[:, :-3]
            near[:, :1] |= before
            spring = mean(SPRING_1 if index == 1 else SPRING_2) * moved
            lost = np.where(near, work - spring - _change(kinetic), lost)
        return work, lost, kinetic[:, :-1]

    def _ideal(self, raw: Array, cut: Array, absorbed: Array, pushed: Array) -> Array:
        """Work in J of motors that are where they should be: the energy's change by their motion, link at its mean place.

        In a step in which they jump (cut) their work is what the rest has absorbed, in J. pushed: their work on the hysteresis.
        """
        q, theta_1, theta_2 = raw[POSITION], raw[MOTOR_1], raw[MOTOR_2]
        middle = 0.5 * (q[:, :-1] + q[:, 1:])
        before = self._energy(middle, theta_1[:, :-1], theta_2[:, :-1])
        return np.asarray(np.where(cut, absorbed, self._energy(middle, theta_1[:, 1:], theta_2[:, 1:]) - before + pushed))

    def _adjuster(self, raw: Array, cut: Array, spring: Array, change: Array, moved: Array) -> Array:
        """Work in J of an adjuster, which is where it should be: the energy's change by its motion at fixed deflection."""
        q, theta, place = raw[POSITION], raw[MOTOR_1], raw[MOTOR_2]
        middle, motor = 0.5 * (q[:, :-1] + q[:, 1:]), 0.5 * (theta[:, :-1] + theta[:, 1:])
        work = self._energy(middle, motor, place[:, 1:]) - self._energy(middle, motor, place[:, :-1])
        # In a step in which it jumps its work is what spring, link and motor have absorbed.
        return np.asarray(np.where(cut, change + spring * (moved - _change(theta)), work))
