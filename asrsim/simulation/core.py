"""State of N simulated worlds of one robot in arrays, and the loop that steps the worlds in Python or compiled."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import cache
from typing import Any
from weakref import finalize

import numpy as np
from numpy.typing import NDArray

from asrsim.compiled.compiling import numba_available
from asrsim.engines.base import Engine
from asrsim.errors import SimulationError
from asrsim.samples import Array
from asrsim.simulation import interpreted, kernel
from asrsim.simulation.arguments import Common, Corrections, RowSelection, Stretch, Tables
from asrsim.simulation.bound_engine import BoundEngine, CalledEngine, NativeEngine
from asrsim.simulation.fields import JointConstants, JointState, joint_of_row, link_of_row, row_of_joint
from asrsim.simulation.inputs import Given
from asrsim.simulation.layout import HEALTH
from asrsim.simulation.prepared import Prepared
from asrsim.simulation.quantities import RowColumns
from asrsim.simulation.released import released_step
from asrsim.simulation.rows import constants_table, kinds_of, scheme_of, start_of, table_of_kinds
from asrsim.simulation.shape import RowShape, shape_of
from asrsim.simulation.strides import ALWAYS_ALL, Strides

SECONDS_SAVED = 20e-6
"""Time in s that compiled code saves per joint and motor substep (measured with 1 to 20 joints: 15 to 30 microseconds)."""
SECONDS_TO_LOAD = 0.6
"""Time in s to import Numba and load the compiled kernel. The first compilation after an installation takes 17 s more."""
SECONDS_WHEN_LOADED = 0.05
"""Time in s to load the compiled kernel if Numba is already imported."""


UNOBSERVED = Corrections(np.zeros((0, 0, 0, 0)), np.zeros(2), np.zeros((3, 0), dtype=np.int64))
"""Empty corrections, for worlds without an observer."""


def is_worth_compiling(joints: int, substeps: int) -> bool:
    """Whether compiled code saves more time than loading it takes. substeps: total number of motor substeps in all runs."""
    start = SECONDS_WHEN_LOADED if "numba" in sys.modules else SECONDS_TO_LOAD
    return joints * substeps * SECONDS_SAVED > start


class Core:
    """N worlds of one robot, which share an engine. A world whose links have other inertias than the links in this engine has a
    separate engine, unless it is the only world and the engine can take its inertias.
    """

    def __init__(
        self,
        prepared: Prepared,
        engine: Engine,
        *,
        worlds: int = 1,
        compiled: bool = False,
        watch: Callable[[], None] | None = None,
        strides: Strides = ALWAYS_ALL,
    ) -> None:
        """engine: engine of the prepared scenario, which `close` closes. watch: function that is called before each step of the
        engine. Raises SimulationError if compiled code is requested and not available.
        """
        self.prepared, self.compiled, self._watch, self._strides = prepared, compiled, watch, strides
        drives = prepared.drives
        self._scheme = scheme_of(prepared)
        self._code: Any = interpreted
        if compiled:
            from asrsim.simulation import native

            self._code, self._run = native, native.compiled_run()
        self._owners: list[Any] = []
        """References to the functions that the kernel calls by address, so that Python does not delete these functions."""
        self.shape: RowShape = shape_of(drives)
        constants = self._bind_joints()
        self._plain_joints: dict[int, list[JointState]] = {}
        self._plain_links: dict[int, list[JointConstants]] = {}
        """States and constants of the joints as records, by number of the world; the Python loop makes them when needed."""
        self._advanced: set[int] = set()
        """Worlds whose records of joints are newer than their rows of S: the rows are updated only when they are read."""
        self._joint_states = np.zeros((worlds, len(drives), self.shape.state))
        self.P = np.repeat(constants[None], worlds, axis=0)
        """Parameters of the worlds, (worlds, joints, columns): table P of `asrsim.simulation.fields`."""
        self.held = np.full((worlds, len(drives), self.shape.goals), np.nan)
        """Inputs that callers have set, (worlds, joints, input columns), in place of the scenario's signals; NaN: not set."""
        self.done = np.zeros(worlds, dtype=np.int64)
        """Number of completed substeps of each world, (worlds,)."""
        self.strides = np.zeros((worlds, 3), dtype=np.int64)
        """Stride of each world, and the numbers from which its next stride is chosen; see
        `asrsim.simulation.arguments.Tables`.
        """
        self.fault = np.zeros((worlds, 2), dtype=np.int64)
        """Health of each world (`asrsim.simulation.layout.HEALTH`) and number of the joint at fault, (worlds, 2)."""
        self.corrections = UNOBSERVED
        """Corrections by an observer."""
        self._world_tables: Tables | None = None
        """Tables of the worlds for the compiled kernel; None after the size of a table has changed."""
        self._pieces = 1
        """Largest number of pieces of a kick so far."""
        self._states: Array | None = None
        """States of the engine, (worlds, values), if the engine has a compiled step."""
        self._own: dict[int, BoundEngine] = {}
        """Separate engines, by number of the world that has used one."""
        self._shared = self._bound(engine, prepared)
        self._shared_inertials = prepared.robot.inertials
        """Inertials of the links in the shared engine."""
        self._engines = [self._shared] * worlds
        """Engine of each world."""

    def _bind_joints(self) -> Array:
        """Make the kinds of the joints, with the addresses of their laws. Returns the table P (joints, ...)."""
        drives, stepping = self.prepared.drives, self.prepared.stepping
        constants = constants_table(self.prepared, self.shape)
        kinds = kinds_of(drives, self.shape)
        # Bind a law only once for all joints with the same actuator and stages, since each binding computes a digest and looks
        # for the compiled law in the cache folder.
        bound_law: Any = cache(self._code.bound_law)
        bound_step: Any = cache(self._code.bound_step)
        for kind, drive, stages in zip(kinds, drives, self.shape.stages, strict=True):
            if kind.sprung:
                kind.spring_law = self._address(bound_law(drive.actuator, drive.positions, stages))
            if stepping.released:
                kind.joint_step = self._address(bound_step(released_step))
        # For the Python loop, the kinds are records with functions instead of addresses. Sizes are Python integers, since
        # indexing with NumPy integers is slower.
        table: Any = table_of_kinds(kinds, self.shape) if self.compiled else kinds
        own = self._strides
        sizes: Any = np.array(own.sizes, dtype=np.int64) if self.compiled else own.sizes
        schemes = self._code.scheme_table(own.schemes(self._scheme))
        self._common = Common(table, schemes, sizes, own.deflections, own.stiffest, own.shares)
        return constants

    def _make_room(self, prepared: Prepared) -> None:
        """Add columns and laws for stages that the new parameters need and that no world has so far."""
        shape = shape_of(prepared.drives, self.shape)
        if shape == self.shape:
            return
        self.shape = shape
        self._bind_joints()
        self._world_tables = None
        self._joint_states, self.P = _widened(self.joint_states, shape.state), _widened(self.P, shape.constants)
        self._plain_joints, self._plain_links = {}, {}

    def _address(self, function: Any) -> Any:
        """Address at which the kernel calls a function; in Python, the function itself."""
        self._owners.append(function)
        return function.address if self.compiled else function

    def record(self, columns: RowColumns, *, watched: bool) -> None:
        """Set what is recorded at whole steps. watched: whether energies and limits are computed."""
        self.columns, self._world_tables = columns, None
        self.rows = np.full((*self.joint_states.shape[:2], len(columns.place)), np.nan)
        found = (columns.of_state, columns.of_inputs) if self.compiled else (columns.read_state, columns.read_inputs)
        self._recorded = RowSelection(self.prepared.resolution.substeps, int(watched), *found)
        """Row (worlds, joints, columns) of each world at its last whole step."""

    @property
    def native(self) -> bool:
        """Whether the whole loop is machine code, including the engine's step."""
        return isinstance(self._shared, NativeEngine)

    def close(self) -> None:
        """Close the engines. Separate engines are closed when no snapshot refers to them any longer."""
        self._shared.engine.close()
        self._own, self._engines = {}, [self._shared] * len(self._engines)

    # -- engines ----------------------------------------------------------------------------------------------------

    def _bound(self, engine: Engine, prepared: Prepared) -> BoundEngine:
        """Start the engine, and return its adapter. Only an engine that has started a run offers its compiled step."""
        self._start_engine(engine, prepared)
        native = engine.native if self.compiled else None
        if native is None or self._watch is not None:
            wrenches = len(prepared.scenario.wrenches)
            return CalledEngine(engine, wrenches, self._watch) if self.compiled else BoundEngine(engine, self._watch)
        if self._states is None:
            self._states = np.zeros((len(self.joint_states), native.size))
        return NativeEngine(engine, native, self._states, self._strides.sizes)

    def _start_engine(self, engine: Engine, prepared: Prepared) -> Any:
        return engine.start(
            prepared.initial_positions,
            prepared.initial_velocities,
            step=self._scheme.step,
            staggered=prepared.stepping.staggered,
            implicitness=self._scheme.link_implicitness,
        )

    def take_over(self, world: int, prepared: Prepared) -> None:
        """Give a world other parameters. The world must then be started again."""
        self._make_room(prepared)
        self.P[world] = constants_table(prepared, self.shape)
        self._plain_links.pop(world, None)
        self._engines[world] = self._shared
        if not self._fits_shared(prepared):
            own = self._own.get(world)
            if own is None or not own.engine.vary(prepared.robot):
                own = self._bound(prepared.make_engine(), prepared)
                finalize(own, own.engine.close)
            self._own[world] = self._engines[world] = own

    def _fits_shared(self, prepared: Prepared) -> bool:
        """Whether the shared engine has the inertials of this scenario. If there is only one world, its engine takes the
        inertials if it can."""
        if prepared.robot.inertials == self._shared_inertials:
            return True
        if len(self._engines) > 1 or not self._shared.engine.vary(prepared.robot):
            return False
        self._shared_inertials = prepared.robot.inertials
        return True

    # -- state ------------------------------------------------------------------------------------------------------

    def start(self, world: int, prepared: Prepared) -> None:
        """Set a world to the initial state of a run."""
        bound = self._engines[world]
        bound.leave()
        placed = self._start_engine(bound.engine, prepared)
        rows = zip(prepared.drives, *placed, strict=True)
        self.joint_states[world] = [row_of_joint(start_of(drive, self.shape, q, v)) for drive, q, v in rows]
        self._plain_joints.pop(world, None)
        self.held[world] = self.rows[world] = np.nan
        self.done[world], self.fault[world] = 0, HEALTH.healthy
        self.strides[world, :2] = 0, kernel.PATIENCE
        bound.entered(world)

    @property
    def joint_states(self) -> NDArray[Any]:
        """State of the worlds, (worlds, joints, columns): table S of `asrsim.simulation.fields`."""
        while self._advanced:
            world = self._advanced.pop()
            self._joint_states[world] = [row_of_joint(joint) for joint in self._plain_joints[world]]
        return self._joint_states

    @property
    def _tables(self) -> tuple[NDArray[Any], ...]:
        return self.done, self.fault, self.joint_states, self.P, self.held, self.rows, self.strides

    def state(self, world: int) -> tuple[Any, ...]:
        """A copy of the complete state of a world, with the world's engine: only this engine can continue from this state."""
        return *(table[world].copy() for table in self._tables), self._engines[world], self._engines[world].state(world)

    def put(self, world: int, prepared: Prepared, state: tuple[Any, ...]) -> None:
        """Set the complete state of a world, and the parameters of this state. A run that continues from this state gives
        bitwise identical results.
        """
        *values, bound, engine = state
        for table, row in zip(self._tables, values, strict=True):
            # Widen the saved row if columns for further stages were added after it was saved.
            table[world] = row if row.shape == table[world].shape else _widened(row, table.shape[-1])
        self._plain_joints.pop(world, None)
        self._plain_links.pop(world, None)
        self._engines[world] = bound
        if bound is self._shared:
            self._fits_shared(prepared)
        else:
            self._own[world] = bound
            bound.engine.vary(prepared.robot)
        bound.put(world, engine)

    def engine_of(self, world: int) -> Engine:
        """The engine of a world; the engine may contain the state of another world."""
        return self._engines[world].engine

    def look(self, world: int) -> Engine:
        """The engine of a world, after the world's state has been loaded into it."""
        self._engines[world].enter(world)
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

    def run(self, which: NDArray[np.int64], given: Given, first: int, count: int, out: Array) -> None:
        """Advance worlds by `count` substeps with the inputs `given`, and record rows in `out`. which, first: see
        `asrsim.simulation.kernel.run`. Exceptions of laws and of the engine are passed on.
        """
        bounds = [self._engines[world] for world in which[:, 0].tolist()]
        if isinstance(bounds[0], NativeEngine) and bounds.count(bounds[0]) == len(bounds):
            self._call(bounds[0], which, given, first, count, out)
            return
        call = self._call if self.compiled else self._plain
        for place, bound in enumerate(bounds):
            if not isinstance(bound, NativeEngine):
                bound.enter(int(which[place, 0]))
            call(bound, which[place : place + 1], given, first, count, out)

    def _call(self, bound: BoundEngine, which: NDArray[np.int64], given: Given, first: int, count: int, out: Array) -> None:
        """Run the compiled kernel."""
        tables, engine = self._world_tables, bound.borrow(self._pieces)
        if tables is None:
            states = self.joint_states[:, 0] if self._states is None else self._states
            tables = self._world_tables = Tables(
                self.joint_states, self.P, states, self.done, self.fault, self.rows, self.strides
            )
        self._run(Stretch(which, first, count), tables, self._common, given, engine, self._recorded, self.corrections, out)
        bound.give_back(engine)

    def _plain(self, bound: BoundEngine, which: NDArray[np.int64], given: Given, first: int, count: int, out: Array) -> None:
        """Run the kernel in Python, for one world."""
        ((world, *places),) = which.tolist()
        if world not in self._plain_joints:
            shape = self.shape
            self._plain_joints[world] = [
                joint_of_row(row, shape.motors, shape.sensors, shape.kept) for row in self.joint_states[world].tolist()
            ]
        if world not in self._plain_links:
            pairs = zip(self.P[world].tolist(), self.prepared.drives, self.shape.stages, strict=True)
            self._plain_links[world] = [
                link_of_row(row, self.shape.motors, len(drive.elastic), drive.motors, stages) for row, drive, stages in pairs
            ]
        state, engine = self._plain_joints[world], bound.borrow(self._pieces)
        # Use memory views, whose items are read and written several times faster than the items of an array.
        shown = self.done, self.fault, self.rows, self.strides
        done, fault, rows, strides = (table[world : world + 1].data for table in shown)
        tables, views = Tables([state], [self._plain_links[world]], [None], done, fault, rows, strides), out.data
        self._advanced.add(world)
        stretch = Stretch([(0, *places)], first, count)
        kernel.run(stretch, tables, self._common, given, engine, self._recorded, UNOBSERVED, views)


def _widened(table: Array, columns: int) -> Array:
    """The table, extended by columns of zeros to (..., columns). A zero means that no stage acts."""
    wide = np.zeros((*table.shape[:-1], columns))
    wide[..., : table.shape[-1]] = table
    return wide


def make_core(
    prepared: Prepared,
    engine: Engine,
    *,
    compiled: bool | None,
    substeps: int,
    worlds: int,
    watch: Callable[[], None] | None,
    strides: Strides = ALWAYS_ALL,
) -> tuple[Core, str]:
    """A core, and the reason why its loop runs in Python although compiled code would be faster (empty if there is no such
    reason).

    compiled: whether the loop is compiled; None: as the scenario states; if the scenario states nothing, according to
    `is_worth_compiling` for this number of substeps. worlds, watch: as in `Core`. Raises SimulationError if compiled code is
    requested but not available.
    """
    wanted, slow_because = prepared.scenario.compiled if compiled is None else compiled, ""
    if wanted or (
        wanted is None and is_worth_compiling(len(engine.joints), worlds * substeps * prepared.resolution.motor_substeps)
    ):
        try:
            if not numba_available():
                raise SimulationError("Numba is not installed")
            return Core(prepared, engine, worlds=worlds, compiled=True, watch=watch, strides=strides), ""
        except SimulationError as error:
            if wanted:
                raise
            slow_because = str(error)
    return Core(prepared, engine, worlds=worlds, watch=watch), slow_because
