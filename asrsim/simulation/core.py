"""Worlds of one robot: all that decides how their runs go on, in arrays, and the loop over them, plain or compiled."""

from __future__ import annotations

import ctypes
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
from asrsim.simulation.drives import SteppedJoint
from asrsim.simulation.inputs import Block
from asrsim.simulation.laws import FUNCTIONS, address_of, plain_laws
from asrsim.simulation.layout import E_VELOCITY, HEALTHY, JOINT_STEP, SPRING_LAW, STATE_LAW
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
        return self.inputs.shape[1]


def given_by(block: Block, begin: int, end: int) -> Given:
    """Rows `begin` to `end` of a block, as one set of inputs."""
    places = block.cuts.places
    own = places[(places[:, 0] >= begin) & (places[:, 0] < end)] - np.array([begin, 0, 0])
    rows = slice(begin, end)
    return Given(
        block.inputs[None, rows], block.wrenches[None, rows], own[None], block.cuts.fractions, block.cuts.on_time, block.cuts.inputs
    )


class Core:
    """N worlds in one engine."""

    def __init__(self, prepared: Prepared, engine: Engine, *, worlds: int = 1, compiled: bool = False) -> None:
        """Raises SimulationError where compiled code is asked for and cannot be had."""
        self.engine = engine
        self.compiled = compiled
        self._plain_step = address_of(self._step_engine)
        self._raised: BaseException | None = None
        self._in_engine = 0
        """World whose state the engine has."""
        self._wrenches = np.zeros((0, 6))
        self._count = worlds
        self.done = np.zeros(worlds, dtype=np.int64)
        """(worlds,) substeps."""
        self.fault = np.zeros((worlds, 2), dtype=np.int64)
        """(worlds, 2) health, and a joint."""
        self._lay_out(prepared)

    def _lay_out(self, prepared: Prepared) -> None:
        drives, sensors, stepping = prepared.drives, prepared.sensors, prepared.stepping
        self._sensors, self.stepping = sensors, stepping
        self.shape: Shape = shape_of(drives, sensors)
        now, past = (1.5, -0.5) if stepping.staggered else (1.0, 0.0)
        self._link_implicitness = prepared.resolution.link_implicitness
        self._z = np.array([
            prepared.substep, now, past, stepping.first_drift, stepping.implicitness, self._link_implicitness,
            float(stepping.staggered),
        ])  # fmt: skip
        self._options = {"motor_substeps": prepared.resolution.motor_substeps, "cutoff": prepared.velocity_cutoff}
        kinds, constants = tables(drives, sensors, self.shape, **self._options)
        self.S = np.zeros((self._count, len(drives), self.shape.state))
        """(worlds, joints, columns): see :mod:`asrsim.simulation.layout`."""
        self.P = np.repeat(constants[None], self._count, axis=0)
        """(worlds, joints, columns)."""
        self._exchange = np.zeros((len(drives), 5))
        self._bind_laws(drives, kinds)
        self._bind_engine()

    # -- binding ----------------------------------------------------------------------------------------------------

    def _bind_laws(self, drives: Sequence[SteppedJoint], kinds: NDArray[np.int64]) -> None:
        self._kinds, self._owners = kinds, list[Any]()
        for k, drive in zip(kinds, drives, strict=True):
            if drive.actuator is not None and drive.mode is not None and drive.mode.spring:
                k[SPRING_LAW], k[STATE_LAW] = self._laws_of(drive)
            if self.stepping.joint_step is not None:
                k[JOINT_STEP] = self._joint_step(self.stepping.joint_step)

    def _laws_of(self, drive: SteppedJoint) -> tuple[int, int]:
        assert drive.actuator is not None
        if not self.compiled:
            return plain_laws(drive.actuator, positions_of(drive))
        from asrsim.simulation.native import compiled_laws

        try:
            torques, state = compiled_laws(drive.actuator, positions_of(drive))
        except Exception as error:
            raise SimulationError(
                f"Numba cannot compile the laws of '{drive.actuator.name}': {str(error).strip().splitlines()[0]}"
            ) from error
        self._owners += [torques, state]
        return torques.address, state.address

    def _joint_step(self, function: Callable[..., None]) -> int:
        if not self.compiled:
            return address_of(function)
        from asrsim.simulation.native import compiled_joint_step

        callback = compiled_joint_step(function)
        self._owners.append(callback)
        return callback.address

    def _bind_engine(self) -> None:
        """The engine's states and its step, as the kernel takes them."""
        self._native = self.engine.native if self.compiled else None
        self.X: Any = [None] * self._count
        """States of the engine: an array (worlds, numbers) where the engine has native code, else whatever it has."""
        if self._native is not None:
            self.X = np.zeros((self._count, self._native.size))
            self._record = self._native.make_record()
            self._engine_step = self._native.address
        elif self.compiled:
            self._dummy = np.zeros((self._count, 1))
            kind = ctypes.CFUNCTYPE(None, *[ctypes.c_ssize_t] * 4, ctypes.c_double)
            self._callback = kind(self._called_back)
            self._engine_step = ctypes.cast(self._callback, ctypes.c_void_p).value or 0
        else:
            self._engine_step = self._plain_step

    def _step_engine(self, x: Any, exchange: Any, wrenches: Array, fraction: float) -> None:
        self.engine.step(self._exchange, wrenches, fraction)

    def _called_back(self, record: int, x: int, exchange: int, wrenches: int, fraction: float) -> None:
        """From compiled code, which no exception may cross: the world stops instead."""
        try:
            if self._raised is None:
                row = self._wrenches
                if len(row):
                    row = np.frombuffer((ctypes.c_double * row.size).from_address(wrenches)).reshape(row.shape)
                self.engine.step(self._exchange, row, fraction)
                return
        except BaseException as error:
            self._raised = error
        self._exchange[:, E_VELOCITY] = np.nan

    # -- state ------------------------------------------------------------------------------------------------------

    def start(self, world: int, drives: Sequence[SteppedJoint], positions: Sequence[float], velocities: Sequence[float]) -> None:
        """Put a world at the start of a run."""
        z, stepping = self._z, self.stepping
        placed = self.engine.start(
            positions, velocities, step=float(z[0]), staggered=stepping.staggered, implicitness=self._link_implicitness
        )
        rows = zip(drives, self._sensors, *placed, strict=True)
        self.S[world] = [start_of(drive, sensor, self.shape, q, v) for drive, sensor, q, v in rows]
        self.done[world] = 0
        self.fault[world] = HEALTHY
        self._in_engine = world
        if self._native is not None:
            self.X[world] = self.engine.state

    def state(self, world: int) -> tuple[int, Array, Array, Any]:
        """A copy of all that decides how a world goes on."""
        return int(self.done[world]), self.S[world].copy(), self.P[world].copy(), self.engine_state(world)

    def put(self, world: int, state: tuple[int, Array, Array, Any]) -> None:
        """Continue from a state, to the bit."""
        self.done[world], self.S[world], self.P[world], engine = state
        self.fault[world] = HEALTHY
        if self._native is not None:
            self.X[world] = engine
        self.engine.state = engine
        self._in_engine = world

    def engine_state(self, world: int) -> Any:
        """The engine's, a copy."""
        if self._native is not None:
            return self.X[world].copy()
        return self.engine.state if self._in_engine == world else self.X[world]

    def look(self, world: int) -> Engine:
        """The engine, with the world's state in it."""
        if self._native is not None:
            self.engine.state = self.X[world]
        else:
            self._switch(world)
        return self.engine

    def _switch(self, world: int) -> None:
        if self._in_engine != world:
            self.X[self._in_engine] = self.engine.state
            self.engine.state = self.X[world]
            self._in_engine = world

    def take_over(self, prepared: Prepared, engine: Engine) -> None:
        """Go on with other numbers, and maybe another engine; all worlds have to be started anew."""
        kinds, constants = tables(prepared.drives, prepared.sensors, self.shape, **self._options)
        laws = [SPRING_LAW, STATE_LAW, JOINT_STEP]
        kinds[:, laws] = self._kinds[:, laws]
        self._kinds, self.P[:] = kinds, constants
        if engine is not self.engine:
            self.engine, self._in_engine = engine, 0
            self._bind_engine()

    # -- running ----------------------------------------------------------------------------------------------------

    def run(
        self, which: NDArray[np.int64], given: Given, out: Array, *, every: int, columns: NDArray[np.int64]
    ) -> None:
        """Advance worlds by the rows that are given; see :func:`asrsim.simulation.kernel.run`. Raises what a law or the engine
        raises."""
        if self._native is not None:
            self._call(which, given, out, every, columns)
            return
        for place, (world, own) in enumerate(which.tolist()):
            self._switch(world)
            (self._call if self.compiled else self._plain)(
                np.array([[world, own]]), given, out[place : place + 1], every, columns
            )

    def _call(
        self, which: NDArray[np.int64], given: Given, out: Array, every: int, columns: NDArray[np.int64]
    ) -> None:
        from asrsim.simulation.native import compiled_run

        native = self._native is not None
        self._wrenches = given.wrenches[0, 0]
        compiled_run()(
            which, len(given), every, self.done, self.fault, self.S, self.P, self._kinds, self._z,
            self.X if native else self._dummy, given.inputs, given.wrenches, given.cuts, given.fractions, given.on_time,
            given.pieces, self._exchange, self._engine_step, self._record.address if native else 0, columns, out,
        )  # fmt: skip
        if self._raised is not None:
            error, self._raised = self._raised, None
            raise error

    def _plain(
        self, which: NDArray[np.int64], given: Given, out: Array, every: int, columns: NDArray[np.int64]
    ) -> None:
        world, own = which[0].tolist()
        state = self.S[world].tolist()
        done, fault = self.done[world : world + 1], self.fault[world : world + 1]
        try:
            kernel.run(
                [(0, 0)], len(given), every, done, fault, [state], [self.P[world].tolist()], self._kinds.tolist(),
                self._z.tolist(), [None], [given.inputs[own].tolist()], [given.wrenches[own]], [given.cuts[own].tolist()],
                given.fractions.tolist(), given.on_time.tolist(), given.pieces.tolist(), self._exchange.data,
                self._engine_step, 0, columns.tolist(), out.data,
            )  # fmt: skip
        finally:
            self.S[world] = state

    def close(self) -> None:
        """Forget the engine."""
        FUNCTIONS.pop(self._plain_step, None)
        self.engine.close()
