"""Damage to data: other values in each place of it."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from typing import Any

import numpy as np

OTHERS: tuple[Any, ...] = (None, True, -1, 0, 1e308, "x", "", [], {}, [None], {"a": None}, "\ud800", 10**400, [[["x"]]])
"""What is put in the place of a value."""


def places(data: Any, way: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Every place in plain data."""
    yield way
    items = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in items:
        yield from places(value, (*way, key))


def changed(data: Any, way: tuple[Any, ...], value: Any) -> Any:
    """A copy with another value there; `value` is a function for a place that goes."""
    if not way:
        return value
    found = copy.deepcopy(data)
    inner = found
    for key in way[:-1]:
        inner = inner[key]
    if value is places:
        del inner[way[-1]]
    else:
        inner[way[-1]] = value
    return found


def edits(data: Any, *, seed: int, most: int | None) -> Iterator[Any]:
    """Some of all possible changes of one place; None: one of every place."""
    generator = np.random.default_rng(seed)
    if most is None:
        for way in places(data):
            yield changed(data, way, OTHERS[generator.integers(len(OTHERS))])
        return
    every = [(way, other) for way in places(data) for other in (*OTHERS, places) if way or other is not places]
    for index in generator.permutation(len(every))[:most]:
        yield changed(data, *every[index])
