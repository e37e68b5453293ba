"""Inputs of the loop: references and external torques sampled a chunk at a time, and the kicks in which one jumps."""

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
"""Chunks that are kept beside the first one: worlds may be at different times."""


@dataclass(frozen=True)
class Cut:
    """A kick in which inputs jump, or the first of a run."""

    substep: int
    edges: list[float]
    """s: where its pieces begin and end."""

    @property
    def sample_times(self) -> list[float]:
        """s: of each piece, when the scenario's signals are read for it."""
        middles = [0.5 * (a + b) for a, b in pairwise(self.edges)]
        return self.edges[:1] if not self.substep and len(middles) == 1 else middles


class Given(NamedTuple):
    """Inputs of n substeps, in one set for each world or for worlds alike; see :func:`asrsim.simulation.kernel.run`."""

    inputs: Array
    """(sets, n, joints, columns): external torques, references mapped to motors, and for each sensor whether it samples then,
    and its noise."""
    wrenches: Array
    """(sets, n, w, 6) N, N m: means over the kicks."""
    cuts: NDArray[np.int64]
    """(sets, c, 3) kicks in which inputs jump: row, first piece, piece after the last."""
    fractions: Array
    """(pieces,) of a substep."""
    on_time: NDArray[np.bool_]
    """(pieces,) whether the whole substep's time is at the piece's start."""
    pieces: Array
    """(pieces, joints, columns): their inputs."""


@dataclass(frozen=True)
class Chunk:
    """What a scenario says for the substeps first..first+n-1."""

    first: int
    references: Array
    """External torques and references, (columns, joints, n + pieces): see :data:`asrsim.simulation.layout.EXTERNAL`; the
    pieces of the kicks that are cut stand behind."""
    sensors: Array
    """(n, joints, columns)."""
    wrenches: Array
    """(n, w, 6)."""
    places: NDArray[np.int64]
    """(m, 3) row, first piece, piece after the last."""
    fractions: Array
    on_time: NDArray[np.bool_]
    inputs: tuple[Array, Array]
    """(n, joints, columns) and (pieces, joints, columns) where nothing is held."""

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
        """A reference that nobody gives: motors and controllers stay where the joint starts; torques and voltages are 0."""
        mode = drive.mode
        if mode is None or mode.number == 0 or mode.direct:
            return REST
        if slot == 0 or (not mode.mapped and drive.actuator is not None and not drive.actuator.adjuster):
            return Constant(value=drive.initial_position)
        return REST

    def sample(self, time: Array) -> Array:
        """External torques and references at `time` (n,), (columns, joints, n)."""
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
        """References (columns, joints, ...) mapped to motors."""
        goals = references.copy()
        for rows, law in self._maps:
            mapped = law(*references[GOALS : GOALS + 2, rows])
            for slot, values in enumerate(mapped):
                goals[GOALS + slot, rows] = values
        return goals

    def chunk(self, first: int, count: int) -> Chunk:
        """What the scenario says for substeps `first` .. `first + count - 1`; the first chunk and the last ones are kept."""
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
        references = np.concatenate(parts, axis=2)
        rows = self._input_rows(references[:, :, None, :count], sensors)[0]
        pieces = np.ascontiguousarray(self._goals(references[:, :, count:]).transpose(2, 1, 0))
        return Chunk(
            first, references, sensors, wrenches, np.array(places, dtype=np.int64).reshape(-1, 3), np.array(fractions),
            np.array(on_time, dtype=bool), (rows, pieces),
        )  # fmt: skip

    def given(self, chunk: Chunk, begin: int, end: int, held: Array | None) -> tuple[Given, Array]:
        """Rows `begin` to `end` of a chunk, and their references (columns, joints, sets, n).

        held: (sets, joints, columns) values that stand in the place of the scenario's, NaN: none; they have no jumps of their
        own. None: one set, the scenario's.
        """
        places = chunk.places[(chunk.places[:, 0] >= begin) & (chunk.places[:, 0] < end)]
        first, last = (places[0, 1], places[-1, 2]) if len(places) else (0, 0)
        fractions, on_time, pieces = chunk.fractions[first:last], chunk.on_time[first:last], slice(first, last)
        cuts, wrenches = (places - np.array([begin, first, first]))[None], chunk.wrenches[None, begin:end]
        if held is None:
            inputs, cut_inputs = chunk.inputs
            references = chunk.references[:, :, None, begin:end]
            return Given(inputs[None, begin:end], wrenches, cuts, fractions, on_time, cut_inputs[pieces]), references
        own, sets = held.transpose(2, 1, 0)[..., None], len(held)
        behind = slice(len(chunk) + first, len(chunk) + last)
        references, cut = (np.where(np.isnan(own), chunk.references[:, :, None, at], own) for at in (slice(begin, end), behind))
        shifts = np.arange(sets)[:, None, None] * np.array([0, last - first, last - first])
        goals = self._goals(cut) if last > first else cut
        cut_inputs = np.ascontiguousarray(goals.transpose(2, 3, 1, 0)).reshape(-1, *cut.shape[1::-1])
        inputs = self._input_rows(references, chunk.sensors[begin:end])
        wrenches = np.repeat(wrenches, sets, axis=0)
        return Given(inputs, wrenches, cuts + shifts, np.tile(fractions, sets), np.tile(on_time, sets), cut_inputs), references

    def _input_rows(self, references: Array, sensors: Array) -> Array:
        """(sets, n, joints, columns) of references (columns, joints, sets, n) and sensors (n, joints, columns)."""
        columns, joints, sets, count = references.shape
        inputs = np.empty((sets, count, joints, columns + self._sensed))
        inputs[..., :columns] = self._goals(references).transpose(2, 3, 1, 0)
        inputs[..., columns:] = sensors
        return inputs

    def _cuts(self, first: int, count: int) -> list[Cut]:
        if not self.staggered:
            return []
        h = self.substep
        start, end = (first - 0.5) * h, (first + count - 0.5) * h
        active = (signal for column in self._signals for signal in column if type(signal) is not Constant)
        signals = {id(signal): signal for signal in active}.values()
        # Sets, not np.unique: that imports numpy.ma, which a short run has no other use for.
        times = np.array(sorted({jump for s in signals for jump in s.jumps(max(start, 0.0), end).tolist()}))
        times = times[(times > 1e-6 * h) & (times < end - 1e-6 * h)]
        owners = np.floor(times / h + 0.5 + 1e-6).astype(int)
        substeps = {owner for owner in owners.tolist() if first <= owner < first + count} | ({0} if first == 0 else set())
        return [self._cut(substep, times[owners == substep].tolist()) for substep in sorted(substeps)]

    def _cut(self, substep: int, jumps: list[float]) -> Cut:
        """The kick around a substep, cut at `jumps` and at the substep's own time; before t = 0 there is none."""
        h = self.substep
        now = substep * h
        inner = [jump for jump in jumps if abs(jump - now) > 1e-6 * h and abs(jump - now) < (0.5 - 1e-6) * h]
        edges = sorted({now, now + 0.5 * h, *inner} | ({now - 0.5 * h} if substep else set()))
        return Cut(substep, [edge for edge in edges if substep or edge >= now])


def joined(parts: Sequence[Given]) -> Given:
    """The sets of several, one after the other."""
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
