"""Inputs of the loop: references and external torques, sampled chunk by chunk, and the kicks in which an input jumps.

A run is divided into chunks. After each chunk, samples go to the sinks, the energy is checked, and progress is reported.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from functools import cache, cached_property, lru_cache
from types import FunctionType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from asrsim.actuators import Actuator
from asrsim.actuators.vectorised import over_arrays
from asrsim.compiled.compiling import compile_function
from asrsim.errors import InputError
from asrsim.samples import Array, grid, picking
from asrsim.scenario.data import Scenario, for_joint
from asrsim.signals import Constant
from asrsim.signals.base import Signal
from asrsim.simulation.drives import SteppedJoint
from asrsim.simulation.imperfections import Imperfect, Sensor
from asrsim.simulation.layout import GOALS

REST = Constant(value=0.0)
LONGEST = 4096
"""Largest number of substeps in a chunk. With five joints, chunks three times as long make a run 4 % slower."""
LONGEST_NUMBERS = 61_440
"""Largest number of substeps times joints in a chunk, so that its arrays fit into the processor's cache."""
LONGEST_WORK = 10_000_000
"""Largest number of motor substeps of all joints in a chunk. They take about half a second, after which a run can be
stopped."""
SHORTEST = 1024
"""Number of substeps in the first chunks; later chunks are longer."""
SLACK = 1e-6
"""Times that differ by less than this fraction of a substep count as equal."""
KEPT = 4
"""Number of chunks that are cached, since worlds may be at different times, and may return to their initial states."""


class Given(NamedTuple):
    """Inputs of n substeps, in n rows and a further row for each piece of a kick that is split.

    Worlds whose rows of `inputs` and `references` are equal share a set of these two tables. Worlds with the same signals at
    the same time share a set of `wrenches`, `lengths` and `cuts`.
    """

    inputs: Array
    """External torques, references mapped to motors, and two columns for each sensor (whether the sensor takes a sample at the
    beginning of the piece, and the noise); shape (sets, rows, joints, columns). If the kick of a substep is split, the row of
    the substep contains the inputs at the time of the substep.
    """
    references: Array
    """External torques and references before the reference map, and, if commands have imperfections, the references as they
    were sent, without imperfections; shape (sets, rows, joints, columns).
    """
    wrenches: Array
    """Forces (N) and torques (N m) of the w wrenches; shape (sets, rows, w, 6)."""
    lengths: Array
    """Length of each kick or piece of a kick as a fraction of a substep; shape (sets, rows). The length is 1 for a kick that is
    not split."""
    cuts: NDArray[np.int64]
    """Split kicks, shape (sets, c, 4). Each entry contains the row of the kick, the row of its first piece, the row after its
    last piece, and the row of the piece that begins at the time of the substep. Unused entries are -1.
    """


class Inputs:
    """All input signals of a run, and the measurements of its sensors, by joint."""

    def __init__(
        self, scenario: Scenario, drives: Sequence[SteppedJoint], *, substep: float, staggered: bool, longest: int
    ) -> None:
        """substep: length of a substep in s. longest: largest number of substeps in a chunk."""
        self.substep, self.staggered, self._longest = substep, staggered, longest
        self._chunk = lru_cache(maxsize=KEPT)(self._make_chunk)
        self._sensors = [drive.sensor for drive in drives]
        self._sensed = 2 * max((sensor.count for sensor in self._sensors if sensor is not None), default=0)
        self._wrenches = [[signal or REST for signal in (*wrench.force, *wrench.torque)] for wrench in scenario.wrenches]
        mapped: dict[type[Actuator], list[int]] = {}
        for index, drive in enumerate(drives):
            if drive.actuator and drive.mode and drive.mode.mapped:
                mapped.setdefault(drive.actuator, []).append(index)
        self._maps = [(picking(rows), over_arrays(actuator.motor_references)) for actuator, rows in mapped.items()]
        self._laws = [actuator.motor_references for actuator in mapped]
        self._mapped = np.zeros(len(drives), dtype=bool)
        """Whether the references of each joint are mapped to its motors, (joints,)."""
        for rows in mapped.values():
            self._mapped[rows] = True
        self._signals = signals_of(scenario, drives)
        listed = [signal for row in (*self._signals, *self._wrenches) for signal in row if type(signal) is not Constant]
        self._jumping: dict[int, Signal | Sensor] = {id(one): one for one in (*listed, *self._sensors) if one is not None}
        """Signals and sensors that may jump; each is listed once."""
        sent = [[signal.of if isinstance(signal, Imperfect) else signal for signal in row[GOALS:]] for row in self._signals]
        affected = any(isinstance(signal, Imperfect) for row in self._signals for signal in row)
        self._duration = scenario.duration
        self._moving = np.array([[type(signal) is not Constant for signal in row] for row in self._signals])
        """Mask (joints, columns) of the signals that are not constant."""
        self._holds = not self._sensed and all(type(signal) is Constant for row in self._wrenches for signal in row)
        """Whether the inputs are constant if the signals of the joints are constant: no sensors, and constant wrenches."""
        self._goals = len(self._signals[0])
        """Number of columns of the external torque and the references that act."""
        self._recorded = [row + own for row, own in zip(self._signals, sent, strict=True)] if affected else self._signals
        """Signals in the columns of `Given.references`, by joint."""

    @cached_property
    def jumps(self) -> bool:
        """Whether inputs jump after the start of the run, until the scenario ends."""
        return any(one.jumps(self.substep, self._duration).size for one in self._jumping.values())

    def _map(self, inputs: Array, references: Array) -> None:
        """Write the motors' references into inputs (sets, n, joints, columns). references: values before the reference map, an
        array of the same form.
        """
        for joints, law in self._maps:
            mapped = law(references[:, :, joints, GOALS], references[:, :, joints, GOALS + 1])
            inputs[:, :, joints, GOALS : GOALS + len(mapped)] = mapped.transpose(1, 2, 3, 0)

    def _make_chunk(self, first: int, count: int) -> Given:
        """Inputs of the scenario for substeps `first` .. `first + count - 1` (one set). The rows of pieces follow the rows of
        substeps.
        """
        h, now = self.substep, grid(first, count, self.substep)
        begins, ends, cuts = self._pieces(first, count)
        middles = 0.5 * (begins + ends)
        if first == 0 and len(cuts) and cuts[0, 2] - cuts[0, 1] == 1:
            # If no input jumps in the first kick, use the inputs at the start of the run for the whole kick.
            middles[0] = begins[0]
        lengths = np.concatenate([np.ones(count), (ends - begins) / h])
        time = np.concatenate([now, middles])
        references, wrenches = _sampled(self._recorded, time)[None], _sampled(self._wrenches, time, 6)[None]
        goals = self._goals
        inputs = np.empty((*references.shape[:-1], goals + self._sensed))
        inputs[..., :goals], inputs[..., goals:] = references[..., :goals], 0.0
        self._map(inputs, references)
        if self._sensed:
            # A kick begins half a substep before the time of its row. A piece of a split kick begins at the time `begins`.
            since, window = np.concatenate([now, begins]), h
            if self.staggered:
                window = 2.0 * SLACK * h
                since[:count] -= 0.5 * h
                since[cuts[:, 0]] = now[cuts[:, 0]]
            for joint, sensor in enumerate(self._sensors):
                if sensor is not None:
                    sensor.fill(inputs[0, :, joint, goals:], since, SLACK * h, window)
        return Given(inputs, references, wrenches, lengths[None], cuts[None])

    def given(self, substep: int, length: int, held: Array | None) -> Given:
        """Inputs of `length` substeps that lie in one chunk and begin with number `substep`.

        held: values (sets, joints, columns) that override the scenario's inputs; NaN: no override. None: one set without
        overrides.
        """
        first, last = chunk_at(substep, self._longest)
        given = self._chunk(first, last - first)
        begin, end = substep - first, substep - first + length
        if length < last - first:
            cuts = given.cuts
            rows: Any = slice(begin, end)
            if cuts.size:
                cuts = cuts[:, slice(*np.searchsorted(cuts[0, :, 0], (begin, end)).tolist())]
            if cuts.size:
                piece, stop = int(cuts[0, 0, 1]), int(cuts[0, -1, 2])
                rows = np.r_[rows, piece:stop]
                cuts = cuts - np.array([begin, *[piece - length] * 3])
            inputs, references, wrenches, lengths = (table[:, rows] for table in given[:4])
            given = Given(inputs, references, wrenches, lengths, cuts)
        if held is None:
            return given
        # A reference that is set from outside has no imperfections, and acts as it was sent.
        sent = given.references.shape[-1] > self._goals
        wanted = np.concatenate([held, held[..., GOALS:]], axis=-1)[:, None] if sent else held[:, None]
        references = np.where(np.isnan(wanted), given.references, wanted)
        inputs = np.repeat(given.inputs, len(held), axis=0)
        inputs[..., : self._goals] = references[..., : self._goals]
        self._map(inputs, references)
        return given._replace(references=references, inputs=inputs)

    def steady_until(self, substep: int, held: Array) -> int:
        """Substep up to which the rows of `given(substep, length, held)` are equal for any length; `substep` if the rows
        differ."""
        if not self._holds or (np.isnan(held) & self._moving).any():
            return substep
        first, last = chunk_at(substep, self._longest)
        cuts = first + self._chunk(first, last - first).cuts[0, :, 0]
        return int(min(cuts[cuts >= substep], default=last))

    def renew(self, given: Given, held: Array, worlds: NDArray[np.int64]) -> None:
        """Overwrite the rows of `given`, which are equal, with the values `held` that are not NaN. worlds: row of `held` for
        each set of `given`.
        """
        fast = renewal_of(self._laws[0]) if len(self._laws) == 1 else None
        if fast is not None:
            fast(given.inputs, given.references, held, worlds, self._mapped, self._goals)
            return
        goals, held = self._goals, held[worlds]
        inputs, references = given.inputs[:, :1], given.references[:, :1]
        known = held == held
        np.copyto(references[:, 0, :, :goals], held, where=known)
        if references.shape[-1] > goals:
            np.copyto(references[:, 0, :, goals:], held[..., GOALS:], where=known[..., GOALS:])
        inputs[..., :goals] = references[..., :goals]
        self._map(inputs, references)
        if len(given.lengths[0]) > 1:
            given.inputs[:, 1:], given.references[:, 1:] = inputs, references

    def _pieces(self, first: int, count: int) -> tuple[Array, Array, NDArray[np.int64]]:
        """Pieces of the first kick of a run and of the kicks in which inputs or measurements jump. Returns the times in s at
        which the pieces begin and end, and the table `Given.cuts` (c, 4). A kick is also split at the time of its substep; no
        piece lies before t = 0.
        """
        h = self.substep
        least, start, end = SLACK * h, max((first - 0.5) * h, 0.0), (first + count - 0.5) * h
        jumping = self._jumping.values() if self.staggered else ()
        jumps = np.unique(np.concatenate([np.empty(0), *(one.jumps(start, end) for one in jumping)]))
        at = np.floor(jumps / h + 0.5 + SLACK).astype(np.int64)
        valid = (least < jumps) & (jumps < end - least) & (first <= at) & (at < first + count)
        jumps, at = jumps[valid], at[valid]
        kicks = np.unique(np.append(at, 0) if first == 0 and self.staggered else at)
        # A jump near the time of a substep, or near the end of a kick, does not split the kick further.
        away = abs(jumps - at * h)
        inner = (least < away) & (away < 0.5 * h - least)
        now = kicks * h
        number = np.concatenate([kicks[kicks > 0], kicks, at[inner]])
        begins = np.concatenate([(now - 0.5 * h)[kicks > 0], now, jumps[inner]])
        order = np.lexsort((begins, number))
        number, begins = number[order], begins[order]
        ends = np.append(begins[1:], 0.0)[: len(begins)]
        last = np.append(number[1:] != number[:-1], True)[: len(number)]
        ends[last] = number[last] * h + 0.5 * h
        rows = count + np.searchsorted(number, kicks), count + np.searchsorted(number, kicks, side="right")
        middle = count + np.flatnonzero(begins == number * h)
        return begins, ends, np.column_stack([kicks - first, *rows, middle]).astype(np.int64)


def renew_rows(inputs: Any, references: Any, held: Any, worlds: Any, mapped: Any, goals: int) -> None:
    """Overwrite equal rows of inputs and references (sets, rows, joints, columns) with values (worlds, joints, goals) that are
    not NaN; see `Inputs.renew`.
    """
    sets, rows, joints, columns = inputs.shape
    sent = references.shape[3] > goals
    for w in range(sets):
        for j in range(joints):
            own, values, given = references[w, 0, j], inputs[w, 0, j], held[worlds[w], j]
            for c in range(goals):
                if given[c] == given[c]:
                    own[c] = given[c]
                    if sent and c >= GOALS:
                        own[goals + c - GOALS] = given[c]
                values[c] = own[c]
            if mapped[j]:
                motors = motor_references(own[GOALS], own[GOALS + 1])
                for i in range(len(motors)):
                    values[GOALS + i] = motors[i]
            for row in range(1, rows):
                for c in range(columns):
                    inputs[w, row, j, c] = values[c]
                for c in range(references.shape[3]):
                    references[w, row, j, c] = own[c]


def motor_references(equilibrium: float, preset: float) -> tuple[float, float]:
    """The reference map of the actuator for which `renew_rows` is compiled."""
    raise NotImplementedError


@cache
def renewal_of(law: Any) -> Any:
    """`renew_rows`, compiled for joints with this reference map. None if the law is not a plain function, cannot be compiled,
    or calls functions (whose values for numbers and for arrays may differ in the last bit).
    """
    if not isinstance(law, FunctionType) or law.__code__.co_names or law.__code__.co_freevars:
        return None
    floats, one = np.zeros((1, 1, 1, 1)), np.zeros(1, dtype=np.int64)
    example = floats, floats, np.zeros((1, 1, 1)), one, np.zeros(1, dtype=bool), 1
    with suppress(Exception):
        return compile_function(renew_rows, example, names={"motor_references": law})


def signals_of(scenario: Scenario, drives: Sequence[SteppedJoint]) -> list[list[Signal]]:
    """External torque and references of each joint."""
    slots = range(max(drive.positions for drive in drives))
    return [
        [for_joint(scenario.external_torques, drive.name, REST), *(_reference(scenario, drive, j, slot) for slot in slots)]
        for j, drive in enumerate(drives)
    ]


def _reference(scenario: Scenario, drive: SteppedJoint, j: int, slot: int) -> Signal:
    """Reference number `slot` of joint number `j`; 0 if the joint has fewer references."""
    own, names = drive.drive, drive.references
    if own is None or slot >= len(names):
        return REST
    # By default, motors and controllers hold the initial position that the scenario states, and torques and voltages are 0.
    mode, position = own.mode, slot == 0 or not (own.mode.mapped or own.actuator.adjuster or own.actuator.is_housed(slot))
    moved = position and mode.number != 0 and not mode.direct
    rest = Constant(value=drive.stated_position) if moved else REST
    signal = scenario.references_of(drive.name).get(names[slot], rest)
    if drive.command_imperfections is None:
        return signal
    return Imperfect(of=signal, imperfections=drive.command_imperfections, step=scenario.step, seed=(scenario.seed, j, slot))


def sampled_signals(scenario: Scenario, drives: Sequence[SteppedJoint], time: Array) -> Array:
    """External torques and references (columns, joints, n) of a run at `time` (n,)."""
    return np.ascontiguousarray(_sampled(signals_of(scenario, drives), time).T)


def longest_chunk(joints: int, asked: int | None = None, *, motor_substeps: int = 1) -> int:
    """Largest number of substeps in a chunk for a robot with `joints` joints; `asked` replaces this number, up to the limit of
    the work in a chunk. Raises InputError if `asked` is below 1.
    """
    if asked is not None and not asked >= 1:
        raise InputError("must be at least 1 substep", key="chunk", value=asked, code="chunk")
    longest = asked or max(SHORTEST, min(LONGEST, LONGEST_NUMBERS // joints))
    return max(1, min(longest, LONGEST_WORK // (joints * motor_substeps)))


def chunk_at(substep: int, longest: int) -> tuple[int, int]:
    """First and last substep of the chunk that contains `substep`.

    Chunks end at fixed substeps, so that results do not depend on the grouping of calls. The first chunks are short, so that
    an early divergence is found early.
    """
    begin, length = 0, SHORTEST
    while length <= substep and length < longest:
        begin, length = length, 4 * length
    length = min(length, longest)
    start = substep - substep % length
    return max(begin, start), start + length


def _sampled(signals: Sequence[Sequence[Signal]], time: Array, columns: int = 0) -> Array:
    """Values (n, rows, columns) of a table of signals at `time` (n,). columns: number of columns of a table without rows."""
    values = np.empty((len(time), len(signals), max(map(len, signals), default=columns)))
    # Sample each signal object only once, since joints that share a signal share its samples.
    known: dict[int, Array] = {}
    for row, own in enumerate(signals):
        for column, signal in enumerate(own):
            if type(signal) is Constant:
                values[:, row, column] = signal.value
                continue
            if id(signal) not in known:
                known[id(signal)] = signal.values(time)
            values[:, row, column] = known[id(signal)]
    return values


def joined(parts: Sequence[Given]) -> Given:
    """Inputs with the sets of all `parts`, concatenated; shorter tables are filled up with -1."""
    return parts[0] if len(parts) == 1 else Given(*map(_stacked, zip(*parts, strict=True)))


def _stacked(tables: Sequence[Any]) -> Any:
    longest = max(table.shape[1] for table in tables)
    stacked = np.full((sum(map(len, tables)), longest, *tables[0].shape[2:]), -1, dtype=tables[0].dtype)
    first = 0
    for table in tables:
        stacked[first : first + len(table), : table.shape[1]] = table
        first += len(table)
    return stacked
