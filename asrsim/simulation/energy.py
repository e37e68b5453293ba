"""Where the energy goes: work of the motors, stored in springs, lost, given to the link; and what does not add up.

The sums are of second order in the step, so with the default stepping the residual falls as h^2; in a run that is
not resolved it does not, and that is how divergence shows before any number overflows.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from asrsim.samples import Array
from asrsim.simulation.drives import SteppedJoint
from asrsim.simulation.groups import Group
from asrsim.simulation.spring_meter import (
    APPLIED,
    CUT,
    DAMPED,
    DAMPING,
    FLOWS,
    HEAT,
    LAGGED,
    LINK,
    LOST,
    POSITION,
    TORQUE,
    WORK,
    SpringMeter,
    change,
)  # fmt: skip

FLOW_OF = {
    "motor_work": WORK, "friction_loss": LOST, "damping_loss": DAMPED, "link_work": LINK, "limit_loss": CUT,
    "winding_loss": HEAT, "hysteresis_loss": LAGGED,
}  # fmt: skip
ENERGIES = (*FLOW_OF, "spring_energy", "energy_residual")
"""Quantities that a meter gives."""


class EnergyMeter:
    """Running energies of each joint in J since the start."""

    def __init__(self, drives: Sequence[SteppedJoint], groups: Sequence[Group], substep: float, *, whole: bool) -> None:
        """groups: of the joints with springs; whole: energies are asked for, not only the balance at the last row."""
        self._whole = whole
        self._springs = [SpringMeter(group, substep) for group in groups]
        joints = len(drives)
        self._stiffness = np.array([[drive.joint.spring_stiffness] for drive in drives])
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
        twin._totals = self._totals.copy()
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

    def add(self, beyond: Array, logged: slice, *, external: Array, sides: Mapping[int, Array]) -> dict[str, Array]:
        """Energies (joints, m) at the logged ones of n rows, if they are asked for.

        beyond: raw records of those and of two rows beyond, (columns, joints, n + 2); external: torques (joints, n + 1); sides:
        means over the two halves of a kick that an input cuts, by row: what pushes jumps, and the trapezoid rule must not go
        across.
        """
        raw = beyond[:, :, :-1]
        joints, n = raw.shape[1], raw.shape[2] - 1
        asked = range(*logged.indices(n)) if self._whole else range(1)
        # What springs and motors hold counts where it is asked for, and in the balance at the end.
        ends: Any = slice(None, -1) if len(asked) == n else [*asked, n - 1]
        cut = np.zeros(n, dtype=bool)
        for row in sides:
            cut[max(row - 1, 0) : row + 1] = True

        def twice(values: Array, column: int, pick: Any = slice(None)) -> Array:
            """Twice the means (joints, n) over the steps between rows of `values` (joints, n + 1), `column` of the sides."""
            sums = values[:, :-1] + values[:, 1:]
            for row, (before, after) in sides.items():
                if row < n:
                    sums[:, row] += after[pick, column] - values[:, row]
                if row:
                    sums[:, row - 1] += before[pick, column] - values[:, row]
            return sums

        def pushed(pick: Any, column: int) -> Array:
            return twice(raw[column, pick], column, pick)

        half = change(raw[POSITION])
        half *= 0.5
        link = twice(raw[APPLIED], APPLIED)
        # Only what flows in these rows: most robots have no effort limit in their way, and many no damping.
        flows: dict[int, Array] = {}
        halves = list(sides.values())
        if any((table[TORQUE] != table[APPLIED]).any() for table in (raw, *(half.T for half in halves))):
            flows[CUT] = (twice(raw[TORQUE], TORQUE) - link) * half
        link *= half
        given, pushed_in = link, None
        if self._stiffness.any() or external.any() or any(half[:, :, -1].any() for half in halves):
            pushed_in = twice(external, -1)
            if self._stiffness.any():
                middle = 0.5 * (raw[POSITION, :, :-1] + raw[POSITION, :, 1:])
                pushed_in += (2.0 * self._stiffness) * (self._rests - middle)
            pushed_in *= half
            given = given + pushed_in
        if raw[DAMPING].any():
            flows[DAMPED] = twice(raw[DAMPING], DAMPING) * -half
            given = given - flows[DAMPED]
        self.given += given.sum(axis=1)
        work = link.copy()
        stored, kinetic = np.zeros((2, joints, raw[0, 0, ends].size))
        for springs in self._springs:
            pick = springs.group.pick
            released = link[pick] + flows[CUT][pick] if CUT in flows else link[pick]
            work[pick], stored[pick], kinetic[pick], losses = springs.balance(
                beyond[:, pick], partial(pushed, pick), half[pick], released, cut, ends
            )
            if springs.electric:
                losses[HEAT] = springs.heat(raw)
            for flow, loss in losses.items():
                flows.setdefault(flow, np.zeros((joints, n)))[pick] = loss
        self._turn_over([work, link] if pushed_in is None else [work, link, pushed_in])
        flows |= {WORK: work, LINK: link}
        at = [self._sum(flow, flows.get(flow), n, ends) for flow in range(FLOWS)]
        if self._start is None:
            self._start = (stored[:, 0] + kinetic[:, 0])[:, None]
        residual = self._vanished(at, stored + kinetic - self._start)
        self.residual = residual[:, -1].copy()
        found = {name: at[flow] for name, flow in FLOW_OF.items()} | {"spring_energy": stored, "energy_residual": residual}
        return {name: values[:, : len(asked)] for name, values in found.items()}

    def _turn_over(self, flows: Sequence[Array]) -> None:
        """Flows (joints, n) in J have gone through."""
        through = np.abs(flows[0])
        for flow in flows[1:]:
            through += np.abs(flow)
        turnover = through.sum(axis=1)
        self.turnover += np.nansum(through, axis=1) if np.isnan(turnover).any() else turnover

    def _vanished(self, at: Sequence[Array], held: Array) -> Array:
        """(joints, n) J, of the flows and of what springs and motors hold, both since the start."""
        residual = at[WORK] - at[LOST]
        residual -= at[LINK]
        if self._totals[CUT].any():
            residual -= self._sprung * at[CUT]
        if self._totals[LAGGED].any():
            residual -= at[LAGGED]
        residual -= held
        return residual

    def _sum(self, flow: int, values: Array | None, n: int, ends: Any) -> Array:
        """J since the start at the rows `ends` of n + 1, of what flows from each to the next; None: nothing does."""
        total = self._totals[flow].copy()
        if values is None:
            return np.broadcast_to(total[:, None], (len(total), np.arange(n + 1)[ends].size))
        if not self._whole:
            last = total + values[:, :-1].sum(axis=1)
            self._totals[flow] = last + values[:, -1]
            return np.asarray(last[:, None])
        running = np.empty((len(values), values.shape[1] + 1))
        running[:, 0] = total
        values[:, 0] += total
        np.cumsum(values, axis=1, out=running[:, 1:])
        self._totals[flow] = running[:, -1]
        return running[:, ends]
