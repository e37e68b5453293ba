"""Plain data for JSON, and comparison of data from files that others may have edited with an expected structure."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from os import PathLike
from typing import Any

PlainShape = Any
"""Expected structure: str, bool, int, float (any number except NaN), None, object (anything), a tuple of alternatives, [shape]
for a list of such values, or a mapping from keys to shapes. In a mapping, a key `"key?"` is optional, and `"*"` stands for all
other keys.
"""


def one_or_more(given: Any) -> tuple[Any, ...]:
    """Tuple of one or several values: a single text or path becomes a tuple with one entry."""
    return (given,) if isinstance(given, str | PathLike) else tuple(given)


def finite_or_none(value: float) -> float | None:
    """The number for JSON; None in place of infinity and NaN, which JSON lacks."""
    return value if math.isfinite(value) else None


def mapped(data: Any, leaf: Callable[[Any], Any]) -> Any:
    """Plain data in which `leaf` has replaced every value that is not a mapping, list or tuple; tuples become lists."""
    if isinstance(data, Mapping):
        return {key: mapped(value, leaf) for key, value in data.items()}
    return [mapped(value, leaf) for value in data] if isinstance(data, list | tuple) else leaf(data)


def misfit(data: Any, shape: PlainShape, place: str = "") -> str:
    """Description of the first place at which plain data deviate from the structure `shape`; empty if nothing deviates."""
    if isinstance(shape, tuple):
        return "" if any(not misfit(data, one) for one in shape) else f"{place or 'it'} is {_words(data)}"
    if isinstance(shape, list):
        if not isinstance(data, list):
            return f"{place or 'it'} is not a list"
        return next((found for i, item in enumerate(data) if (found := misfit(item, shape[0], f"{place}[{i}]"))), "")
    if isinstance(shape, dict):
        return _keys(data, shape, place)
    return "" if _FITS[shape](data) else f"{place or 'it'} is {_words(data)}"


def _keys(data: Any, shape: dict[str, PlainShape], place: str) -> str:
    if not isinstance(data, dict):
        return f"{place or 'it'} is not a mapping"
    dot = f"{place}." if place else ""
    for key, inner in shape.items():
        name = key.removesuffix("?")
        if key == "*":
            continue
        if name in data:
            if found := misfit(data[name], inner, dot + name):
                return found
        elif name == key:
            return f"{dot}{name} is missing"
    named = {key.removesuffix("?") for key in shape}
    for key, value in data.items():
        if not is_text(key):
            return f"a key of {place or 'it'} is not text"
        if key not in named and "*" in shape and (found := misfit(value, shape["*"], dot + key)):
            return found
    return ""


def _is_number(data: Any) -> bool:
    if isinstance(data, float):
        return data == data
    return isinstance(data, int) and not isinstance(data, bool) and abs(data) < 10**300


_FITS: dict[Any, Callable[[Any], bool]] = {
    str: lambda data: isinstance(data, str) and is_text(data),
    bool: lambda data: isinstance(data, bool),
    int: lambda data: isinstance(data, int) and not isinstance(data, bool) and abs(data) < 1 << 53,
    float: _is_number,
    None: lambda data: data is None,
    object: lambda _: True,
}
"""Function that tells whether a value has each of the simple structures."""


def is_text(text: str) -> bool:
    """Whether a text contains only whole characters, since JSON can contain half of a surrogate pair."""
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True


def _words(data: Any) -> str:
    if isinstance(data, dict | list):
        return "a mapping" if isinstance(data, dict) else "a list"
    return ascii(data)[:60]
