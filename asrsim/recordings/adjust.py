"""What is done to columns beyond names and units: a factor, an offset, a part of the recording; numbers that are none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from asrsim.errors import Problem, RecordingError
from asrsim.recordings.data import Column, Raw, RawSeries
from asrsim.recordings.mapping import ColumnMap
from asrsim.samples import Array

LARGEST = 1e30
"""SI units: what is beyond it was not measured, and its squares and slopes leave the range of numbers."""


def scaled(column: Column, one: ColumnMap) -> Column:
    """With the mapping's own factor and offset."""
    values, said = column.values * one.scale, [] if one.scale == 1.0 else [f"x {one.scale:g}"]
    good = np.isfinite(values)
    if one.unwrapped:
        values = values.copy()
        values[good] = np.unwrap(values[good])
        said.append("unwrapped")
    finite = values[good]
    zero = 0.0
    if one.zero and len(finite):
        zero = float(finite[0] if one.zero == "start" else np.mean(finite))
        said.append(f"- {zero:.6g} (its {one.zero})")
    if one.offset:
        said.append(f"{'+' if one.offset > 0 else '-'} {abs(one.offset):g}")
    if not said:
        return column
    conversion = "; ".join([*([column.conversion] if column.conversion else []), " ".join(said)])
    return replace(column, values=values - zero + one.offset, conversion=conversion)


def windowed(path: Path, raw: Raw, maps: Sequence[ColumnMap]) -> Raw:
    """The series within the window that the mapping asks for; raises RecordingError where nothing is left."""
    window = next((one.window for one in maps if one.role == "window"), None)
    if window is None:
        return raw
    kept: list[RawSeries] = []
    masks: dict[int, tuple[NDArray[np.bool_], Array]] = {}
    for series in raw.series:
        if id(series.time) not in masks:
            inside = (series.time >= window[0]) & (series.time <= window[1])
            masks[id(series.time)] = (inside, series.time[inside])
        inside, time = masks[id(series.time)]
        if len(time) > 1:
            kept.append(replace(series, time=time, values=series.values[inside]))
    if not kept:
        start, end = min(s.time[0] for s in raw.series), max(s.time[-1] for s in raw.series)
        raise RecordingError(
            f"has no samples from {window[0]:g} to {window[1]:g} s; it lasts from {start:g} to {end:g} s", file=path,
            key="window", code="no-overlap",
        )  # fmt: skip
    return replace(raw, series=tuple(kept))


def measured(path: Path, column: Column, findings: list[Problem]) -> Column:
    """Without what cannot have been measured; that has no number then."""
    beyond = np.abs(column.values) > LARGEST
    if not beyond.any():
        return column
    message = f"{int(beyond.sum())} of {len(beyond)} samples are beyond {LARGEST:g}, or infinite: read as no number"
    findings.append(Problem(message, file=path, key=column.source, code="no-measurement"))
    return replace(column, values=np.where(beyond, np.nan, column.values))
