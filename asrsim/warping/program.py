"""A Warp module that consists of functions translated from Python."""

from __future__ import annotations

import hashlib
import linecache
import types
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

from asrsim.extras import library
from asrsim.warping.translate import Call, Translation
from asrsim.warping.values import FLOAT, Group, Row, TranslationError, Value, number_as


def warp_available() -> bool:
    """Whether Warp and MuJoCo Warp are installed (the extra `warp`)."""
    from importlib.util import find_spec

    return find_spec("warp") is not None and find_spec("mujoco_warp") is not None


def loaded_warp() -> Any:
    """The module `warp`, set up so that it prints no messages of its own. Raises InputError if Warp is not installed."""
    wp: Any = library("warp", "warp")
    wp.config.log_level = wp.LOG_WARNING
    wp.init()
    return wp


class WarpProgram:
    """Source of a Warp module: translated functions, each once for every combination of argument types with which it is called,
    and the kernels that call these functions.
    """

    def __init__(self, calls: Mapping[Any, Call] | None = None) -> None:
        """calls: translation of the calls of some functions, by function; the source of these functions is not translated."""
        self._calls = dict(calls or {})
        self._done: dict[Any, tuple[str, Any]] = {}
        """Name in Warp and type of the result of each translated function, by Python function and types of its arguments."""
        self._texts: list[str] = []
        self._running: list[Any] = []

    def special(self, call: Call) -> Any:
        """New Python function that stands for a call: wherever translated code calls this function, `call` gives the text."""

        def function(*arguments: Any) -> Any:
            raise NotImplementedError("calls of this function are translated")

        self._calls[function] = call
        return function

    def call(self, function: Any, caller: Translation | None, given: list[Value]) -> Value:
        """Translation of the call of a function. caller: translation of the calling function, None without one; given:
        translated arguments. Raises TranslationError.
        """
        own = self._calls.get(function) if function.__hash__ else None
        if own is not None:
            if caller is None:
                raise TranslationError("this function can be translated only where another function calls it")
            found: Value = own(caller, given)
            return found
        if not isinstance(function, types.FunctionType):
            raise TranslationError(f"`{getattr(function, '__name__', function)}` has no counterpart in Warp")
        # Translate the function for each combination of argument types. The type of a row contains the number of its values,
        # which the function may use.
        name, returned = self.function(function, [one.kind for one in given])
        return Value(returned, f"{name}({', '.join(text for one in given for text in one.arguments)})")

    def function(self, function: Any, kinds: Sequence[Any]) -> tuple[str, Any]:
        """Name in Warp, and type of the result, of a function for arguments of these types. The first request for these types
        translates the function. Raises TranslationError.
        """
        key = function, tuple(kinds)
        if key not in self._done:
            if key in self._running:
                raise TranslationError(f"`{function.__name__}` calls itself")
            self._running.append(key)
            name = f"{function.__name__.strip('_')}_{len(self._done) + len(self._running)}"
            made = Translation(function, name, kinds, self.call)
            self._running.pop()
            self._texts.append(f"@wp.func\n{made.text}\n")
            self._done[key] = name, made.returned
        return self._done[key]

    def add(self, text: str) -> None:
        """Add the source of a function or kernel that is already written in Warp."""
        self._texts.append(text)

    @property
    def text(self) -> str:
        """Source of the Warp module."""
        return "\n\n".join(["import warp as wp", *self._texts]) + "\n"

    def load(self) -> types.ModuleType:
        """The loaded Warp module, with its functions and kernels. Raises InputError if Warp is not installed."""
        return module_of(self.text)


@cache
def module_of(text: str) -> types.ModuleType:
    """Loaded Warp module with this source. Raises InputError if Warp is not installed."""
    wp = loaded_warp()
    name = f"asrsim_{hashlib.sha256(text.encode()).hexdigest()[:16]}"
    module, file = types.ModuleType(name), f"<{name}>"
    # Warp reads the source of its functions by the name of their file, so give it the text under this name.
    linecache.cache[file] = len(text), None, text.splitlines(keepends=True), file
    module.__file__ = file
    # Do not let Warp generate derivatives of the kernels, which would double the time of compilation.
    wp.get_module(name).options["enable_backward"] = False
    exec(compile(text, file, "exec"), module.__dict__)
    return module


def law_kernel(law: Any, positions: int, parameters: int, results: int) -> str:
    """Source of a Warp module with the kernel `evaluate(positions, parameters, results)`, which evaluates a law n times.

    positions, parameters, results: number of numbers that each evaluation takes from, or writes to, the kernel's arrays.
    """
    program = WarpProgram()
    name, returned = program.function(law, [*[FLOAT] * positions, Row(FLOAT, parameters)])
    values = [f"x[i, {k}]" for k in range(positions)]
    lines = [f"r = {name}({', '.join(values)}, p, i * {parameters})"]
    if isinstance(returned, Group):
        names = [f"r_{k}" for k in range(results)]
        lines = [f"{', '.join(names)} = {lines[0][4:]}"]
        lines += [
            f"y[i, {k}] = {number_as(Value(kind, n), FLOAT).text}"
            for k, (n, kind) in enumerate(zip(names, returned.kinds, strict=True))
        ]
    else:
        lines.append(f"y[i, 0] = {number_as(Value(returned, 'r'), FLOAT).text}")
    head = "def evaluate(x: wp.array2d(dtype=float), p: wp.array(dtype=float), y: wp.array2d(dtype=float)):"
    program.add("\n".join(["@wp.kernel", head, "    i = wp.tid()", *(f"    {line}" for line in lines)]))
    return program.text
