"""Columns that were computed from others: a fit to them would be circular."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from asrsim.recordings import Recording
from asrsim.recordings.data import Column
from asrsim.samples import Array

COMPUTED = 1e-3
"""Share of its own deviation that is left of a column that others give exactly: it was computed from them."""


def computed_columns(recording: Recording, columns: Sequence[Column]) -> dict[str, str]:
    """Columns that follow exactly from another one on the same time: source -> what it is of."""
    found: dict[str, str] = {}
    moving = [c for c in recording.channels.values() if np.isfinite(c.values).all() and np.ptp(c.values) > 0.0]
    mapped = {column.source for column in columns}
    for early, late in combinations(moving, 2):
        if late.source not in mapped:
            early, late = late, early
        if len(late.time) != len(early.time) or late.source not in mapped or {late.source, early.source} & found.keys():
            continue
        # Positions are what sensors read; what is a multiple of another column, a torque or a deflection, is the product.
        if str(late.quantity).endswith("position") and early.source in mapped:
            early, late = late, early
        if _left(early.values, late.values) < COMPUTED:
            found[late.source] = f"'{early.source}'"
    return found


def _left(source: Array, values: Array) -> float:
    """Share of the deviation of `values` that a line through `source` leaves."""
    centred, other = source - source.mean(), values - values.mean()
    left = other - centred * float(centred @ other / (centred @ centred))
    return float(np.linalg.norm(left) / np.linalg.norm(other))
