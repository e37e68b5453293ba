"""Reads the time series of runs for the browser. They are thinned to common times, and packed as text."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.log import open_log
from asrsim.plots.curves import REFERENCE, CurveSource, RunCurves, drawable_quantities
from asrsim.plots.decimate import Curve, Envelope
from asrsim.samples import Array

BUDGET = 1_050_000
"""Largest size of all series of a page together, bytes."""
LEAST, MOST = 200, 4000
"""LEAST, MOST: smallest and largest number of intervals into which a series is thinned."""
LEVELS = 65534
"""Number of quantisation steps between the smallest and the largest value of a series. These two values are stored exactly."""
GAP = 65535
"""Integer that stands for a missing value in a packed series."""


@dataclass(frozen=True, kw_only=True)
class TimeGrid:
    """Evenly spaced times that all series of a page share."""

    start: float
    """First time, s."""
    step: float
    """Time step, s."""
    count: int
    thinned: bool
    """Whether each interval is represented by two points, its smallest and largest sample."""

    @property
    def time(self) -> Array:
        """Times (count,), s."""
        return self.start + self.step * np.arange(float(self.count))

    def as_dict(self) -> dict[str, Any]:
        """Grid as data for the page; margin: time before the first point and after the last point, s."""
        return {"start": self.start, "step": self.step, "count": self.count, "margin": 0.5 * self.step if self.thinned else 0.0}


def read_runs(paths: Sequence[Path], *, quantities: Sequence[str]) -> tuple[TimeGrid, list[RunCurves]]:
    """Common time grid of the runs, as fine as `BUDGET` permits, and the runs' curves on this grid. The curves keep all extreme
    values. Raises LogError.
    """
    readers = [open_log(path) for path in paths]
    steps = [reader.info.step * max(reader.info.log_every, 1) for reader in readers]
    duration = max(reader.duration for reader in readers)
    drawable = [{*drawable_quantities(reader), REFERENCE} for reader in readers]
    sources = [
        CurveSource(path, quantities=[name for name in quantities if name in known], bodies=True)
        for path, known in zip(paths, drawable, strict=True)
    ]
    columns = sum(len(source.columns) for source in sources)
    step = min(steps)
    # An interval has two points of two bytes each; base64 needs four characters for three bytes.
    bins = int(np.clip(BUDGET / (max(columns, 1) * 2 * 2 * 4 / 3), LEAST, MOST))
    samples = round(duration / step) + 1
    alike = all(abs(s - step) <= 1e-9 * step for s in steps)
    if alike and samples <= 2 * bins:
        grid = TimeGrid(start=0.0, step=step, count=samples, thinned=False)
    else:
        width = max(duration, step) / bins
        grid = TimeGrid(start=0.25 * width, step=0.5 * width, count=2 * bins, thinned=True)
    return grid, [_read(source, grid, duration) for source in sources]


def _read(source: CurveSource, grid: TimeGrid, duration: float) -> RunCurves:
    envelope = Envelope(start=0.0, end=duration, bins=grid.count // 2)
    whole = np.full((0 if grid.thinned else grid.count, len(source.columns)), np.nan)
    count = 0
    for part, matrix in source.chunks():
        count += len(part.time)
        if grid.thinned:
            envelope.add(part.time, matrix)
        else:
            whole[np.clip(np.round((part.time - grid.start) / grid.step).astype(int), 0, grid.count - 1)] = matrix
    curves: dict[tuple[str, str], Curve] = {}
    for index, column in enumerate(source.columns):
        values = envelope.pairs(index) if grid.thinned else whole[:, index]
        if np.isfinite(values).any():
            curves[column] = Curve(time=grid.time, values=values)
    return source.run(curves, count)


def pack(values: Array) -> dict[str, Any]:
    """Series as text, with 16 bits per value. Its smallest and its largest value are stored exactly."""
    finite = np.isfinite(values)
    low = float(values[finite].min()) if finite.any() else 0.0
    high = float(values[finite].max()) if finite.any() else 0.0
    span = high - low
    if span <= 0.0:
        return {"low": low, "high": high, "data": "" if finite.all() else _text(np.where(finite, 0, GAP))}
    scaled = np.where(finite, np.round((np.where(finite, values, low) - low) / span * LEVELS), GAP)
    return {"low": low, "high": high, "data": _text(scaled)}


def unpack(packed: Mapping[str, Any], count: int) -> Array:
    """Values of a series that `pack` packed, accurate to half a quantisation step."""
    low, high = float(packed["low"]), float(packed["high"])
    if not packed["data"]:
        return np.full(count, low)
    levels = np.frombuffer(base64.b64decode(packed["data"]), dtype="<u2").astype(np.float64)
    return np.where(levels == GAP, np.nan, low + levels / LEVELS * (high - low))


def _text(levels: Array) -> str:
    return base64.b64encode(levels.astype("<u2").tobytes()).decode("ascii")
