"""Columns that were computed from others: a fit to them would be circular."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from asrsim.recordings import Recording
from asrsim.recordings.data import Column
from asrsim.samples import Array

COMPUTED = 1e-3
"""Share of its own deviation that is left of a column that others give exactly: it was computed from them."""


def computed_columns(recording: Recording, columns: Sequence[Column]) -> dict[str, str]:
    """Columns that follow exactly from another one on the same time: source -> what it is of."""
    found: dict[str, str] = {}
    everything = [c for c in recording.channels.values() if np.isfinite(c.values).all() and np.ptp(c.values) > 0.0]
    mapped = {column.source for column in columns}
    for index, other in enumerate(everything):
        for column in everything[index + 1 :]:
            if len(column.time) != len(other.time):
                continue
            late, early = (column, other) if column.source in mapped else (other, column)
            if late.source not in mapped or late.source in found or early.source in found:
                continue
            # Positions are what sensors read; what is a multiple of another column, a torque or a deflection, is the product.
            if str(late.quantity).endswith("position") and early.source in mapped:
                late, early = early, late
            if _explained(early.values, late.values) < COMPUTED:
                found[late.source] = f"'{early.source}'"
    for column in columns:
        if str(column.quantity).endswith("velocity") and column.source not in found:
            place = next(
                (
                    c
                    for c in columns
                    if c.joint == column.joint and c.quantity == str(column.quantity).replace("velocity", "position")
                ),
                None,
            )
            if place is not None and len(place.time) == len(column.time) and _is_difference(place, column):
                found[column.source] = f"'{place.source}', by differences"
    return found


def _explained(source: Array, values: Array) -> float:
    """Share of the deviation of `values` that a line through `source` leaves."""
    centred, other = source - source.mean(), values - values.mean()
    size = float(np.dot(other, other))
    left = other - centred * float(np.dot(centred, other) / np.dot(centred, centred))
    return float(np.sqrt(np.dot(left, left) / size))


def _is_difference(place: Column, speed: Column) -> bool:
    steps = np.diff(place.values) / np.diff(place.time)
    ways = (speed.values[1:] - steps, speed.values[:-1] - steps, speed.values[1:-1] - 0.5 * (steps[1:] + steps[:-1]))
    spread = float(np.std(speed.values))
    return any(float(np.median(np.abs(way))) < COMPUTED * spread for way in ways) if spread > 0.0 else False
