"""Worlds of one robot: all that decides how their runs go on, in arrays, and the loop over them, plain or compiled."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from asrsim.compiling import available
from asrsim.engines.base import Engine
from asrsim.errors import SimulationError
from asrsim.samples import Array
from asrsim.simulation import kernel
from asrsim.simulation.bound_engine import BoundEngine, NativeEngine, bind_engine
from asrsim.simulation.drives import SteppedJoint
from asrsim.simulation.inputs import Given
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

    def engine_of(self, world: int) -> Engine:
        """The engine of a world, in whatever state."""
        return self._engines[world].engine

    def look(self, world: int) -> Engine:
        """The engine, with the world's state in it."""
        self._engines[world].enter(self.X, world)
        return self._engines[world].engine

    # -- running ----------------------------------------------------------------------------------------------------

    def taken(self, given: Given) -> Given:
        """The inputs as :meth:`run` takes them: in plain Python, lists."""
        if self.compiled:
            return given
        lists: Any = [table if table is given.wrenches else table.tolist() for table in given]
        return Given(*lists)

    def run(self, which: NDArray[np.int64], given: Given, *options: Any) -> None:
        """Advance worlds by rows of what is given; options: first, count, every, watched, columns, out, rows, references; see
        :func:`asrsim.simulation.kernel.run`. Raises what a law or the engine raises."""
        bounds = [self._engines[world] for world in which[:, 0].tolist()]
        if isinstance(bounds[0], NativeEngine) and bounds.count(bounds[0]) == len(bounds):
            self._call(bounds[0], which, given, *options)
            return
        run = self._call if self.compiled else self._plain
        for place, bound in enumerate(bounds):
            run(bound, which[place : place + 1], given, *options)

    def _call(self, bound: BoundEngine, which: NDArray[np.int64], given: Given, *options: Any) -> None:
        native = isinstance(bound, NativeEngine)
        if not native:
            bound.enter(self.X, int(which[0, 0]))
        exchange, record = bound.borrow(given.wrenches[0, 0])
        self._run(
            which, *options[:4], self.done, self.fault, self.S, self.P, self._kinds, self._z,
            self.X if native else self.S[:, 0], *given, exchange, bound.step, record.address, *options[4:],
        )  # fmt: skip
        bound.give_back(record)

    def _plain(self, bound: BoundEngine, which: NDArray[np.int64], given: Given, *options: Any) -> None:
        ((world, *places),) = which.tolist()
        bound.enter(self.X, world)
        state = self.S[world].tolist()
        exchange, _ = bound.borrow(given.wrenches[0, 0])
        own = slice(world, world + 1)
        columns, out, rows, references = options[4:]
        try:
            plain: Any = kernel.run
            plain(
                [(0, *places)], *options[:4], self.done[own], self.fault[own], [state], [self.P[world].tolist()], self._kinds,
                self._z.tolist(), [None], *given, exchange.data, bound.step, 0, columns.tolist(), out.data, rows[own].data,
                references[own].data,
            )  # fmt: skip
        finally:
            self.S[world] = state


def make_core(
    prepared: Prepared, engine: Engine, *, compiled: bool | None, substeps: int, worlds: int = 1,
    watch: Callable[[], None] | None = None,
) -> tuple[Core, str]:  # fmt: skip
    """The core, and why it is the plain one where compiled code would pay; empty where it would not.

    compiled: whether it is; None: the scenario's choice, else where it pays in a run of so many substeps. Raises
    SimulationError where it cannot be had and is asked for. worlds, watch: as of :class:`Core`.
    """
    wanted, slow_because = prepared.scenario.compiled if compiled is None else compiled, ""
    if wanted or (wanted is None and pays(len(engine.joints), worlds * substeps * prepared.resolution.motor_substeps)):
        try:
            if not available():
                raise SimulationError("Numba is not installed")
            return Core(prepared, engine, worlds=worlds, compiled=True, watch=watch), ""
        except SimulationError as error:
            if wanted:
                raise
            slow_because = str(error)
    return Core(prepared, engine, worlds=worlds, watch=watch), slow_because
