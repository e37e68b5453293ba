"""Inputs of the loop: references and external torques, sampled chunk by chunk, and the kicks in which an input jumps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from asrsim.actuators import Actuator
from asrsim.actuators.vectorised import over_arrays
from asrsim.samples import Array, grid, picking
from asrsim.scenario.data import Scenario, for_joint
from asrsim.signals import Constant
from asrsim.signals.base import Signal
from asrsim.simulation.drives import SteppedJoint, references_of
from asrsim.simulation.effects import through
from asrsim.simulation.layout import GOALS
from asrsim.simulation.rows import shape_of
from asrsim.simulation.sensors import Sensor
from asrsim.simulation.wrenches import wrench_table

REST = Constant(value=0.0)
KEPT = 3
"""Number of chunks that are cached besides the first one, since worlds may be at different times."""


@dataclass(frozen=True)
class Cut:
    """A kick that is split into pieces because inputs jump in it, or the first kick of a run."""

    substep: int
    edges: list[float]
    """Times in s at which the pieces begin and end."""

    @property
    def sample_times(self) -> list[float]:
        """Time in s at which the signals are sampled, for each piece."""
        middles = [0.5 * (a + b) for a, b in pairwise(self.edges)]
        return self.edges[:1] if not self.substep and len(middles) == 1 else middles


class Given(NamedTuple):
    """Inputs of n substeps. Worlds with equal inputs share a set; see `asrsim.simulation.kernel.run`."""

    inputs: Array
    """(sets, n, joints, columns): external torques, references mapped to motors, and for each sensor whether it samples then,
    and its noise."""
    references: Array
    """(sets, n, joints, columns): external torques and references, as they are given."""
    wrenches: Array
    """(sets, n, w, 6) N, N m: wrenches as means over the kicks."""
    cuts: NDArray[np.int64]
    """(sets, c, 3): kicks that are split because inputs jump; row of the kick, first piece, and index after the last piece."""
    fractions: Array
    """(pieces,): lengths of the pieces, as fractions of a substep."""
    on_time: NDArray[np.bool_]
    """(pieces,): whether a piece begins at the time of the whole substep."""
    pieces: Array
    """(pieces, joints, columns): inputs during the pieces."""


@dataclass(frozen=True)
class Chunk:
    """Inputs of a scenario for the substeps first .. first + n - 1."""

    first: int
    references: Array
    """External torques and references, (n + pieces, joints, columns): see :data:`asrsim.simulation.layout.EXTERNAL`; the
    pieces of the kicks that are cut stand behind."""
    sensors: Array
    """(n, joints, columns): whether each sensor takes a sample, and its noise."""
    wrenches: Array
    """(n, w, 6) N, N m: wrenches as means over the kicks."""
    places: NDArray[np.int64]
    """(m, 3): split kicks; row of the kick, first piece, and index after the last piece."""
    fractions: Array
    on_time: NDArray[np.bool_]
    inputs: tuple[Array, Array]
    """Inputs (n, joints, columns) of the substeps and (pieces, joints, columns) of the pieces, without overridden
    references."""

    def __len__(self) -> int:
        return len(self.sensors)


class Inputs:
    """All input signals of a run, by joint."""

    def __init__(
        self,
        scenario: Scenario,
        drives: Sequence[SteppedJoint],
        *,
        substep: float,
        staggered: bool,
        sensors: Sequence[Sensor | None] = (),
    ) -> None:
        self.substep = substep
        self._chunks: dict[tuple[int, int], Chunk] = {}
        self._sensors = tuple(sensors)
        self._sensed = 2 * max((0 if sensor is None else sensor.count for sensor in sensors), default=0)
        self._wrenches = [wrench_table(wrench, staggered=staggered) for wrench in scenario.wrenches]
        self.staggered = staggered
        mapped: dict[type[Actuator], list[int]] = {}
        for index, drive in enumerate(drives):
            if drive.actuator and drive.mode and drive.mode.mapped:
                mapped.setdefault(drive.actuator, []).append(index)
        self._maps = [(picking(rows), over_arrays(actuator.motor_references)) for actuator, rows in mapped.items()]
        self._shape = shape_of(drives, sensors or [None] * len(drives))
        self._signals: list[list[Signal]] = [[for_joint(scenario.external_torques, drive.name, REST) for drive in drives]]
        for slot in range(self._shape.motors):
            self._signals.append([self._reference(scenario, drive, j, slot) for j, drive in enumerate(drives)])

    def _reference(self, scenario: Scenario, drive: SteppedJoint, j: int, slot: int) -> Signal:
        names = references_of(drive)
        if slot >= len(names):
            return REST
        signal = scenario.references_of(drive.name).get(names[slot], self._rest(drive, slot))
        effects = for_joint(scenario.command_effects, drive.name)
        return through(signal, effects, step=scenario.step, seed=(scenario.seed, j, slot))

    @staticmethod
    def _rest(drive: SteppedJoint, slot: int) -> Signal:
        """Default reference: the joint's start position for motors and controllers, 0 for torques and voltages."""
        mode = drive.mode
        if mode is None or mode.number == 0 or mode.direct:
            return REST
        if slot == 0 or (not mode.mapped and drive.actuator is not None and not drive.actuator.adjuster):
            return Constant(value=drive.initial_position)
        return REST

    def sample(self, time: Array) -> Array:
        """External torques and references (columns, joints, n) at `time` (n,)."""
        tables = np.empty((len(self._signals), len(self._signals[0]), len(time)))
        # Joints share the signals that are given for all.
        known: dict[int, Array] = {}
        for table, signals in zip(tables, self._signals, strict=True):
            for row, signal in zip(table, signals, strict=True):
                if type(signal) is Constant:
                    row[:] = signal.value
                    continue
                if id(signal) not in known:
                    known[id(signal)] = signal.values(time)
                row[:] = known[id(signal)]
        return tables

    def _goals(self, references: Array) -> Array:
        """References (..., joints, columns) mapped to motors."""
        goals = references.copy()
        tables = goals.T
        for rows, law in self._maps:
            mapped = law(*np.ascontiguousarray(tables[GOALS : GOALS + 2, rows]))
            for slot, values in enumerate(mapped):
                tables[GOALS + slot, rows] = values
        return goals

    def chunk(self, first: int, count: int) -> Chunk:
        """Inputs of the scenario for substeps `first` .. `first + count - 1`. The first chunk and the latest ones are
        cached."""
        key = first, count
        if key not in self._chunks:
            kept = [one for one in self._chunks if not one[0] or one in list(self._chunks)[-KEPT:]]
            self._chunks = {one: self._chunks[one] for one in kept} | {key: self._make_chunk(first, count)}
        return self._chunks[key]

    def _make_chunk(self, first: int, count: int) -> Chunk:
        cuts = self._cuts(first, count)
        times = grid(first, count, self.substep), *(np.array(cut.sample_times) for cut in cuts)
        parts = [self.sample(time) for time in times]
        sensors = np.zeros((count, len(self._signals[0]), self._sensed))
        for joint, sensor in enumerate(self._sensors):
            if sensor is not None:
                sensor.fill(sensors[:, joint], first, self.substep)
        wrenches = np.zeros((count, len(self._wrenches), 6))
        for index, table in enumerate(self._wrenches):
            wrenches[:, index] = table(first, count, self.substep)
        places: list[tuple[int, int, int]] = []
        fractions: list[float] = []
        on_time: list[bool] = []
        for cut in cuts:
            begin, now = len(fractions), cut.substep * self.substep
            for a, b in pairwise(cut.edges):
                fractions.append((b - a) / self.substep)
                on_time.append(a == now)
            places.append((cut.substep - first, begin, len(fractions)))
        references = np.ascontiguousarray(np.concatenate(parts, axis=2).T)
        rows = self._input_rows(references[None, :count], sensors)[0]
        pieces = self._goals(references[count:])
        return Chunk(
            first, references, sensors, wrenches, np.array(places, dtype=np.int64).reshape(-1, 3), np.array(fractions),
            np.array(on_time, dtype=bool), (rows, pieces),
        )  # fmt: skip

    def given(self, chunk: Chunk, begin: int, end: int, held: Array | None) -> Given:
        """Rows `begin` to `end` of a chunk.

        held: (sets, joints, columns) values that override the scenario's; NaN: no override. None: one set without overrides.
        """
        places = chunk.places[slice(*np.searchsorted(chunk.places[:, 0], (begin, end)).tolist())]
        first, last = (places[0, 1], places[-1, 2]) if len(places) else (0, 0)
        fractions, on_time, pieces = chunk.fractions[first:last], chunk.on_time[first:last], chunk.inputs[1][first:last]
        cuts, wrenches = (places - np.array([begin, first, first]))[None], chunk.wrenches[None, begin:end]
        if held is None:
            rows, references = chunk.inputs[0][None, begin:end], chunk.references[None, begin:end]
            return Given(rows, references, wrenches, cuts, fractions, on_time, pieces)
        own, sets = held[:, None], len(held)
        references = np.where(np.isnan(own), chunk.references[begin:end], own)
        if sets > 1:
            shifts = np.arange(sets)[:, None, None] * np.array([0, last - first, last - first])
            cuts, wrenches = cuts + shifts, np.repeat(wrenches, sets, axis=0)
            fractions, on_time = np.tile(fractions, sets), np.tile(on_time, sets)
        if last > first:
            cut = np.where(np.isnan(own), chunk.references[len(chunk) + first : len(chunk) + last], own)
            pieces = self._goals(cut).reshape(-1, *cut.shape[2:])
        inputs = self._input_rows(references, chunk.sensors[begin:end])
        return Given(inputs, references, wrenches, cuts, fractions, on_time, pieces)

    def _input_rows(self, references: Array, sensors: Array) -> Array:
        """(sets, n, joints, columns) of references (sets, n, joints, columns) and sensors (n, joints, columns)."""
        sets, count, joints, columns = references.shape
        inputs = np.empty((sets, count, joints, columns + self._sensed))
        inputs[..., :columns] = self._goals(references)
        inputs[..., columns:] = sensors
        return inputs

    def _cuts(self, first: int, count: int) -> list[Cut]:
        if not self.staggered:
            return []
        h = self.substep
        start, end = (first - 0.5) * h, (first + count - 0.5) * h
        active = (signal for column in self._signals for signal in column if type(signal) is not Constant)
        signals = {id(signal): signal for signal in active}.values()
        # A set instead of np.unique, which imports numpy.ma and slows down short runs.
        times = np.array(sorted({jump for s in signals for jump in s.jumps(max(start, 0.0), end).tolist()}))
        times = times[(times > 1e-6 * h) & (times < end - 1e-6 * h)]
        owners = np.floor(times / h + 0.5 + 1e-6).astype(int)
        substeps = {owner for owner in owners.tolist() if first <= owner < first + count} | ({0} if first == 0 else set())
        return [self._cut(substep, times[owners == substep].tolist()) for substep in sorted(substeps)]

    def _cut(self, substep: int, jumps: list[float]) -> Cut:
        """The kick around a substep, split at `jumps` and at the time of the substep; no piece lies before t = 0."""
        h = self.substep
        now = substep * h
        inner = [jump for jump in jumps if abs(jump - now) > 1e-6 * h and abs(jump - now) < (0.5 - 1e-6) * h]
        edges = sorted({now, now + 0.5 * h, *inner} | ({now - 0.5 * h} if substep else set()))
        return Cut(substep, [edge for edge in edges if substep or edge >= now])


def joined(parts: Sequence[Given]) -> Given:
    """Inputs with the sets of all `parts`, concatenated."""
    if len(parts) == 1:
        return parts[0]
    most, shift = max(one.cuts.shape[1] for one in parts), 0
    padded = []
    for one in parts:
        cuts = np.full((len(one.cuts), most, 3), -1)
        cuts[:, : one.cuts.shape[1]] = one.cuts + np.array([0, shift, shift])
        padded.append(one._replace(cuts=cuts))
        shift += len(one.fractions)
    return Given(*(np.concatenate(tables) for tables in zip(*padded, strict=True)))
