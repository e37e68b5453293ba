"""Where the energy goes: work of the motors, stored in springs, lost, given to the link; and what does not add up.

The sums are of second order in the step, so with the default stepping the residual falls as h^2; in a run that is
not resolved it does not, and that is how divergence shows before any number overflows.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from asrsim.samples import Array
from asrsim.simulation.drives import SteppedJoint
from asrsim.simulation.flows import (
    CUT,
    DAMPED,
    FLOWS,
    GIVEN,
    HEAT,
    LAGGED,
    LINK,
    LOST,
    MEANS,
    THROUGH,
    VANISHED,
    WORK,
    Passes,
)
from asrsim.simulation.groups import Group
from asrsim.simulation.spring_meter import SpringMeter

FLOW_OF = {
    "motor_work": WORK, "friction_loss": LOST, "damping_loss": DAMPED, "link_work": LINK, "limit_loss": CUT,
    "winding_loss": HEAT, "hysteresis_loss": LAGGED,
}  # fmt: skip
ENERGIES = (*FLOW_OF, "spring_energy", "energy_residual")
"""Quantities that a meter gives."""


class EnergyMeter:
    """Running energies of each joint in J since the start."""

    def __init__(
        self, joints: int, groups: Sequence[Group], constants: tuple[Array, Array], substep: float, *, whole: bool
    ) -> None:
        """groups: of the joints with springs; constants: of :func:`.flows.constants_of`; whole: energies are asked
        for, not only the balance at the last row."""
        self._whole = whole
        self._links, self._motors = constants
        self._springs = [SpringMeter(group, self._motors[:, group.pick], substep) for group in groups]
        self._totals = np.zeros((FLOWS if any(springs.rare for springs in self._springs) else HEAT, joints))
        self._start: Array | None = None
        self.residual = np.zeros(joints)
        """J that vanished in each actuator, at the last row; negative where a spring gave more than it held."""

    @property
    def turnover(self) -> Array:
        """J: energy that went through each joint, the scale of a residual."""
        return np.array(self._totals[THROUGH])

    @property
    def given(self) -> Array:
        """J: work of actuators and external torques on the links, less what their damping took, up to the last row."""
        return np.array(self._totals[GIVEN])

    def __deepcopy__(self, memo: Any) -> EnergyMeter:
        """A meter that goes on from here: what never changes is shared."""
        twin = copy.copy(self)
        twin.residual, twin._totals = self.residual.copy(), self._totals.copy()
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

    def add(
        self, beyond: Array, logged: slice, *, external: Array, sides: Mapping[int, Array], held: Array, passes: Passes
    ) -> dict[str, Array]:
        """Energies (joints, m) at the logged ones of n rows, if they are asked for.

        beyond: raw records of those and of two rows beyond, (columns, joints, n + 2); external: torques (joints, n + 1); sides:
        means over the two halves of a kick that an input cuts, by row: what pushes jumps, and the trapezoid rule must not go
        across. held: joints of which a motor is at a limit.
        """
        raw = beyond[:, :, :-1]
        joints, n = raw.shape[1], raw.shape[2] - 1
        asked = range(*logged.indices(n)) if self._whole else range(1)
        # What springs and motors hold counts where it is asked for, and in the balance at the end.
        rows = np.arange(n) if len(asked) == n else np.array([*asked, n - 1])
        ends: Any = slice(None, -1) if len(asked) == n else rows
        flows = np.empty((len(self._totals), joints, n))
        flows[HEAT:] = 0.0
        passes.flow(raw, external, self._links, self._motors, flows)
        cut = sorted({k for row in sides for k in (row - 1, row) if 0 <= k < n})
        if cut:
            flows[:, :, cut] = self._across(cut, raw, external, sides, passes)
        stored, kinetic = np.zeros((2, joints, len(rows)))
        for springs in self._springs:
            pick = springs.group.pick
            stored[pick], kinetic[pick] = springs.balance(beyond, flows, sides, cut, ends, held=bool(held[pick].any()))
        through = np.abs(flows[WORK])
        through += flows[THROUGH]
        # What has no number counts nothing.
        np.fmax(through, 0.0, out=flows[THROUGH])
        if self._start is None:
            self._start = (stored[:, 0] + kinetic[:, 0])[:, None]
        at = np.empty((len(flows), joints, len(rows)))
        passes.add_up(flows, rows, stored + kinetic - self._start, self._totals, at)
        self.residual = at[VANISHED, :, -1].copy()
        found = {name: at[flow] for name, flow in FLOW_OF.items() if flow < len(at)}
        found |= {"spring_energy": stored, "energy_residual": at[VANISHED]}
        return {name: values[:, : len(asked)] for name, values in found.items()}

    def _across(self, steps: list[int], raw: Array, external: Array, sides: Mapping[int, Array], passes: Passes) -> Array:
        """What flows over steps that begin or end with a jump."""
        around = [row for k in steps for row in (k, k + 1)]
        pairs, pushes = raw[:, :, around], external[:, around]
        for place, row in enumerate(around):
            if row in sides:
                before, after = sides[row]
                side = before if place % 2 else after
                pairs[MEANS, :, place] = side[:, MEANS].T
                pushes[:, place] = side[:, -1]
        flows = np.empty((len(self._totals), raw.shape[1], len(around) - 1))
        flows[HEAT:] = 0.0
        passes.flow(pairs, pushes, self._links, self._motors, flows)
        return flows[:, :, ::2]
