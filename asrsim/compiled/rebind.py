"""Copies of functions with other global variables, so that one source can run as Python, on arrays, in another library, or
compiled."""

from __future__ import annotations

import types
from collections.abc import Callable, Mapping
from typing import Any


def rebind(
    function: Any,
    exchange: Callable[[Any], Any] = lambda value: value,
    wrap: Callable[[Any], Any] = lambda copy: copy,
    *,
    names: Mapping[str, Any] | None = None,
    suffix: Callable[[types.FunctionType], str] = lambda function: "",
    ready: Mapping[str, Any] | None = None,
) -> Any:
    """A copy of `function` and of the functions that it calls; `exchange(value)` replaces each global or closure value.

    exchange: function that returns the replacement of a value, or the value itself. wrap: function that is applied to each
    copied function. names: name of a global -> its replacement. suffix: function that returns the text that is added to the
    name of the copy of a function. ready: wrapped copies of earlier calls, by their full names (see `full_name`). A function
    whose copy is among them is not copied again.
    """
    return _Copier(exchange, wrap, names or {}, suffix, ready or {}).copy(function)


def full_name(function: Any) -> str:
    """Module and qualified name of a function."""
    return f"{function.__module__}.{function.__qualname__}"


class _Copier:
    def __init__(
        self,
        exchange: Callable[[Any], Any],
        wrap: Callable[[Any], Any],
        names: Mapping[str, Any],
        suffix: Callable[[types.FunctionType], str],
        ready: Mapping[str, Any],
    ) -> None:
        self._exchange, self._wrap, self._names, self._suffix, self._ready = exchange, wrap, names, suffix, ready
        self._seen: dict[int, Any] = {}

    def copy(self, function: types.FunctionType) -> Any:
        if id(function) in self._seen:
            return self._seen[id(function)]
        suffix = self._suffix(function)
        earlier = self._ready.get(full_name(function) + suffix)
        if earlier is not None:
            return earlier
        names: dict[str, Any] = {"__builtins__": __builtins__, "__name__": function.__module__}
        enclosed = tuple(types.CellType(self._replaced(cell.cell_contents)) for cell in function.__closure__ or ())
        copy = types.FunctionType(function.__code__, names, function.__name__ + suffix, function.__defaults__, enclosed or None)
        copy.__module__ = function.__module__
        copy.__qualname__ = function.__qualname__ + suffix
        result = self._seen[id(function)] = self._wrap(copy)
        for name in called_names(function):
            if name in self._names:
                names[name] = self._replaced(self._names[name])
            elif name in function.__globals__:
                names[name] = self._replaced(function.__globals__[name])
        return result

    def _replaced(self, value: Any) -> Any:
        new = self._exchange(value)
        return self.copy(value) if new is value and isinstance(value, types.FunctionType) else new


def called_names(function: types.FunctionType) -> tuple[str, ...]:
    """Names of the global variables that a function and the functions nested in it use."""
    names = list(function.__code__.co_names)
    for constant in function.__code__.co_consts:
        if isinstance(constant, types.CodeType):
            names += constant.co_names
    return tuple(names)
