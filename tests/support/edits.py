"""Random edits of plain data: a value is replaced or deleted."""

import copy

import numpy as np

OTHERS = (None, True, -1, 0, 1e308, "x", "", [], {}, [None], {"a": None}, "\ud800", 10**400, [[["x"]]])
"""Values that replace the original value."""


def places(data, way=()):
    """Yield the path (keys and indices) to every value in plain data."""
    yield way
    items = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in items:
        yield from places(value, (*way, key))


def changed(data, way, value):
    """Copy of the data with another value at the path `way`. If `value` is the function `places`, the entry is deleted."""
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


def edits(data, *, seed, most):
    """Yield edited copies of the data: at most `most` of all single edits, or one edit of every value if `most` is None."""
    generator = np.random.default_rng(seed)
    if most is None:
        for way in places(data):
            yield changed(data, way, OTHERS[generator.integers(len(OTHERS))])
        return
    every = [(way, other) for way in places(data) for other in (*OTHERS, places) if way or other is not places]
    for index in generator.permutation(len(every))[:most]:
        yield changed(data, *every[index])
