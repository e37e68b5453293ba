"""The loop: what the joints do, one substep of the engine after the other; every substep is recorded.

One source of a substep (:mod:`asrsim.simulation.substep`) serves three ways of running it: plain Python; compiled, with the
engine stepped from Python; and a whole stretch compiled, where the engine has a kernel.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from struct import pack
from typing import Any

import numpy as np

from asrsim import compiling
from asrsim.engines.base import Engine, EngineKernel
from asrsim.errors import SimulationError
from asrsim.samples import Array
from asrsim.simulation import stretch
from asrsim.simulation.damping import make_damping_law, mean_response
from asrsim.simulation.drives import Drive
from asrsim.simulation.inputs import Block, Piece, input_columns
from asrsim.simulation.kernels import make_substepped
from asrsim.simulation.memory import STATE_NUMBERS, compiled_memory, flatten, plain_memory, shape_of
from asrsim.simulation.steppings import Stepping
from asrsim.simulation.substep import (
    BASE,
    BRAKE,
    DAMPING,
    DAMPING_TORQUE,
    EFFORT,
    FASTEST,
    FORCE,
    GAIN_1,
    GAIN_2,
    INERTIA,
    LAG,
    LAST_FORCE,
    LINK_TORQUE,
    PLACES,
    PREVIOUS,
    PUSH_1,
    PUSH_2,
    RATIO,
    RAW,
    READ_1,
    READ_2,
    REST,
    SPEED,
    SPRING,
    STATE,
    TORQUE,
    WEIGHT,
    Memory,
    Sensing,
    Step,
    chain,
    lend,
    make_damping,
    make_group,
    make_sense,
)  # fmt: skip

FLUSH = 4_000
"""Numbers after which plain Python's inputs are taken from and its record moved to compact arrays: short lists stay in the
processor's cache."""
REFRESH = 256
"""Substeps after which the links' response to torques is looked at again."""

UNDEFINED = (ZeroDivisionError, OverflowError, ValueError)
"""What :mod:`math` raises where a law has no finite value."""


class NoValueError(ArithmeticError):
    """A law has no finite value where the run took it; becomes a DivergenceError."""

    def __init__(self, joint: str, substep: int, reason: str) -> None:
        super().__init__(f"its law has no finite value ({reason})")
        self.joint = joint
        self.substep = substep


class Loop:
    """State of a run: engine, joints, and what the scheme remembers between substeps."""

    def __init__(
        self,
        engine: Engine,
        drives: Sequence[Drive],
        stepping: Stepping,
        *,
        substep: float,
        motor_substeps: int,
        sensings: Sequence[Sensing | None],
        cut: bool,
        compiled: bool,
        floating: bool = False,
        every: int = 1,
        watch: Callable[[int], None] | None = None,
    ) -> None:
        self.engine = engine
        self.every, self.watch = every, watch
        """Substeps between looks at the world, and who looks: told the substep, before it."""
        self.drives = tuple(drives)
        self.stepping = stepping
        self.substep = substep
        self.compiled = compiled
        self._floating = floating
        self._sensings = tuple(sensings)
        self._now, self._before = (1.5, -0.5) if stepping.staggered else (1.0, 0.0)
        count = len(self.drives)
        self._kinds = [drive.advance for drive in drives]
        self._motor_substeps = [motor_substeps if drive.dynamic_motors and not stepping.released else 1 for drive in drives]
        self._kinds = [drive.advance for drive in drives]
        self._constants = [d.constants(substep / n) for d, n in zip(drives, self._motor_substeps, strict=True)]
        self._cut_constants: dict[float, list[Any]] = {}
        self._rings = [0 if s is None else 2 * (s.delay + 1) + 3 for s in sensings]
        self._memories = [self._memory(j) for j in range(count)]
        self._damped = any(d.constant_damping or d.link_brake or make_damping_law(d) for d in drives)
        self._coupled: bool | None = None
        self.reset()
        self.refresh_response(0)
        laws = chain(
            [
                *self._groups(engine.unpack, cut=cut),
                *([make_damping(count, coupled=bool(self._coupled))] if self._damped else []),
            ]
        )
        self._damp = make_damping(count, coupled=bool(self._coupled))
        self._measures = [None if s is None else make_sense(s, m) for s, m in zip(sensings, self._memories, strict=True)]
        self._cut = cut
        self._stretch = self._compile(laws) if compiled else self._plain_stretch(laws)

    # -- setting up -------------------------------------------------------------------------------------------------

    def _memory(self, j: int) -> Memory:
        if not self.compiled:
            return plain_memory()
        return compiled_memory(self.drives[j].initial_state, self._constants[j], self._rings[j])

    def _groups(self, unpack: Callable[[Any, int], tuple[float, float]], *, cut: bool) -> list[Step]:
        """A step for each kind of joint; in plain Python the kinds that stand side by side in the record's order."""
        members: dict[Any, list[int]] = {}
        for j, drive in enumerate(self.drives):
            spring = drive.actuator if drive.mode and drive.mode.spring else None
            law = drive.link_damping.ratio > 0.0 if drive.link_damping else False
            kind = (
                spring, drive.advance.__qualname__, shape_of(self._constants[j]), self._motor_substeps[j],
                self._sensings[j], law,
            )  # fmt: skip
            members.setdefault(kind, []).append(j)
        steps = []
        for places in members.values():
            drive, substeps = self.drives[places[0]], self._motor_substeps[places[0]]
            steps.append(
                make_group(
                    tuple(places),
                    make_substepped(drive.advance, substeps) if substeps > 1 else drive.advance,
                    self._memories[places[0]],
                    unpack,
                    now=self._now,
                    before=self._before,
                    sensing=self._sensings[places[0]],
                    damping=make_damping_law(drive),
                    cut=cut,
                )
            )
        return steps

    def _compile(self, laws: Step) -> Any:
        """The substep through Numba, or the whole stretch where the engine has a kernel; raises SimulationError if it cannot
        be."""
        count = len(self.drives)
        inputs, rows = np.zeros((1, count, input_columns(self._sensings))), np.zeros((1, count, len(RAW)))
        try:
            kernel = self.engine.kernel()
            if kernel is not None:
                kernel.load()
                names = {"laws": laws, "look": kernel.look, "move": kernel.move, **kernel.compiled}
                arguments: tuple[Any, ...] = (0, 1, self.joints, inputs, rows, np.zeros((1, *kernel.world.wrench.shape)), kernel.world)
                whole = compiling.compile_function(stretch.stretch, arguments, names=names, version=kernel.version)
                self.engine.accelerate()
                return self._whole_stretch(kernel, whole)
            names = {"laws": laws, "as_tuple": compiling.fixed_tuple(count, FORCE)}
            arguments = (0, self.engine.states_type(), self.joints, inputs, rows)
            one = compiling.compile_function(stretch.substep, arguments, names=names)
            self.engine.accelerate()
        except Exception as error:
            # A law may be any Python, and Numba may fail on it in any way.
            first = (str(error).strip().splitlines() or [type(error).__name__])[0]
            raise SimulationError(f"the joints cannot be compiled: {first}") from error
        return self._stepped_stretch(one)

    def reset(self) -> None:
        """Joints as at the start of a run; the engine is somebody else's to put there."""
        positions, velocities = self.engine.read()
        count = len(self.drives)
        rows: list[list[Any]] = []
        for j, (drive, sensing) in enumerate(zip(self.drives, self._sensings, strict=True)):
            row: list[Any] = [0.0] * len(PLACES)
            gains = drive.derivative_gains
            law = drive.link_damping
            given = {
                PREVIOUS: velocities[j], EFFORT: np.inf if drive.joint.effort is None else drive.joint.effort,
                FASTEST: np.inf if drive.joint.velocity is None else drive.joint.velocity, DAMPING: drive.constant_damping,
                BRAKE: drive.link_brake, SPRING: drive.passive_stiffness, REST: drive.joint.spring_reference, WEIGHT: 0.5,
                LAG: drive.stepping.first_drift * self.substep, BASE: drive.constant_damping,
                RATIO: law.ratio if law else 0.0, INERTIA: law.inertia if law else 0.0, GAIN_1: gains[0], GAIN_2: gains[1],
            }  # fmt: skip
            for place, value in given.items():
                row[place] = float(value)
            rings = [self._ring(j, i, positions[j], velocities[j]) for i in range(2)] if sensing else [[], []]
            if self.compiled:
                state = [float(number) for number in drive.initial_state]
                row[STATE:] = [*state, *([0.0] * (STATE_NUMBERS - len(state))), *flatten(self._constants[j])]
                row += [number for ring in rings for number in ring]
            else:
                row[STATE:] = [drive.initial_state, self._constants[j], *rings]
            rows.append(row)
        if self.compiled:
            width = max(map(len, rows))
            table = np.zeros((count + 1, width + 2 * count))
            for j, row in enumerate(rows):
                table[j, : len(row)] = row
            if hasattr(self, "joints"):
                table[:, -2 * count :] = self.joints[:, -2 * count :]
                table[:, WEIGHT] = self.joints[:, WEIGHT]
                self.joints[:] = table
            else:
                self.joints: Any = table
            return
        old = getattr(self, "joints", None)
        for j, row in enumerate(rows):
            row += [0.0] * (2 * count) if old is None else old[j][-2 * count :]
            if old is not None:
                row[WEIGHT] = old[j][WEIGHT]
        if old is None:
            self.joints = [*rows, [0, 0]]
        else:
            for j, row in enumerate(rows):
                old[j][:] = row

    def _ring(self, j: int, i: int, position: float, velocity: float) -> list[float]:
        """What a sensor saw before the start: the start."""
        state = self.drives[j].initial_state
        sensing = self._sensings[j]
        if sensing is None:
            return []
        x, v = (position, velocity) if sensing.on_link or len(state) < 4 * i + 4 else state[4 * i : 4 * i + 2]
        return [x, v] * (sensing.delay + 1) + [0.0, x, v]

    def refresh_response(self, k: int) -> None:
        """Look at how the links' velocities answer torques, every :data:`REFRESH` substeps; at 0 also at what acts already."""
        model = self.engine.model
        if not self._damped or model is None or k % REFRESH:
            return
        count = len(self.drives)
        positions, velocities = self.engine.read()
        dampings = [row[DAMPING] + row[BRAKE] for row in self.joints[:count]]
        found = mean_response(
            model.mass_matrix(positions), dampings, self.substep, explicit=not self.stepping.staggered, coupled=self._coupled
        )
        self._coupled = found.coupled
        # What a joint feels already, so that the first kick is no jump; on a free base gravity pulls all alike.
        bias = np.zeros(count) if self._floating or k else model.bias(positions, velocities)
        for j in range(count):
            row = self.joints[j]
            row[WEIGHT] = found.weight
            if k == 0:
                row[LAST_FORCE] = float(bias[j])
            end = len(row)
            for i in range(count):
                row[end - 2 * count + i] = float(found.response[j, i])
                row[end - count + i] = float(found.spread[j, i])

    # -- running ----------------------------------------------------------------------------------------------------

    def run(self, block: Block, start: int, end: int) -> Array:
        """Substeps `start` to `end` of `block`; returns (n, joints, columns) raw records, columns as :data:`RAW`."""
        rows = np.empty((end - start, len(self.drives), len(RAW)))
        first = block.first
        marks = {k - first for k in block.events} | set(range((-first) % REFRESH, end, REFRESH))
        if self.watch is not None:
            marks |= set(range((-first) % self.every, end, self.every))
        position = start
        for mark in sorted(mark for mark in marks | {end} if start <= mark <= end):
            if mark > position:
                self._smooth(block, position, mark, rows[position - start : mark - start])
                position = mark
            if mark == end:
                break
            if self.watch is not None and (first + mark) % self.every == 0:
                self.watch(first + mark)
            if first + mark:
                self.refresh_response(first + mark)
            if first + mark in block.events:
                rows[mark - start] = self._split(block, mark)
                position = mark + 1
        return rows

    def _smooth(self, block: Block, start: int, end: int, rows: Array) -> None:
        """Substeps in which no input jumps, into `rows`."""
        try:
            self._stretch(start, end, rows, block)
        except UNDEFINED as fault:
            k, j = (int(number) for number in self.joints[len(self.drives)][:2])
            raise NoValueError(self.drives[j].name, block.first + start + k, str(fault)) from fault

    def _whole_stretch(self, kernel: EngineKernel, whole: Callable[..., Any]) -> Any:
        joints, world = self.joints, kernel.world

        def run(start: int, end: int, rows: Array, block: Block) -> None:
            whole(0, end - start, joints, block.stacked[start:end], rows, block.wrenches[start:end], world)

        return run

    def _plain_stretch(self, laws: Step) -> Any:
        joints, engine, count = self.joints, self.engine, len(self.drives)
        states, advance, own, where = engine.states, engine.advance, joints[:count], joints[count]
        size = max(4, FLUSH // (count * len(RAW)))

        def run(start: int, end: int, rows: Array, block: Block) -> None:
            pushed = block.wrenches.shape[1] > 0
            for first in range(start, end, size):
                stop = min(first + size, end)
                inputs = block.stacked[first:stop].tolist()
                record: list[list[Any]] = [[None] * count for _ in inputs]
                try:
                    for k in range(stop - first):
                        if pushed:
                            _push(engine, block.wrenches[first + k])
                        laws(k, states(), joints, inputs, record)
                        advance([row[FORCE] for row in own])
                except UNDEFINED:
                    where[0] += first - start
                    raise
                numbers = [number for rows_of_joints in record for row in rows_of_joints for number in row]
                taken = np.frombuffer(pack(f"{len(numbers)}d", *numbers))
                rows[first - start : stop - start] = taken.reshape(stop - first, *rows.shape[1:])

        return run

    def _stepped_stretch(self, one: Callable[..., Any]) -> Any:
        joints, engine = self.joints, self.engine
        states, advance = engine.states, engine.advance
        step = getattr(one, "entry", one)

        def run(start: int, end: int, rows: Array, block: Block) -> None:
            inputs, pushed = block.stacked[start:end], block.wrenches.shape[1] > 0
            for k in range(end - start):
                if pushed:
                    _push(engine, block.wrenches[start + k])
                advance(step(k, states(), joints, inputs, rows))

        run.owner = one  # type: ignore[attr-defined]
        return run

    def _split(self, block: Block, index: int) -> Array:
        """One substep whose kick is cut in pieces, with the inputs of each; the first of a run has no piece before t = 0."""
        k = block.first + index
        pieces = block.events[k]
        joints, count = self.joints, len(self.drives)
        positions, lagging = self.engine.read()
        _push(self.engine, block.wrenches[index])
        length = sum(piece.fraction for piece in pieces)
        velocities = [self._now * v + self._before * row[PREVIOUS] for v, row in zip(lagging, joints, strict=False)]
        if k == 0:
            velocities = list(lagging)
        states = [_floats(memory.load(joints[j])) for j, memory in enumerate(self._memories)]
        for j, measure in enumerate(self._measures):
            if measure is not None:
                measure(joints[j], states[j], block.stacked[index, j].tolist(), positions[j], velocities[j])
        means = np.zeros((count, 3))
        sides = np.zeros((2, count, len(RAW) + 1))
        rows: list[list[float]] = []
        side = 0
        for piece in pieces:
            if piece.on_time:
                rows = self._advance_all(piece, k, positions, lagging, velocities, states, 0.0)
                side = 1
            looked = self._advance_all(piece, k, positions, lagging, velocities, states, piece.fraction)
            for j, row in enumerate(looked):
                external = piece.rows[2][j]
                sides[side, j] += 2.0 * piece.fraction * np.array([*row, external])
                means[j] += piece.fraction / length * np.array([row[2], row[LINK_TORQUE], external])
        for j, (torque, applied, external) in enumerate(means.tolist()):
            row = joints[j]
            self._memories[j].save(row, states[j])
            law = make_damping_law(self.drives[j])
            if law is not None:
                row[DAMPING] = law(row, self._constants[j], positions[j], tuple(rows[j][5:]))
            row[SPEED] = lagging[j] + row[WEIGHT] * (lagging[j] - row[PREVIOUS])
            row[PREVIOUS] = lagging[j]
            row[TORQUE] = torque
            braked = row[BRAKE] != 0.0
            row[FORCE] = (torque if braked else applied) + external + row[SPRING] * (row[REST] - positions[j])
        if self._damped:
            self._damp_split(rows, sides, length)
        self.engine.advance([float(row[FORCE]) for row in joints[:count]], length if k == 0 else 1.0)
        if k == 0:
            # The velocity half a step before the start, as if the first kick had been a whole one.
            for j, (start, after) in enumerate(zip(lagging, self.engine.read()[1], strict=True)):
                joints[j][PREVIOUS] = 2.0 * start - after
        block.sides[k] = sides
        return np.array(rows)

    def _damp_split(self, rows: list[list[float]], sides: Array, length: float) -> None:
        """Damping over a kick in pieces, which may be a part of a whole one."""
        count = len(self.drives)
        for row in self.joints[:count]:
            for place in range(len(row) - 2 * count, len(row) - count):
                row[place] = row[place] * length
        before = [row[LINK_TORQUE] for row in rows]
        self._damp(0, None, self.joints, None, [rows])
        for row in self.joints[:count]:
            for place in range(len(row) - 2 * count, len(row) - count):
                row[place] = row[place] / length
        for j, row in enumerate(rows):
            sides[:, j, LINK_TORQUE] += row[LINK_TORQUE] - before[j]
            sides[:, j, DAMPING_TORQUE] = row[DAMPING_TORQUE]

    def _advance_all(
        self,
        piece: Piece,
        k: int,
        positions: Sequence[float],
        lagging: Sequence[float],
        velocities: Sequence[float],
        states: list[Any],
        fraction: float,
    ) -> list[list[float]]:
        """Advance all joints by a fraction of a substep, in `states`; fraction 0 only looks. Returns records."""
        step = self.substep * fraction
        if step not in self._cut_constants:
            self._cut_constants[step] = [drive.constants(step) for drive in self.drives]
        rows = []
        for j, (drive, constants) in enumerate(zip(self.drives, self._cut_constants[step], strict=True)):
            joint = self.joints[j]
            sensed = self._sensings[j] is not None
            state = lend(states[j], float(joint[PUSH_1]), float(joint[PUSH_2])) if sensed else states[j]
            goals = piece.rows[0][j] - float(joint[READ_1]), piece.rows[1][j] - float(joint[READ_2])
            try:
                torque, after, record = self._kinds[j](state, constants, positions[j], velocities[j], *goals)
            except UNDEFINED as fault:
                raise NoValueError(drive.name, k, str(fault)) from fault
            if fraction:
                states[j] = lend(after, -float(joint[PUSH_1]), -float(joint[PUSH_2])) if sensed else after
            if self._cut and abs(lagging[j]) >= joint[FASTEST] and torque * lagging[j] > 0.0:
                torque = 0.0
            limit = float(joint[EFFORT])
            applied = torque if joint[BRAKE] != 0.0 else min(max(torque, -limit), limit)
            rows.append([positions[j], lagging[j], torque, applied, 0.0, *record])
        return rows

    # -- state ------------------------------------------------------------------------------------------------------

    def snapshot(self) -> Any:
        """The joints' state, to be given to `restore`."""
        if self.compiled:
            return self.joints.copy()
        return [[value[:] if isinstance(value, list) else value for value in row] for row in self.joints]

    def restore(self, state: Any) -> None:
        """Continue from a snapshot."""
        if self.compiled:
            self.joints[:] = state
            return
        for row, kept in zip(self.joints, state, strict=True):
            row[:] = [value[:] if isinstance(value, list) else value for value in kept]

    def take_drives(self, drives: Sequence[Drive]) -> None:
        """Other numbers for the same kinds of joints; :meth:`reset` puts them to use."""
        self.drives = tuple(drives)
        self._constants = [d.constants(self.substep / n) for d, n in zip(drives, self._motor_substeps, strict=True)]
        self._cut_constants = {}

    def velocities(self) -> list[float]:
        """rad/s (m/s) of the joints at the whole step."""
        lagging = self.engine.read()[1]
        return [float(self._now * v + self._before * row[PREVIOUS]) for v, row in zip(lagging, self.joints, strict=False)]

    def motor_states(self) -> list[tuple[float, ...]]:
        """State of each joint's law, as :mod:`asrsim.simulation.kernels` has it."""
        return [_floats(memory.load(self.joints[j])) for j, memory in enumerate(self._memories)]


def _floats(values: Any) -> tuple[float, ...]:
    return tuple(float(value) for value in values)


def _push(engine: Engine, wrenches: Array) -> None:
    for index, values in enumerate(wrenches):
        engine.apply_wrench(index, values.tolist())
