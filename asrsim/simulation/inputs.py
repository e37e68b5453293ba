"""Inputs of the loop: references and external torques sampled a block at a time, and the kicks in which one jumps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

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


class Cuts(NamedTuple):
    """The kicks in which inputs jump, as :func:`asrsim.simulation.kernel.run` takes them."""

    places: NDArray[np.int64]
    """(m, 3) row of the block, first piece, piece after the last."""
    fractions: Array
    """(pieces,) of a substep."""
    on_time: NDArray[np.bool_]
    """(pieces,) whether the whole substep's time is at the piece's start."""
    inputs: Array
    """(pieces, joints, columns)."""


@dataclass(frozen=True)
class Block:
    """Inputs of substeps first..first+n-1."""

    first: int
    references: Array
    """External torques and references as they are logged, (columns, joints, n): see
    :data:`asrsim.simulation.layout.EXTERNAL`."""
    inputs: Array
    """What the joints are given, (n, joints, columns): the same with references mapped to motors, and for each sensor whether
    it samples then, and its noise."""
    wrenches: Array
    """(n, w, 6) N, N m: means over the kicks."""
    cuts: Cuts

    def __len__(self) -> int:
        return len(self.inputs)


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
        self.held: dict[tuple[int, int], float] = {}
        """(joint, column) -> the value that stands in place of the scenario's; it makes no jumps."""
        self._starts: dict[Any, tuple[Array, list[Cut]]] = {}
        self._sensors = tuple(sensors)
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
        return self._with_held(self._scenario_at(time))

    def _scenario_at(self, time: Array) -> Array:
        """What the scenario's signals say: (columns, joints, n)."""
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

    def _with_held(self, tables: Array) -> Array:
        for (joint, slot), value in self.held.items():
            tables[slot, joint] = value
        return tables

    def _goals(self, references: Array) -> Array:
        """References (columns, joints, n) mapped to motors."""
        goals = references.copy()
        for rows, law in self._maps:
            mapped = law(*references[GOALS : GOALS + 2, rows])
            for slot, values in enumerate(mapped):
                goals[GOALS + slot, rows] = values
        return goals

    @property
    def steady(self) -> bool:
        """Nothing that the scenario says changes, and there are no sensors and no wrenches."""
        signals = (signal for column in self._signals for signal in column)
        return not self._wrenches and not any(self._sensors) and all(type(signal) is Constant for signal in signals)

    def mapped(self, references: Array) -> Array:
        """Input rows without sensors, (n, joints, columns), of external torques and references (columns, joints, n)."""
        return self._goals(references).transpose(2, 1, 0)

    def block(self, first: int, count: int) -> Block:
        """Inputs of substeps `first` .. `first + count - 1`."""
        tables, cuts = self._plan(first, count)
        references = self._with_held(tables)
        goals = self._goals(references)
        sensors = 2 * max((0 if sensor is None else sensor.count for sensor in self._sensors), default=0)
        inputs = np.zeros((count, goals.shape[1], len(goals) + sensors))
        inputs[:, :, : len(goals)] = goals[:, :, :count].transpose(2, 1, 0)
        for joint, sensor in enumerate(self._sensors):
            if sensor is not None:
                sensor.fill(inputs[:, joint, len(goals) :], first, self.substep)
        wrenches = np.zeros((count, len(self._wrenches), 6))
        for index, table in enumerate(self._wrenches):
            wrenches[:, index] = table(first, count, self.substep)
        pieces = np.ascontiguousarray(goals[:, :, count:].transpose(2, 1, 0))
        return Block(first, references[:, :, :count], inputs, wrenches, self._cut_table(first, cuts, pieces))

    def hold(self, block: Block, row: int) -> None:
        """What is held now, in a block without cuts that was made when the same references were held, from a row on."""
        for (joint, slot), value in self.held.items():
            block.references[slot, joint, row:] = value
        block.inputs[row:, :, : len(block.references)] = self._goals(block.references[:, :, row:]).transpose(2, 1, 0)

    def _plan(self, first: int, count: int) -> tuple[Array, list[Cut]]:
        """What the scenario says for a block, (columns, joints, n + pieces): for its substeps, then for the pieces of its
        cuts, which come too. Kept for the first block of many runs alike."""
        key = first, count, frozenset(self.held)
        if key in self._starts:
            tables, cuts = self._starts[key]
            return tables.copy(), cuts
        cuts = self._cuts(first, count)
        times = grid(first, count, self.substep), *(np.array(cut.sample_times) for cut in cuts)
        parts = [self._scenario_at(time) for time in times]
        tables = np.concatenate(parts, axis=2) if cuts else parts[0]
        if not first:
            self._starts = {key: (tables.copy(), cuts)}
        return tables, cuts

    def _cuts(self, first: int, count: int) -> list[Cut]:
        if not self.staggered:
            return []
        h = self.substep
        start, end = (first - 0.5) * h, (first + count - 0.5) * h
        active = (
            signal
            for slot, column in enumerate(self._signals)
            for joint, signal in enumerate(column)
            if type(signal) is not Constant and (joint, slot) not in self.held
        )
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

    def _cut_table(self, first: int, cuts: Sequence[Cut], inputs: Array) -> Cuts:
        """The cuts of a block; inputs: of all their pieces, one after the other."""
        places: list[tuple[int, int, int]] = []
        fractions: list[float] = []
        on_time: list[bool] = []
        for cut in cuts:
            begin, now = len(fractions), cut.substep * self.substep
            for a, b in pairwise(cut.edges):
                fractions.append((b - a) / self.substep)
                on_time.append(a == now)
            places.append((cut.substep - first, begin, len(fractions)))
        return Cuts(np.array(places, dtype=np.int64).reshape(-1, 3), np.array(fractions), np.array(on_time, dtype=bool), inputs)
