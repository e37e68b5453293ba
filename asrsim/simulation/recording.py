"""Conversion of a simulation's rows to samples for sinks, and the check of the energy balance."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Protocol

import numpy as np

from asrsim.engines.base import Engine, Scene
from asrsim.errors import InputError
from asrsim.samples import Array, Samples, concatenate, grid
from asrsim.simulation.divergence import EnergyGuard, runaway
from asrsim.simulation.prepared import Prepared
from asrsim.simulation.quantities import RowColumns

if TYPE_CHECKING:
    from asrsim.kinematics.tip import TipPoses


class Sink(Protocol):
    """Receiver of samples. It receives the logged steps, or every step if it has the attribute `full_rate = True`."""

    def write(self, samples: Samples) -> None:
        """Receive the next chunk of samples."""


class RunRecording:
    """Makes samples from rows and passes them to sinks. Samples are only stored if `keep` is set."""

    def __init__(
        self, prepared: Prepared, engine: Engine, columns: RowColumns, *, last: int, sinks: Sequence[Sink], keep: bool
    ) -> None:
        """prepared: the scenario with the initial state of the run. columns: columns of the rows; last: substep of the last
        sample."""
        self._prepared, self._engine, self._columns = prepared, engine, columns
        self._sinks, self._last, self._keep = sinks, last, keep
        self.active = bool(keep or sinks)
        self.kept: list[Samples] = []
        self._every = prepared.resolution.substeps
        """Number of substeps between two rows."""
        self._whole = any(getattr(sink, "full_rate", False) for sink in sinks)
        self.look_every = self._every * (1 if self._whole else prepared.scenario.log_every)
        """Number of substeps between readings of poses and contacts."""
        self._scenes: dict[int, Scene] = {}
        """Poses and contact forces that have not yet been added to the samples of their rows, by substep."""
        self._rows: list[tuple[int, Array]] = []
        """Blocks of rows: number of the first row, rows (n, joints, columns)."""
        self._tip: TipPoses | None = None
        if self.active:
            self._absent = columns.absent(prepared.drives)
            self._guard = EnergyGuard(prepared)
            if prepared.scenario.task is not None:
                from asrsim.kinematics.tip import TipPoses

                self._tip = TipPoses(prepared.scenario, prepared.robot)

    def copy(self) -> RunRecording:
        """A copy that continues independently. The original and the copy use the same sinks."""
        other = copy.copy(self)
        other.kept, other._scenes, other._rows = list(self.kept), dict(self._scenes), list(self._rows)
        if self.active:
            other._guard = copy.copy(self._guard)
        return other

    def note_outside_work(self) -> None:
        """Note that held wrenches do work on the links: the energy balance of the links is no longer checked."""
        if self.active:
            self._guard.forget_links()

    def take(self, first: int, rows: Array) -> None:
        """Add rows (n, joints, columns). first: number of the first row."""
        rows = rows[: max(0, self._last // self._every + 1 - first)]
        if len(rows):
            rows[:, self._absent] = np.nan
            self._rows.append((first, rows))

    def flush(self, substep: int, state: Array, *, check: bool = True) -> None:
        """Pass the samples up to `substep` to the sinks. state: state of the joints (joints, columns) at this substep. Raises
        DivergenceError if the energy balance is violated."""
        if not self._rows:
            return
        (first, *_), parts = zip(*self._rows, strict=True)
        # Do not copy a single block.
        rows = parts[0] if len(parts) == 1 else np.concatenate(parts)
        self._rows = []
        prepared = self._prepared
        logged = self._samples(first, rows, prepared.scenario.log_every)
        whole = self._samples(first, rows, 1) if self._whole else logged
        self._scenes.clear()
        if self._keep and len(logged.time):
            self.kept.append(logged)
        for sink in self._sinks:
            taken = whole if getattr(sink, "full_rate", False) else logged
            if len(taken.time):
                sink.write(taken)
        # Do not check the energy after the first substep, since the links have moved but no work has been recorded.
        fault = self._guard.look(state) if check and substep > 1 else None
        if fault is not None:
            raise runaway(prepared, fault[0], min(substep, self._last) * prepared.substep, fault[1])

    def look(self, substep: int) -> None:
        """Store poses and contacts for the row of a substep, before the substep."""
        if substep <= self._last:
            self._scenes[substep] = self._engine.scene()

    def _samples(self, first: int, rows: Array, every: int) -> Samples:
        """Samples of the rows whose number is a multiple of `every`, with poses and contacts. first: number of the first
        row."""
        part = slice((-first) % every, None, every)
        time = grid(first, len(rows), self._prepared.scenario.step)[part]
        samples = Samples(time=time, joints=self._engine.joints, values=self._columns.values(rows[part]))
        if self._scenes and len(time):
            numbers = range(first, first + len(rows))[part]
            bodies, contacts = (
                {name: np.array([table[name] for table in tables]) for name in tables[0]}
                for tables in zip(*(self._scenes[number * self._every] for number in numbers), strict=True)
            )
            samples = replace(samples, bodies=bodies, contacts=contacts)
        return samples if self._tip is None else self._tip.added(samples)

    @property
    def samples(self) -> Samples:
        """All stored samples; raises InputError if samples are not stored."""
        if not self._keep:
            raise InputError("stores no samples: create it with record=True", key="simulation", code="samples")
        return concatenate(self.kept, joints=self._engine.joints)
