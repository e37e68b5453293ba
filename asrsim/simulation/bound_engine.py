"""Adapters through which the kernel calls an engine: in Python, from compiled code, or as a C function."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from math import prod
from typing import Any
from weakref import ref

import numpy as np
from numpy.typing import NDArray

from asrsim.engines.base import VELOCITY, Engine, Native, NativeRecord
from asrsim.samples import Array
from asrsim.simulation.arguments import EngineCall

NO_WRENCHES, WHOLE = np.zeros((1, 0, 6)), np.ones(1)
"""NO_WRENCHES: empty table of wrenches; WHOLE: table of lengths for a kick that consists of one piece."""
NO_RECORD = np.zeros(1, dtype=np.int64)
"""Records of an engine whose step is a Python function."""


class BoundEngine:
    """Adapter for a kernel that runs in Python. The engine contains the state of one world at a time."""

    def __init__(self, engine: Engine, watch: Callable[[], None] | None = None) -> None:
        """watch: function that is called before each step of the engine."""
        self.engine, self._watch = engine, watch
        self._exchange = np.zeros((0, len(engine.joints), 6))
        self._parts: list[Array] = []
        """Exchange arrays, by the number of pieces of the kick."""
        self.states: Any = {}
        """States of the engine by number of the world, except for the world whose state the engine contains."""
        self._world: int | None = None
        """Number of the world whose state the engine contains; None if the engine's state belongs to no world."""

    def borrow(self, pieces: int) -> EngineCall:
        """Arguments of the engine for one call of the kernel. pieces: largest number of pieces of a kick."""
        if len(self._exchange) < pieces:
            self._exchange = np.zeros((pieces, *self._exchange.shape[1:]))
            self._parts = [self._exchange[:count] for count in range(pieces + 1)]
        # Use a memory view, whose items are read and written several times faster than the items of an array.
        return EngineCall(step=self._step, records=NO_RECORD, exchange=self._exchange.data)

    def give_back(self, call: EngineCall) -> None:
        """End a call of the kernel. Raises an exception of the engine that could not be raised during the call."""

    def _step(self, record: Any, x: Any, exchange: Any, wrenches: Array, lengths: Array, pieces: int) -> None:
        if self._watch is not None:
            self._watch()
        # Most kicks pass the same arrays. `asrsim.engines.rigid.Calculation` keeps the addresses of these arrays, which halves
        # the time of a step in PyBullet.
        if pieces == 1:
            wrenches = wrenches if wrenches.shape[1] else NO_WRENCHES
            lengths = WHOLE if lengths[0] == 1.0 else lengths
        self.engine.step(self._parts[pieces], wrenches, lengths)

    def leave(self) -> None:
        """Save the engine's state before another world's state is loaded."""
        if self._world is not None:
            self.states[self._world] = self.engine.state
            self._world = None

    def entered(self, world: int) -> None:
        """Note that the engine now contains the state of this world."""
        self._world = world

    def enter(self, world: int) -> None:
        """Load the state of a world into the engine."""
        if self._world != world:
            self.leave()
            self.engine.state = self.states[world]
            self._world = world

    def state(self, world: int) -> Any:
        """A copy of the engine's state for a world."""
        return self.engine.state if self._world == world else self.states[world]

    def put(self, world: int, state: Any) -> None:
        """Set the engine's state for a world."""
        if self._world == world:
            self._world = None
        self.states[world] = state


class CalledEngine(BoundEngine):
    """Adapter for a compiled kernel and an engine whose step runs in Python."""

    def __init__(self, engine: Engine, wrenches: int, watch: Callable[[], None] | None = None) -> None:
        """wrenches: number of wrenches of the scenario."""
        super().__init__(engine, watch)
        own = ref(self)  # a reference cycle would keep the engine alive until Python's garbage collection

        def called(record: int, x: int, exchange: int, wrenches: int, lengths: int, pieces: int) -> None:
            engine = own()
            if engine is not None:
                engine._called(wrenches, lengths, pieces)

        self._callback = ctypes.CFUNCTYPE(None, *[ctypes.c_ssize_t] * 6)(called)
        self._wrenches = wrenches
        self._address = ctypes.cast(self._callback, ctypes.c_void_p).value or 0
        self._raised: BaseException | None = None

    def borrow(self, pieces: int) -> EngineCall:
        """Arguments of the engine for one call of the kernel. pieces: largest number of pieces of a kick."""
        super().borrow(pieces)
        return EngineCall(step=self._address, records=NO_RECORD, exchange=self._exchange)

    def _called(self, wrenches: int, lengths: int, pieces: int) -> None:
        # Stop the world after an exception, since exceptions must not pass through compiled code.
        try:
            if self._raised is None:
                shape = pieces, self._wrenches, 6
                forces = _numbers_at(wrenches, shape) if self._wrenches else np.zeros(shape)
                self._step(None, None, None, forces, _numbers_at(lengths, (pieces,)), pieces)
                return
        except BaseException as error:
            self._raised = error
        self._exchange[..., VELOCITY] = np.nan

    def give_back(self, call: EngineCall) -> None:
        """End a call of the kernel."""
        if self._raised is not None:
            error, self._raised = self._raised, None
            raise error


def _numbers_at(address: int, shape: tuple[int, ...]) -> Array:
    """Copy of the array at an address."""
    return np.array((ctypes.c_double * prod(shape)).from_address(address)).reshape(shape)


class NativeEngine(BoundEngine):
    """Adapter for a compiled kernel and an engine whose step is a C function, for the states of many worlds."""

    def __init__(self, engine: Engine, native: Native, states: Array, strides: Sequence[int]) -> None:
        """states: states of all worlds, (worlds, values); strides: lengths of the steps in substeps, beginning with 1."""
        self.engine, self._native, self.states, self._strides = engine, native, states, strides
        self._records: list[NativeRecord] = []
        """All records, whose memory must stay alive."""
        # Make the first call here, before there are threads, since it may use the engine's own records.
        self._calls = [self._new_call(1, self._new_records())]
        """Calls that are free for the next thread."""

    def borrow(self, pieces: int) -> EngineCall:
        """Arguments of the engine for one call of the kernel; parallel threads get separate arguments."""
        try:
            call = self._calls.pop()
        except IndexError:
            return self._new_call(pieces, self._new_records())
        return call if len(call.exchange) >= pieces else self._new_call(pieces, call.records)

    def _new_call(self, pieces: int, records: NDArray[np.int64]) -> EngineCall:
        """Arguments of the engine for a kick of up to `pieces` pieces. records: addresses of the engine's records, one per
        stride.
        """
        return EngineCall(self._native.address, records, np.zeros((pieces, len(self.engine.joints), 6)))

    def _new_records(self) -> NDArray[np.int64]:
        """Addresses of new records, one for each stride."""
        made = [self._native.make_record(stride) for stride in self._strides]
        self._records += made
        return np.array([record.address for record in made], dtype=np.int64)

    def give_back(self, call: EngineCall) -> None:
        """End a call of the kernel."""
        self._calls.append(call)

    def leave(self) -> None:
        """Do nothing: the array always contains the states of all worlds."""

    def entered(self, world: int) -> None:
        """Copy the engine's new state to the array."""
        self.states[world] = self.engine.state

    def enter(self, world: int) -> None:
        """Load the state of a world into the engine."""
        self.engine.state = self.states[world]

    def state(self, world: int) -> Any:
        """A copy of the engine's state for a world."""
        return self.states[world].copy()

    def put(self, world: int, state: Any) -> None:
        """Set the engine's state for a world."""
        self.states[world] = state
