"""Inputs of the loop: references and external torques sampled a block at a time, and the kicks in which one jumps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from asrsim.actuators import Actuator
from asrsim.actuators.vectorised import references_over_arrays
from asrsim.samples import Array, picking
from asrsim.scenario.data import Scenario, for_joint
from asrsim.signals import Constant
from asrsim.signals.base import Signal
from asrsim.simulation.drives import SteppedJoint
from asrsim.simulation.effects import through
from asrsim.simulation.sensors import Sensor
from asrsim.simulation.substep import READINGS
from asrsim.simulation.wrenches import wrench_table

REST = Constant(value=0.0)


@dataclass(frozen=True)
class Piece:
    """A part of a kick: its fraction of a step, the inputs in it, and whether the whole step's time is at its start."""

    fraction: float
    rows: tuple[list[float], list[float], list[float]]
    """References 1, references 2, external torques, one a joint."""
    on_time: bool
    substep: int


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


@dataclass(frozen=True)
class Block:
    """Inputs of substeps first..first+n-1."""

    first: int
    arrays: Array
    """References 1 and 2 and external torques, (3, joints, n)."""
    stacked: Array
    """What the joints' laws are given, (n, joints, columns), in memory joint by joint within a column: references, after the
    reference map in modes 3 and 6, external torques, and for each sensor whether it samples then, and its noise."""
    wrenches: Array
    """(n, w, 6) N, N m: means over the kicks."""
    events: dict[int, tuple[Piece, ...]]
    sides: dict[int, Array] = field(default_factory=dict)
    """Filled by the loop, by substep with an event: means over the half kicks before and after its time, (2, joints, columns
    of the raw record with the torque after its limit, and the external torque)."""

    def __len__(self) -> int:
        return int(self.arrays.shape[2])


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
        """(joint, 0 or 1) -> the reference that stands in place of the scenario's; it makes no jumps."""
        self._starts: dict[Any, tuple[Array, list[Cut]]] = {}
        self._sensors = tuple(sensors)
        self._wrenches = [wrench_table(wrench, staggered=staggered) for wrench in scenario.wrenches]
        self.staggered = staggered
        mapped: dict[type[Actuator], list[int]] = {}
        for index, drive in enumerate(drives):
            if drive.actuator and drive.mode and drive.mode.mapped:
                mapped.setdefault(drive.actuator, []).append(index)
        self._maps = [(picking(rows), references_over_arrays(actuator)) for actuator, rows in mapped.items()]
        self._signals: tuple[list[Signal], list[Signal], list[Signal]] = ([], [], [])
        for index, drive in enumerate(drives):
            references = scenario.references_of(drive.name)
            effects = for_joint(scenario.command_effects, drive.name)
            names = drive.mode.references if drive.mode else ()
            for slot in (0, 1):
                signal: Signal = REST
                if slot < len(names):
                    signal = references.get(names[slot], self._rest(drive, slot))
                    signal = through(signal, effects, step=scenario.step, seed=(scenario.seed, index, slot))
                self._signals[slot].append(signal)
            self._signals[2].append(for_joint(scenario.external_torques, drive.name, REST))

    @staticmethod
    def _rest(drive: SteppedJoint, slot: int) -> Signal:
        """A reference that nobody gives: motors and controllers stay where the joint starts; torques and voltages are 0."""
        mode = drive.mode
        if mode is None or mode.number == 0 or mode.direct:
            return REST
        if slot == 0 or (slot == 1 and not mode.mapped and drive.actuator is not None and not drive.actuator.adjuster):
            return Constant(value=drive.initial_position)
        return REST

    def sample(self, time: Array) -> tuple[Array, Array, Array]:
        """References 1 and 2 and external torques at `time` (n,): each (n, joints)."""
        first, second, external = self._with_held(self._scenario_at(time))
        return first.T, second.T, external.T

    def _scenario_at(self, time: Array) -> Array:
        """What the scenario's signals say: (3, joints, n)."""
        tables = np.empty((3, len(self._signals[0]), len(time)))
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

    def _goals(self, inputs: Array, columns: int = READINGS) -> Array:
        """What the laws are given, (columns, joints, n): inputs (3, joints, n) mapped to motors, and room for sensors."""
        goals = np.empty((columns, *inputs.shape[1:]))
        goals[:READINGS], goals[READINGS:] = inputs, 0.0
        for rows, law in self._maps:
            goals[0, rows], goals[1, rows] = law(inputs[0, rows], inputs[1, rows])
        return goals

    def block(self, first: int, count: int) -> Block:
        """Inputs of substeps `first` .. `first + count - 1`."""
        tables, cuts = self._plan(first, count)
        inputs = self._with_held(tables)
        goals = self._goals(inputs, input_columns(self._sensors))
        stacked = goals[:, :, :count].transpose(2, 1, 0)
        for joint, sensor in enumerate(self._sensors):
            if sensor is not None:
                sensor.fill(stacked[:, joint, READINGS:], first, self.substep)
        wrenches = np.zeros((count, len(self._wrenches), 6))
        for index, table in enumerate(self._wrenches):
            wrenches[:, index] = table(first, count, self.substep)
        pieces = goals[:READINGS, :, count:].transpose(0, 2, 1).tolist()
        return Block(first, inputs[:, :, :count], stacked, wrenches, self._events(cuts, pieces))

    def hold(self, block: Block, row: int) -> None:
        """What is held now, in a block without cuts that was made when the same references were held, from a row on."""
        for (joint, slot), value in self.held.items():
            block.arrays[slot, joint, row:] = value
        block.stacked[row:, :, :READINGS] = self._goals(block.arrays[:, :, row:]).transpose(2, 1, 0)

    def _plan(self, first: int, count: int) -> tuple[Array, list[Cut]]:
        """What the scenario says for a block, (3, joints, n + pieces): for its substeps, then for the pieces of its cuts, which
        come too. Kept for the first block of many runs alike."""
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

    def _events(self, cuts: Sequence[Cut], goals: Sequence[list[list[float]]]) -> dict[int, tuple[Piece, ...]]:
        """The pieces of the cuts, by substep; goals: references 1 and 2 and external torques of all pieces, one after the
        other."""
        events, rows = {}, zip(*goals, strict=True)
        for cut in cuts:
            now = cut.substep * self.substep
            events[cut.substep] = tuple(
                Piece((b - a) / self.substep, next(rows), a == now, cut.substep) for a, b in pairwise(cut.edges)
            )
        return events


def input_columns(sensors: Sequence[Any]) -> int:
    """Columns of a block's inputs; sensors: one a joint, or None."""
    return READINGS + 2 * max((0 if sensor is None else sensor.count for sensor in sensors), default=0)


def grid(first: int, count: int, step: float) -> Array:
    """Times of steps in s; rounded, so that 3 * 0.1 is the 0.3 that a user writes."""
    return np.round(np.arange(first, first + count) * step, 12)
