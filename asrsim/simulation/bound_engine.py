"""An engine as the kernel calls it: in plain Python, from compiled code, or as a C function."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any
from weakref import ref

import numpy as np

from asrsim.engines.base import Engine, Native, Record
from asrsim.samples import Array
from asrsim.simulation.layout import E_VELOCITY

NO_RECORD = Record(0, None)


class BoundEngine:
    """An engine as the kernel calls it: its step in plain Python, with one world's state in the engine at a time."""

    def __init__(self, engine: Engine) -> None:
        self.engine = engine
        self._exchange = np.zeros((len(engine.joints), 5))
        self._world: int | None = None
        """Whose state the engine has."""
        self.watch: Callable[[], None] | None = None
        """Called before each step."""

    @property
    def step(self) -> Any:
        """Address of its step."""
        return self._step

    def borrow(self, wrenches: Array) -> tuple[Array, Any]:
        """The exchange (joints, 5) and a record for one call of the kernel; wrenches: (w, 6) an example."""
        return self._exchange, NO_RECORD

    def give_back(self, record: Any) -> None:
        """The call is over. Raises what the engine raised where nothing could be raised."""

    def _step(self, x: Any, exchange: Any, wrenches: Array, fraction: float) -> None:
        if self.watch is not None:
            self.watch()
        self.engine.step(self._exchange, wrenches, fraction)

    def leave(self, states: Any, world: int | None) -> None:
        """The engine's state is about to become that of another world, or a fresh one."""
        if self._world is not None and self._world != world:
            states[self._world] = self.engine.state

    def entered(self, states: Any, world: int) -> None:
        """The engine has that world's state."""
        self._world = world

    def enter(self, states: Any, world: int) -> None:
        """Let the engine have a world's state."""
        if self._world != world:
            self.leave(states, world)
            self.engine.state = states[world]
            self._world = world

    def state(self, states: Any, world: int) -> Any:
        """A copy of the engine's state in that world."""
        return self.engine.state if self._world == world else states[world]


class CalledEngine(BoundEngine):
    """Its step in Python, called from compiled code."""

    def __init__(self, engine: Engine) -> None:
        super().__init__(engine)
        own = ref(self)  # no circle, which would hold the engine until Python collects those

        def called(record: int, x: int, exchange: int, wrenches: int, fraction: float) -> None:
            engine = own()
            if engine is not None:
                engine._called(wrenches, fraction)

        self._callback = ctypes.CFUNCTYPE(None, *[ctypes.c_ssize_t] * 4, ctypes.c_double)(called)
        self._wrenches = np.zeros((0, 6))
        self._raised: BaseException | None = None

    def borrow(self, wrenches: Array) -> tuple[Array, Any]:
        """As of its base."""
        self._wrenches = wrenches
        return self._exchange, NO_RECORD

    @property
    def step(self) -> Any:
        """Address of its step."""
        return ctypes.cast(self._callback, ctypes.c_void_p).value or 0

    def _called(self, wrenches: int, fraction: float) -> None:
        # No exception may cross compiled code: the world stops instead.
        try:
            if self._raised is None:
                row = self._wrenches
                if len(row):
                    row = np.array((ctypes.c_double * row.size).from_address(wrenches)).reshape(row.shape)
                self._step(None, None, row, fraction)
                return
        except BaseException as error:
            self._raised = error
        self._exchange[:, E_VELOCITY] = np.nan

    def give_back(self, record: Any) -> None:
        """The call is over."""
        if self._raised is not None:
            error, self._raised = self._raised, None
            raise error


class NativeEngine(BoundEngine):
    """Its step as a C function, for the states of many worlds."""

    def __init__(self, engine: Engine, native: Native) -> None:
        self.engine = engine
        self.size, self._joints = native.size, len(engine.joints)
        self._address = native.address
        self._make_record = native.make_record
        self._records: list[Record] = []
        """That no thread uses now."""

    @property
    def step(self) -> Any:
        """Address of its step."""
        return self._address

    def borrow(self, wrenches: Array) -> tuple[Array, Any]:
        """Of its own for each call: threads may call at once."""
        record = self._records.pop() if self._records else self._make_record()
        return np.zeros((self._joints, 5)), record

    def give_back(self, record: Any) -> None:
        """The call is over."""
        self._records.append(record)

    def leave(self, states: Any, world: int | None) -> None:
        """All states stand in the array."""

    def entered(self, states: Any, world: int) -> None:
        """The engine has a state that the array has not yet."""
        states[world] = self.engine.state

    def enter(self, states: Any, world: int) -> None:
        """Let the engine have a world's state."""
        self.engine.state = states[world]

    def state(self, states: Any, world: int) -> Any:
        """A copy."""
        return states[world].copy()


def bind_engine(engine: Engine, *, compiled: bool, watch: Callable[[], None] | None = None) -> BoundEngine:
    """The engine for plain or compiled runs; watch: called before each step, which then goes through Python."""
    native = engine.native if compiled else None
    if native is not None and watch is None:
        return NativeEngine(engine, native)
    bound = CalledEngine(engine) if compiled else BoundEngine(engine)
    bound.watch = watch
    return bound
