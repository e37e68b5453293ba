"""Worlds of one robot: all that decides how their runs go on, in arrays, and the loop over them, plain or compiled."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from asrsim.engines.base import Engine
from asrsim.errors import SimulationError
from asrsim.samples import Array
from asrsim.simulation import kernel
from asrsim.simulation.bound_engine import BoundEngine, NativeEngine, bind_engine
from asrsim.simulation.drives import SteppedJoint
from asrsim.simulation.inputs import Block
from asrsim.simulation.laws import plain_law
from asrsim.simulation.layout import HEALTHY, JOINT_STEP, SPRING_LAW, STEP
from asrsim.simulation.prepared import Prepared
from asrsim.simulation.rows import Shape, positions_of, shape_of, start_of, tables

SECONDS_SAVED = 6e-6
"""What compiled code saves for a joint and motor substep, s: measured 4 to 30; what matters is the order of magnitude."""
SECONDS_TO_LOAD = 0.6
"""Import of Numba and loading the kernel, s; an installation's first compilation costs 8 s more, once."""
SECONDS_WHEN_LOADED = 0.05
"""The same where Numba is imported already."""


def pays(joints: int, substeps: int) -> bool:
    """Compiled code wins back its start; `substeps`: of the motors, in all runs together."""
    start = SECONDS_WHEN_LOADED if "numba" in sys.modules else SECONDS_TO_LOAD
    return joints * substeps * SECONDS_SAVED > start


@dataclass(frozen=True)
class Given:
    """Inputs of some worlds for one call of the kernel; see :func:`asrsim.simulation.kernel.run`."""

    inputs: Array
    """(sets, n, joints, columns)."""
    wrenches: Array
    """(sets, n, w, 6)."""
    cuts: NDArray[np.int64]
    """(sets, c, 3)."""
    fractions: Array
    on_time: NDArray[np.bool_]
    pieces: Array

    def __len__(self) -> int:
        return int(self.inputs.shape[1])


def given_by(block: Block, begin: int, end: int) -> Given:
    """Rows `begin` to `end` of a block, as one set of inputs."""
    places = block.cuts.places
    own = places[(places[:, 0] >= begin) & (places[:, 0] < end)] - np.array([begin, 0, 0])
    rows = slice(begin, end)
    return Given(
        block.inputs[None, rows],
        block.wrenches[None, rows],
        own[None],
        block.cuts.fractions,
        block.cuts.on_time,
        block.cuts.inputs,
    )


class Core:
    """N worlds of one robot. They share an engine; a world whose links have other inertias has one of its own."""

    def __init__(
        self,
        prepared: Prepared,
        engine: Engine,
        *,
        worlds: int = 1,
        compiled: bool = False,
        watch: Callable[[], None] | None = None,
    ) -> None:
        """watch: called before each step of the engine, which has the state then. Raises SimulationError where compiled code
        is asked for and cannot be had."""
        self.compiled, self._watch = compiled, watch
        drives, stepping = prepared.drives, prepared.stepping
        self._sensors, self.stepping = prepared.sensors, stepping
        self.shape: Shape = shape_of(drives, prepared.sensors)
        now, past = (1.5, -0.5) if stepping.staggered else (1.0, 0.0)
        self._link_implicitness = prepared.resolution.link_implicitness
        self._z = np.array([
            prepared.substep, now, past, stepping.first_drift, stepping.implicitness, self._link_implicitness,
            float(stepping.staggered),
        ])  # fmt: skip
        self._options: dict[str, Any] = {
            "motor_substeps": prepared.resolution.motor_substeps,
            "cutoff": prepared.velocity_cutoff,
        }
        kinds, constants = tables(drives, prepared.sensors, self.shape, **self._options)
        self._kinds: Any = kinds if compiled else kinds.tolist()
        """K; in plain Python a list, with functions as addresses."""
        self._owners: list[Any] = []
        self._bind_laws(drives)
        if compiled:
            from asrsim.simulation.native import compiled_run

            self._run = compiled_run()
        self.S = np.zeros((worlds, len(drives), self.shape.state))
        """(worlds, joints, columns): see :mod:`asrsim.simulation.layout`."""
        self.P = np.repeat(constants[None], worlds, axis=0)
        """(worlds, joints, columns)."""
        self.done = np.zeros(worlds, dtype=np.int64)
        """(worlds,) substeps."""
        self.fault = np.zeros((worlds, 2), dtype=np.int64)
        """(worlds, 2) health, and a joint."""
        self._engines = [self._bound(engine, prepared)] * worlds
        self.X: Any = [None] * worlds
        """States of the engine: an array (worlds, numbers) where it has native code, else whatever it has."""
        if isinstance(self._engines[0], NativeEngine):
            self.X = np.zeros((worlds, self._engines[0].size))

    @property
    def native(self) -> bool:
        """Whether the whole loop is machine code."""
        return isinstance(self._engines[0], NativeEngine)

    def _bound(self, engine: Engine, prepared: Prepared) -> BoundEngine:
        """Its native code is that of a run that has started."""
        self._start_engine(engine, prepared.initial_positions, prepared.initial_velocities)
        return bind_engine(engine, compiled=self.compiled, watch=self._watch)

    def _start_engine(self, engine: Engine, positions: Sequence[float], velocities: Sequence[float]) -> Any:
        return engine.start(
            positions, velocities, step=float(self._z[STEP]), staggered=self.stepping.staggered,
            implicitness=self._link_implicitness,
        )  # fmt: skip

    # -- binding ----------------------------------------------------------------------------------------------------

    def _bind_laws(self, drives: Sequence[SteppedJoint]) -> None:
        laws: dict[Any, Any] = {}
        for k, drive in zip(self._kinds, drives, strict=True):
            if drive.actuator is not None and drive.mode is not None and drive.mode.spring:
                key = drive.actuator, positions_of(drive)
                laws[key] = laws.get(key) or self._law_of(*key)
                k[SPRING_LAW] = laws[key]
            if self.stepping.joint_step is not None:
                k[JOINT_STEP] = self._joint_step(self.stepping.joint_step)

    def _law_of(self, actuator: Any, motors: int) -> Any:
        """Its address."""
        if not self.compiled:
            return plain_law(actuator, motors)
        from asrsim.simulation.native import compiled_law

        try:
            law = compiled_law(actuator, motors)
        except Exception as error:
            reason = str(error).strip().splitlines()[0]
            raise SimulationError(f"Numba cannot compile the laws of '{actuator.name}': {reason}") from error
        self._owners.append(law)
        return law.address

    def _joint_step(self, function: Callable[..., None]) -> Any:
        if not self.compiled:
            return function
        from asrsim.simulation.native import compiled_joint_step

        callback = compiled_joint_step(function)
        self._owners.append(callback)
        return callback.address

    def take_over(self, world: int, prepared: Prepared, engine: Engine) -> None:
        """Let a world have other numbers, and maybe another engine; it has to be started anew."""
        _, self.P[world] = tables(prepared.drives, prepared.sensors, self.shape, **self._options)
        if engine is not self._engines[world].engine:
            self._engines[world] = self._bound(engine, prepared)

    # -- state ------------------------------------------------------------------------------------------------------

    def start(
        self, world: int, drives: Sequence[SteppedJoint], positions: Sequence[float], velocities: Sequence[float]
    ) -> None:
        """Put a world at the start of a run."""
        bound = self._engines[world]
        bound.leave(self.X, None)
        placed = self._start_engine(bound.engine, positions, velocities)
        rows = zip(drives, self._sensors, *placed, strict=True)
        self.S[world] = [start_of(drive, sensor, self.shape, q, v) for drive, sensor, q, v in rows]
        self.done[world] = 0
        self.fault[world] = HEALTHY
        bound.entered(self.X, world)

    def state(self, world: int) -> tuple[int, Array, Array, Any]:
        """A copy of all that decides how a world goes on."""
        engine = self._engines[world].state(self.X, world)
        return int(self.done[world]), self.S[world].copy(), self.P[world].copy(), engine

    def put(self, world: int, state: tuple[int, Array, Array, Any]) -> None:
        """Continue from a state, to the bit."""
        self.done[world], self.S[world], self.P[world], engine = state
        self.fault[world] = HEALTHY
        bound = self._engines[world]
        bound.leave(self.X, None)
        bound.engine.state = engine
        bound.entered(self.X, world)

    def look(self, world: int) -> Engine:
        """The engine, with the world's state in it."""
        self._engines[world].enter(self.X, world)
        return self._engines[world].engine

    # -- running ----------------------------------------------------------------------------------------------------

    def run(
        self,
        which: NDArray[np.int64],
        given: Given,
        out: Array,
        *,
        every: int,
        columns: NDArray[np.int64],
        watched: bool = True,
    ) -> None:
        """Advance worlds by the rows that are given; see :func:`asrsim.simulation.kernel.run`. Raises what a law or the engine
        raises."""
        first = self._engines[int(which[0, 0])]
        if isinstance(first, NativeEngine) and all(self._engines[w] is first for w in which[:, 0].tolist()):
            self._call(first, which, given, out, every, columns, watched)
            return
        for place, (world, _) in enumerate(which.tolist()):
            bound = self._engines[world]
            run = self._call if self.compiled else self._plain
            run(bound, which[place : place + 1], given, out[place : place + 1], every, columns, watched)

    def _call(
        self,
        bound: BoundEngine,
        which: NDArray[np.int64],
        given: Given,
        out: Array,
        every: int,
        columns: NDArray[np.int64],
        watched: bool,
    ) -> None:
        native = isinstance(bound, NativeEngine)
        if not native:
            bound.enter(self.X, int(which[0, 0]))
        exchange, record = bound.borrow(given.wrenches[0, 0])
        self._run(
            which, len(given), every, int(watched), self.done, self.fault, self.S, self.P, self._kinds, self._z,
            self.X if native else self.S[:, 0], given.inputs, given.wrenches, given.cuts, given.fractions, given.on_time,
            given.pieces, exchange, bound.step, record.address, columns, out,
        )  # fmt: skip
        bound.give_back(record)

    def _plain(
        self,
        bound: BoundEngine,
        which: NDArray[np.int64],
        given: Given,
        out: Array,
        every: int,
        columns: NDArray[np.int64],
        watched: bool,
    ) -> None:
        ((world, own),) = which.tolist()
        bound.enter(self.X, world)
        state = self.S[world].tolist()
        exchange, _ = bound.borrow(given.wrenches[0, 0])
        done, fault = self.done[world : world + 1], self.fault[world : world + 1]
        try:
            kernel.run(
                [(0, 0)], len(given), every, int(watched), done, fault, [state], [self.P[world].tolist()], self._kinds,
                self._z.tolist(), [None], [given.inputs[own].tolist()], [given.wrenches[own]], [given.cuts[own].tolist()],
                given.fractions.tolist(), given.on_time.tolist(), given.pieces.tolist(), exchange.data, bound.step, 0,
                columns.tolist(), out.data,
            )  # fmt: skip
        finally:
            self.S[world] = state
