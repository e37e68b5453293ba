"""Conversion of a simulation's rows to samples for sinks, and the check of the energy balance."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from asrsim.engines.base import Engine
from asrsim.errors import InputError
from asrsim.samples import Array, Samples, concatenate, grid
from asrsim.simulation.divergence import EnergyGuard, runaway
from asrsim.simulation.prepared import Prepared
from asrsim.simulation.quantities import QuantitySelection

if TYPE_CHECKING:
    from asrsim.kinematics.tip import TipPoses


class Sink(Protocol):
    """Receiver of samples: of the logged steps, or of every step if it has `full_rate = True`."""

    def write(self, samples: Samples) -> None:
        """Receive the next chunk of samples."""


class RunRecording:
    """Makes samples from rows and passes them to sinks. Samples are only stored if `keep` is set."""

    def __init__(
        self, prepared: Prepared, engine: Engine, selection: QuantitySelection, *, last: int, sinks: Sequence[Sink], keep: bool
    ) -> None:
        """selection: quantities in the rows; last: substep of the last sample."""
        scenario = prepared.scenario
        self._prepared, self._engine, self.selection = prepared, engine, selection
        self._sinks, self._last = sinks, last
        self.active = bool(keep or self._sinks)
        self.kept: list[Samples] | None = [] if keep else None
        self.every = prepared.resolution.substeps
        """Number of substeps between rows."""
        self._whole = any(getattr(sink, "full_rate", False) for sink in self._sinks)
        self._tip = _tip_of(prepared) if self.active else None
        self._bodies: dict[str, list[Any]] = {}
        """Poses and contact forces that have not yet been added to the samples of their rows."""
        self._contacts: dict[str, list[Any]] = {}
        self.look_every = self.every * (1 if self._whole else scenario.log_every)
        """Number of substeps between readings of poses and contacts."""
        # The energy balance of the links ignores the work of contacts and wrenches. It is not checked in the released order,
        # which is not passive and runs springs that the step does not resolve.
        self._alone = scenario.world.empty and scenario.fixed_base and not scenario.wrenches
        self._guarded = self.active and engine.model is not None and not prepared.stepping.released
        self._guard = self._new_guard(prepared.initial_positions, prepared.initial_velocities)
        self._rows: list[tuple[int, Array, Array]] = []
        """Blocks of rows: number of the first row, rows (n, joints, columns), references (input columns, joints, n)."""

    def _new_guard(self, positions: Sequence[float], velocities: Sequence[float]) -> EnergyGuard:
        model = self._engine.model
        return EnergyGuard(model.energy(positions, velocities) if model is not None and self._guarded else 0.0)

    def take(self, first: int, rows: Array, references: Array) -> None:
        """Add rows (n, joints, columns) with their references (input columns, joints, n); `first`: number of the first row."""
        count = min(len(rows), self._last // self.every + 1 - first)
        if self.active and count > 0:
            self._rows.append((first, rows[:count], references[:, :, :count]))

    def flush(self, substep: int, state: Array, *, check: bool = True) -> None:
        """Pass the samples up to `substep` to the sinks. state: (joints, columns) at this substep. Raises DivergenceError if
        the energy balance is violated."""
        if self._rows:
            first = self._rows[0][0]
            _, *parts = zip(*self._rows, strict=True)
            rows, references = (_joined(part, axis) for part, axis in zip(parts, (0, 2), strict=True))
            self._rows = []
            step = self._prepared.scenario.step
            self._hand_on(first, Samples(
                time=grid(first, len(rows), step), joints=self._engine.joints, values=self.selection.values(rows, references),
            ))  # fmt: skip
            if check and self._guarded:
                self._check_energy(substep, state)

    def _check_energy(self, substep: int, state: Array) -> None:
        fault = self._guard.look(self._engine.model if self._alone else None, state, self._engine.joints)
        if fault is not None:
            time = min(substep, self._last) * self._prepared.substep
            raise runaway(fault[0], time, fault[1], self._prepared.resolution.omega_h)

    def look(self, substep: int) -> None:
        """Store poses and contacts for the row of a substep, before the substep."""
        if substep <= self._last:
            scene = self._engine.scene()
            for table, found in ((self._bodies, scene.bodies), (self._contacts, scene.contacts)):
                for name, values in found.items():
                    table.setdefault(name, []).append(values)

    def _with_world(self, samples: Samples) -> Samples:
        """The samples with the poses and contacts that were stored for their rows."""
        n = len(samples.time)
        bodies = {name: np.array(rows[:n]) for name, rows in self._bodies.items()}
        contacts = {name: np.array(rows[:n]) for name, rows in self._contacts.items()}
        for rows in (*self._bodies.values(), *self._contacts.values()):
            del rows[:n]
        return replace(samples, bodies={**bodies, **samples.bodies}, contacts=contacts)

    def _hand_on(self, first: int, samples: Samples) -> None:
        """Pass samples to the sinks; `first`: number of the first sample."""
        every = self._prepared.scenario.log_every
        rows = slice((-first) % every, None, every)
        samples = self._with_world(samples if self._whole else _thinned(samples, rows))
        if self._tip is not None:
            samples = self._tip.added(samples)
        logged = _thinned(samples, rows) if self._whole else samples
        if self.kept is not None and len(logged.time):
            self.kept.append(logged)
        for sink in self._sinks:
            taken = samples if getattr(sink, "full_rate", False) else logged
            if len(taken.time):
                sink.write(taken)

    @property
    def samples(self) -> Samples:
        """All stored samples; raises InputError if samples are not stored."""
        if self.kept is None:
            raise InputError("stores no samples: create it with record=True", key="simulation", code="samples")
        return concatenate(self.kept, joints=self._engine.joints)

    def take_over(self, varied: Prepared, engine: Engine, selection: QuantitySelection) -> None:
        """Continue with other parameters, and possibly another engine."""
        self._prepared, self._engine, self.selection = varied, engine, selection
        if self.active:
            self._tip = _tip_of(varied)

    def renew(self, positions: Sequence[float], velocities: Sequence[float]) -> None:
        """Begin a new recording at these positions, rad (m), and velocities, rad/s (m/s), with the latest parameters."""
        if not self.active:
            return
        self._rows, self._guard = [], self._new_guard(positions, velocities)
        self._bodies, self._contacts = {}, {}
        self.kept = None if self.kept is None else []

    def state(self) -> Any:
        """A copy of the recording's state; None if nothing is recorded."""
        if not self.active:
            return None
        return (
            copy.deepcopy((self._guard, self._bodies, self._contacts)),
            list(self._rows),
            None if self.kept is None else list(self.kept),
        )

    def put_back(self, state: Any) -> None:
        """Continue from a saved state. Samples that the sinks have already received are not withdrawn."""
        if state is not None:
            going_on, rows, kept = state
            self._guard, self._bodies, self._contacts = copy.deepcopy(going_on)
            self._rows = list(rows)
            self.kept = None if kept is None else list(kept)


def _joined(parts: Sequence[Array], axis: int) -> Array:
    """The arrays concatenated along `axis`; a single array is not copied."""
    return parts[0] if len(parts) == 1 else np.concatenate(parts, axis=axis)


def _thinned(samples: Samples, rows: slice) -> Samples:
    if rows.step == 1:
        return samples

    def thin(table: Mapping[str, Array]) -> dict[str, Array]:
        return {name: values[rows] for name, values in table.items()}

    values, bodies, contacts = map(thin, (samples.values, samples.bodies, samples.contacts))
    return replace(samples, time=samples.time[rows], values=values, bodies=bodies, contacts=contacts)


def _tip_of(prepared: Prepared) -> TipPoses | None:
    if prepared.scenario.task is None:
        return None
    from asrsim.kinematics.tip import TipPoses

    return TipPoses(prepared.scenario, prepared.robot)
