"""Divergence by physics: numbers that are not finite, and energy from nowhere.

A check for NaN alone misses a spring that is not resolved: it saturates and settles far off, finite and wrong.
"""

from __future__ import annotations

from collections.abc import Sequence

from asrsim.engines.base import Model
from asrsim.errors import DivergenceError
from asrsim.samples import Array
from asrsim.simulation.layout import ENGINE_VELOCITY, EXCESS, NET_LINK_WORK, POSITION, RESIDUAL, TURNOVER
from asrsim.simulation.ledger import SHARE
from asrsim.simulation.substeps import COARSE

FLOOR = 5e-3
"""J below which energy is not checked."""


def runaway(joint: str, time: float, what: str, omega_h: float) -> DivergenceError:
    """The error with likely cause and cure."""
    cause = (
        f"omega h is {omega_h:.2g} for the stiffest spring: too large a step is likely. Lower the step or raise substeps"
        if omega_h > COARSE
        else "likely an input or gain that drives the joint away, or a contact that cannot be resolved. Look at the last "
        "samples of the log; lower gains, or the step"
    )
    return DivergenceError(f"joint '{joint}' diverged at t = {time:.4f} s: {what}; {cause}", joint=joint, time=time)


class EnergyGuard:
    """Watches energy that comes from nowhere, or goes there: in the links, and in what drives each of them.

    A leapfrog that does not resolve a spring keeps the links' own balance of work to the bit: it is the spring whose energy
    and work part ways. Stable runs, however coarse, stay far below :data:`SHARE`; unstable ones go past 1.
    """

    def __init__(self, energy: float) -> None:
        self._start = energy
        self._fastest = 0.0

    def look(self, model: Model | None, state: Array, names: Sequence[str]) -> tuple[str, str] | None:
        """Joint and what is wrong with its energy, or None. model: None where contacts or wrenches do work of their own on the
        links; state: (joints, columns)."""
        energy, kinetic = None, 0.0
        if model is not None:
            positions, velocities = state[:, POSITION], state[:, ENGINE_VELOCITY]
            energy = model.energy(positions, velocities)
            kinetic = 0.5 * float(velocities @ model.mass_matrix(positions) @ velocities)
        given, residual, turnover, excess = (state[:, column] for column in (NET_LINK_WORK, RESIDUAL, TURNOVER, EXCESS))
        return self.fault(
            energy, kinetic=kinetic, given=given, residual=residual, turnover=turnover, excess=excess, names=names
        )

    def fault(
        self, energy: float | None, *, kinetic: float, given: Array, residual: Array, turnover: Array, excess: Array,
        names: Sequence[str],
    ) -> tuple[str, str] | None:  # fmt: skip
        """Joint and what is wrong with its energy, or None.

        energy: kinetic and gravitational energy of the links in J, None where contacts or wrenches do work of their own;
        kinetic: its first part (the engine has it half a step late, so links that only exchange it with gravity seem to gain);
        by joint, in J: given: work of actuators and external torques on the links; residual: what vanished in the actuators;
        turnover: sum of the absolute flows; excess: most by which a residual was larger than its share of them.
        """
        scale = FLOOR + SHARE * float(turnover.sum())
        worst = int(excess.argmax())
        if excess[worst] > FLOOR:
            change = "vanished in" if residual[worst] > 0.0 else "came from nowhere in"
            return names[worst], f"{abs(residual[worst]):.3g} J {change} its actuator"
        if energy is None:
            return None
        # Energy that an actuator made (its residual) is reported above; the links are not blamed for it again.
        created = energy - self._start - float(given.sum()) - float(residual.sum())
        self._fastest = max(self._fastest, kinetic)
        if created > scale + SHARE * self._fastest:
            return names[int(turnover.argmax())], f"the links hold {created:.3g} J that nothing gave them"
        return None
