"""Copies of a law whose globals are exchanged: the same source, run on arrays or compiled."""

from __future__ import annotations

import types
from collections.abc import Callable
from typing import Any


def rebind(function: types.FunctionType, exchange: Callable[[Any], Any], wrap: Callable[[Any], Any] = lambda f: f) -> Any:
    """A copy of `function` in which every global or enclosed value is `exchange(value)`, and so in the functions that it calls.

    exchange: returns the value to use instead, or the value itself; wrap: applied to each copied function.
    """
    return _copy(function, exchange, wrap, {})


def _copy(
    function: types.FunctionType, exchange: Callable[[Any], Any], wrap: Callable[[Any], Any], seen: dict[int, Any]
) -> Any:
    if id(function) in seen:
        return seen[id(function)]
    names: dict[str, Any] = {"__builtins__": __builtins__, "__name__": function.__module__}
    enclosed = tuple(types.CellType(_replaced(cell.cell_contents, exchange, wrap, seen)) for cell in function.__closure__ or ())
    copy = types.FunctionType(function.__code__, names, function.__name__, function.__defaults__, enclosed or None)
    copy.__module__ = function.__module__
    copy.__qualname__ = function.__qualname__
    result = seen[id(function)] = wrap(copy)
    for name in called_names(function):
        if name in function.__globals__:
            names[name] = _replaced(function.__globals__[name], exchange, wrap, seen)
    return result


def _replaced(value: Any, exchange: Callable[[Any], Any], wrap: Callable[[Any], Any], seen: dict[int, Any]) -> Any:
    new = exchange(value)
    return _copy(value, exchange, wrap, seen) if new is value and isinstance(value, types.FunctionType) else new


def called_names(function: types.FunctionType) -> tuple[str, ...]:
    """Names of globals that a function's code mentions, nested functions included."""
    names = list(function.__code__.co_names)
    for constant in function.__code__.co_consts:
        if isinstance(constant, types.CodeType):
            names += constant.co_names
    return tuple(names)
