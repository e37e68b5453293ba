"""The loop: what the joints do, one substep of the engine after the other; every substep is recorded.

One source of a substep (:mod:`asrsim.simulation.substep`) serves three ways of running it: plain Python; compiled, with the
engine stepped from Python; and a whole stretch compiled, where the engine has a kernel.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from asrsim import compiling
from asrsim.engines.base import Engine
from asrsim.errors import SimulationError
from asrsim.samples import Array
from asrsim.simulation import stretch
from asrsim.simulation.damping import make_damping_law, mean_response
from asrsim.simulation.drives import SteppedJoint
from asrsim.simulation.inputs import Block, input_columns
from asrsim.simulation.kernels import make_substepped
from asrsim.simulation.memory import compiled_memory, flatten, plain_memory, shape_of
from asrsim.simulation.rows import joint_row
from asrsim.simulation.splits import Splits, floats
from asrsim.simulation.steppings import Stepping
from asrsim.simulation.stretches import UNDEFINED, NoValueError, no_kernel, plain_stretch, stepped_stretch, whole_stretch
from asrsim.simulation.substep import (
    BRAKE,
    DAMPING,
    LAST_FORCE,
    PREVIOUS,
    RAW,
    WEIGHT,
    Memory,
    Sensing,
    Step,
    chain,
    make_damping,
    make_friction,
    make_group,
    make_sense,
)  # fmt: skip

REFRESH = 256
"""Substeps after which the links' response to torques is looked at again; that of one joint on a fixed base stays."""


INLINE = ("asrsim.simulation.kernels", "asrsim.actuators.motor")
"""Modules whose functions are compiled into their callers: what they are given and give are some twenty numbers."""


class Loop:
    """State of a run: engine, joints, and what the scheme remembers between substeps."""

    def __init__(
        self,
        engine: Engine,
        drives: Sequence[SteppedJoint],
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
        self._motor_substeps = [motor_substeps if drive.dynamic_motors and not stepping.released else 1 for drive in drives]
        self._constants = self._constants_of(self.drives)
        self._flat = [flatten(constants) for constants in self._constants] if compiled else self._constants
        self._rings = [0 if s is None else 2 * (s.delay + 2) + 3 for s in sensings]
        self._memories = [self._memory(j) for j in range(count)]
        self._kinds = self._damped, self._varying, _ = _kinds(drives)
        self._refreshed = self._damped and (count > 1 or floating or make_damping_law(drives[0]) is not None)
        self._coupled: bool | None = None
        self.reset()
        self.refresh_response(0)
        damping = make_damping(count, coupled=bool(self._coupled)) if self._damped else None
        friction = make_friction(self._varying) if self._varying else None
        laws = chain([*self._groups(engine.unpack, cut=cut), *(step for step in (damping, friction) if step is not None)])
        self._splits = Splits(
            engine, drives, self.joints, self._memories, substep=substep, weights=(self._now, self._before),
            measures=[None if s is None else make_sense(s, m) for s, m in zip(sensings, self._memories, strict=True)],
            damping=damping, friction=friction, cut=cut,
        )  # fmt: skip
        plain = partial(plain_stretch, friction=friction is not None)
        self._stretch = self._compile(laws) if compiled else plain(engine, laws, self.joints)

    # -- setting up -------------------------------------------------------------------------------------------------

    def _constants_of(self, drives: Sequence[SteppedJoint]) -> list[Any]:
        return [drive.constants(self.substep / n) for drive, n in zip(drives, self._motor_substeps, strict=True)]

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
                spring, drive.kind, shape_of(self._constants[j]), self._motor_substeps[j],
                self._sensings[j], law,
            )  # fmt: skip
            members.setdefault(kind, []).append(j)
        steps = []
        for places in members.values():
            drive, substeps = self.drives[places[0]], self._motor_substeps[places[0]]
            advance = make_substepped(drive.advance, substeps, hysteretic=drive.hysteresis is not None)
            steps.append(
                make_group(
                    tuple(places), advance, self._memories[places[0]], unpack, now=self._now, before=self._before,
                    sensing=self._sensings[places[0]], damping=make_damping_law(drive), cut=cut,
                )
            )  # fmt: skip
        return steps

    def _compile(self, laws: Step) -> Any:
        """The substep through Numba, or the whole stretch where the engine has a kernel; raises SimulationError if it cannot
        be."""
        count, engine = len(self.drives), self.engine
        inputs = np.zeros((input_columns(self._sensings), count, 2)).transpose(2, 1, 0)[:1]
        rows = np.zeros((1, count, len(RAW)))
        try:
            kernel = engine.kernel() or no_kernel(engine)
            names = {"laws": laws, "borrow": compiling.borrow(), "move": kernel.move, **kernel.compiled}
            names["give"] = stretch.give_friction if self._varying else stretch.give_forces
            how: dict[str, Any] = {"version": kernel.version, "inline": (*kernel.inline, *INLINE)}
            engine.accelerate()
            if kernel.look is not None:
                wrenches = np.zeros((1, *kernel.world.wrench.shape))
                arguments: tuple[Any, ...] = (0, 1, self.joints, inputs, rows, wrenches, kernel.world)
                names["look"] = kernel.look
                whole = compiling.compile_function(stretch.stretch, arguments, names=names, **how)
                return whole_stretch(kernel, whole, self.joints)
            names |= {"unpack": engine.unpack, "as_tuple": compiling.tuple_reader(0, count)}
            arguments = (0, engine.states_type(), self.joints, inputs, rows, kernel.world)
            one = compiling.compile_function(stretch.substep, arguments, names=names, **how)
        except Exception as error:
            # A law may be any Python, and Numba may fail on it in any way.
            first = next(iter(str(error).strip().splitlines()), type(error).__name__)
            raise SimulationError(f"the joints cannot be compiled: {first}") from error
        return stepped_stretch(engine, kernel, one, self.joints, friction=bool(self._varying))

    def reset(self) -> None:
        """Joints as at the start of a run; the caller sets the engine's state."""
        positions, velocities = self.engine.read()
        count = len(self.drives)
        joints = zip(self.drives, self._sensings, self._flat, positions, velocities, strict=True)
        rows = [joint_row(*joint, self.substep, compiled=self.compiled) for joint in joints]
        width = max(map(len, rows)) if self.compiled else 0
        old = getattr(self, "joints", None)
        for j, row in enumerate(rows):
            row.extend([0.0] * (width - len(row)))
            row.extend([0.0] * (2 * count) if old is None else old[j][-2 * count :])
            if old is not None:
                row[WEIGHT] = old[j][WEIGHT]
                old[j][:] = row
        if old is None:
            self.joints: Any = np.array([*rows, [0.0] * len(rows[0])]) if self.compiled else [*rows, [0, 0]]

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

    def run(self, block: Block, start: int, end: int, room: Array) -> Array:
        """Substeps `start` to `end` of `block`; returns their raw records, the first rows of `room` (n, joints, columns), whose
        columns are :data:`RAW`."""
        rows = room[: end - start]
        first = block.first
        pauses = {k - first for k in block.events} | set(range((-first) % REFRESH, end, REFRESH) if self._refreshed else ())
        if self.watch is not None:
            pauses |= set(range((-first) % self.every, end, self.every))
        position = start
        for pause in sorted(pause for pause in pauses | {end} if start <= pause <= end):
            if pause > position:
                self._smooth(block, position, pause, rows[position - start : pause - start])
                position = pause
            if pause == end:
                break
            if self.watch is not None and (first + pause) % self.every == 0:
                self.watch(first + pause)
            if self._refreshed and first + pause:
                self.refresh_response(first + pause)
            if first + pause in block.events:
                rows[pause - start] = self._splits.run(block, pause)
                position = pause + 1
        return rows

    def _smooth(self, block: Block, start: int, end: int, rows: Array) -> None:
        """Substeps in which no input jumps, into `rows`."""
        try:
            self._stretch(start, end, rows, block)
        except UNDEFINED as fault:
            k, j = (int(number) for number in self.joints[len(self.drives)][:2])
            raise NoValueError(self.drives[j].name, block.first + start + k, str(fault)) from fault

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

    def take_drives(self, drives: Sequence[SteppedJoint]) -> bool:
        """Other numbers for the same kinds of joints; :meth:`reset` puts them to use. False: they need a loop of their own."""
        if all(drive is before for drive, before in zip(drives, self.drives, strict=True)):
            return True
        if _kinds(drives) != self._kinds:
            return False
        if any(drive.values is not before.values for drive, before in zip(drives, self.drives, strict=True)):
            self._constants = self._constants_of(drives)
            self._flat = [flatten(constants) for constants in self._constants] if self.compiled else self._constants
        self.drives = tuple(drives)
        self._splits.take_drives(drives)
        return True

    def joint_states(self) -> tuple[list[float], list[float]]:
        """Positions in rad (m) and velocities in rad/s (m/s) of the joints at the whole step."""
        positions, lagging = self.engine.read()
        now, before = self._now, self._before
        return positions, [float(now * v + before * row[PREVIOUS]) for v, row in zip(lagging, self.joints, strict=False)]

    def motor_states(self) -> list[tuple[float, ...]]:
        """State of each joint's law, as :mod:`asrsim.simulation.kernels` has it."""
        return [floats(memory.load(self.joints[j])) for j, memory in enumerate(self._memories)]


def _kinds(drives: Sequence[SteppedJoint]) -> tuple[bool, tuple[int, ...], list[tuple[str, bool, bool]]]:
    """What a loop is built for: whether links are damped, joints whose friction varies, and the kind of each."""
    damped = any(drive.constant_damping or drive.link_brake or make_damping_law(drive) for drive in drives)
    varying = tuple(j for j, drive in enumerate(drives) if drive.joint.friction_varies)
    return damped, varying, [drive.kind for drive in drives]
