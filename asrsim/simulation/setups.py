"""Setups of worlds: parameters, initial state and input signals. Worlds with equal parameters, initial states and signals share
a setup."""

from __future__ import annotations

from typing import NamedTuple

from asrsim.signals.base import Signal
from asrsim.simulation.drives import command_delays
from asrsim.simulation.inputs import Inputs
from asrsim.simulation.prepared import Prepared
from asrsim.simulation.start import Start

VARIANTS_KEPT = 256
"""Number of cached sets of parameters with their robots. They are cached, since callers often use the same parameters again
with other references."""


class WorldSetup(NamedTuple):
    """Parameters, initial state and input signals of a world."""

    start: Start
    prepared: Prepared
    """The scenario with the world's parameters."""
    inputs: Inputs
    started: Prepared
    """`prepared` with the initial state of the world."""


class Setups:
    """Makes the setups of the worlds of a scenario."""

    def __init__(self, prepared: Prepared, *, chunk: int) -> None:
        """chunk: largest number of substeps whose inputs are sampled in one call."""
        self._prepared, self._chunk = prepared, chunk
        self.home = WorldSetup(Start(), prepared, self._inputs_of(prepared), prepared)
        """Setup of a world that starts as the scenario states."""
        self._signals: tuple[dict[tuple[str, str], Signal], Inputs] = {}, self.home.inputs
        """Latest signals of worlds by joint and reference, and the inputs that were made from these signals."""
        self._variants: dict[tuple[tuple[str, str, float], ...], Prepared] = {}
        """Prepared scenarios, by the parameters of the worlds."""

    def of(self, start: Start) -> WorldSetup:
        """Parameters, inputs and initial state for `start`. Raises InputError, RobotError, and ScenarioError for an arm without
        equilibrium.
        """
        key = tuple((owner, *row) for owner, table in sorted(start.parameters.items()) for row in sorted(table.items()))
        prepared = self._variants.get(key) if key else self._prepared
        if prepared is None:
            prepared = self._prepared.vary(start.parameters)
            if len(self._variants) >= VARIANTS_KEPT:
                self._variants.clear()
            self._variants[key] = prepared
        inputs, started = self.home.inputs, prepared
        if prepared is not self._prepared and command_delays(prepared.drives) != command_delays(self._prepared.drives):
            # Make new inputs, since the command delays of this world differ from the delays of the scenario.
            started = prepared.with_references(start.references) if start.references else prepared
            inputs = self._inputs_of(started)
        elif start.references:
            signals = {(joint, name): one for joint, table in start.references.items() for name, one in table.items()}
            latest = self._signals[0]
            other = latest.keys() != signals.keys() or any(latest[key] is not one for key, one in signals.items())
            if other or self._prepared.scenario.initial_equilibrium:
                started = prepared.with_references(start.references)
            if other:
                self._signals = signals, self._inputs_of(started)
            inputs = self._signals[1]
        return WorldSetup(start, prepared, inputs, started.started(start))

    def _inputs_of(self, prepared: Prepared) -> Inputs:
        """The input signals of a scenario."""
        return Inputs(
            prepared.scenario,
            prepared.drives,
            substep=prepared.substep,
            staggered=prepared.stepping.staggered,
            longest=self._chunk,
        )
