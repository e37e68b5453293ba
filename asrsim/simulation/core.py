"""State of N simulated worlds of one robot in arrays, and the loop that steps the worlds in Python or compiled."""

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
from asrsim.simulation.rows import RowShape, positions_of, shape_of, start_of, tables

SECONDS_SAVED = 20e-6
"""Time in s that compiled code saves per joint and motor substep (measured with 1 to 20 joints: 15 to 30 microseconds)."""
SECONDS_TO_LOAD = 0.6
"""Time in s to import Numba and load the compiled kernel. The first compilation after an installation takes 8 s more."""
SECONDS_WHEN_LOADED = 0.05
"""Time in s to load the compiled kernel if Numba is already imported."""


def is_worth_compiling(joints: int, substeps: int) -> bool:
    """Whether compiled code saves more time than loading it takes. substeps: total number of motor substeps in all runs."""
    start = SECONDS_WHEN_LOADED if "numba" in sys.modules else SECONDS_TO_LOAD
    return joints * substeps * SECONDS_SAVED > start


class Core:
    """N worlds of one robot. The worlds share an engine; a world whose links have other inertias has a separate engine."""

    def __init__(
        self,
        prepared: Prepared,
        engine: Engine,
        *,
        worlds: int = 1,
        compiled: bool = False,
        watch: Callable[[], None] | None = None,
    ) -> None:
        """watch: function that is called before each step of the engine. Raises SimulationError if compiled code is requested
        and not available."""
        self.compiled, self._watch = compiled, watch
        drives, stepping = prepared.drives, prepared.stepping
        self._sensors, self.stepping = prepared.sensors, stepping
        self.shape: RowShape = shape_of(drives, prepared.sensors)
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
        """Table K of `asrsim.simulation.layout`; for the Python loop, a list that contains functions instead of addresses."""
        self._owners: list[Any] = []
        self._bind_laws(drives)
        if compiled:
            from asrsim.simulation.native import compiled_run

            self._run = compiled_run()
        self.S = np.zeros((worlds, len(drives), self.shape.state))
        """State of the worlds, (worlds, joints, columns): table S of `asrsim.simulation.layout`."""
        self.P = np.repeat(constants[None], worlds, axis=0)
        """Parameters of the worlds, (worlds, joints, columns): table P of `asrsim.simulation.layout`."""
        self.done = np.zeros(worlds, dtype=np.int64)
        """Number of completed substeps of each world, (worlds,)."""
        self.fault = np.zeros((worlds, 2), dtype=np.int64)
        """Health of each world (`HEALTHY`, `NO_VALUE`, `RAN_AWAY`) and number of the joint at fault, (worlds, 2)."""
        self._pieces = 1
        """Largest number of pieces of a kick so far."""
        self._engines = [self._bound(engine, prepared)] * worlds
        self.X: Any = [None] * worlds
        """States of the engine: an array (worlds, values) if the engine has a compiled step, else a list of state objects."""
        if isinstance(self._engines[0], NativeEngine):
            self.X = np.zeros((worlds, self._engines[0].size))

    @property
    def native(self) -> bool:
        """Whether the whole loop is machine code, including the engine's step."""
        return isinstance(self._engines[0], NativeEngine)

    def _bound(self, engine: Engine, prepared: Prepared) -> BoundEngine:
        """Adapter for the engine, after the engine has started a run: the engine offers its compiled step only from then on."""
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
        """Address of the actuator's laws."""
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
        """Give a world other parameters, and possibly another engine. The world must then be started again."""
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
        """A copy of the complete state of a world."""
        engine = self._engines[world].state(self.X, world)
        return int(self.done[world]), self.S[world].copy(), self.P[world].copy(), engine

    def put(self, world: int, state: tuple[int, Array, Array, Any]) -> None:
        """Set the complete state of a world. Continuing from this state gives bitwise identical results."""
        self.done[world], self.S[world], self.P[world], engine = state
        self.fault[world] = HEALTHY
        bound = self._engines[world]
        bound.leave(self.X, None)
        bound.engine.state = engine
        bound.entered(self.X, world)

    def engine_of(self, world: int) -> Engine:
        """The engine of a world; the engine may contain the state of another world."""
        return self._engines[world].engine

    def look(self, world: int) -> Engine:
        """The engine of a world, set to the state of this world."""
        self._engines[world].enter(self.X, world)
        return self._engines[world].engine

    # -- running ----------------------------------------------------------------------------------------------------

    def taken(self, given: Given) -> Given:
        """Inputs in the form that `run` takes: lists in plain Python, except for the arrays that the engine receives."""
        if given.cuts.size:
            self._pieces = max(self._pieces, int((given.cuts[..., 2] - given.cuts[..., 1]).max()))
        if self.compiled:
            return given
        lists: Any = [table.tolist() for table in given]
        return Given(*lists)._replace(wrenches=given.wrenches, lengths=given.lengths)

    def run(self, which: NDArray[np.int64], given: Given, *options: Any) -> None:
        """Advance worlds with the inputs `given`. options: first, count, every, watched, columns, out, last_rows,
        last_references; see `asrsim.simulation.kernel.run`. Exceptions of laws and of the engine are passed on."""
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
        exchange, record = bound.borrow(self._pieces, given.wrenches.shape[2])
        self._run(
            which, *options[:4], self.done, self.fault, self.S, self.P, self._kinds, self._z,
            self.X if native else self.S[:, 0], *given, exchange, bound.step, record.address, *options[4:],
        )  # fmt: skip
        bound.give_back(record)

    def _plain(self, bound: BoundEngine, which: NDArray[np.int64], given: Given, *options: Any) -> None:
        ((world, *places),) = which.tolist()
        bound.enter(self.X, world)
        state = self.S[world].tolist()
        exchange, _ = bound.borrow(self._pieces, given.wrenches.shape[2])
        own = slice(world, world + 1)
        columns, out, last_rows, last_references = options[4:]
        try:
            plain: Any = kernel.run
            plain(
                [(0, *places)], *options[:4], self.done[own], self.fault[own], [state], [self.P[world].tolist()], self._kinds,
                self._z.tolist(), [None], *given, exchange.data, bound.step, 0, columns.tolist(), out.data,
                last_rows[own].data, last_references[own].data,
            )  # fmt: skip
        finally:
            self.S[world] = state


def make_core(
    prepared: Prepared, engine: Engine, *, compiled: bool | None, substeps: int, worlds: int = 1,
    watch: Callable[[], None] | None = None,
) -> tuple[Core, str]:  # fmt: skip
    """A core, and the reason why its loop runs in Python although compiled code would be faster (empty if there is no such
    reason).

    compiled: whether the loop is compiled; None: as the scenario states, else according to `is_worth_compiling` for this number
    of substeps. worlds, watch: as in `Core`. Raises SimulationError if compiled code is requested but not available.
    """
    wanted, slow_because = prepared.scenario.compiled if compiled is None else compiled, ""
    if wanted or (
        wanted is None and is_worth_compiling(len(engine.joints), worlds * substeps * prepared.resolution.motor_substeps)
    ):
        try:
            if not available():
                raise SimulationError("Numba is not installed")
            return Core(prepared, engine, worlds=worlds, compiled=True, watch=watch), ""
        except SimulationError as error:
            if wanted:
                raise
            slow_because = str(error)
    return Core(prepared, engine, worlds=worlds, watch=watch), slow_because
