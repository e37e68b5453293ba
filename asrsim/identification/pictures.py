"""Pictures of a fit: overlays before and after, and residuals with their correlation."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from asrsim.identification.noise import lag_correlation
from asrsim.identification.result import Result
from asrsim.plots.output import save_figure, styled
from asrsim.samples import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST = 8
"""Channels of a picture."""
POINTS = 4000
"""Of a line."""


def draw(result: Result, folder: Path, formats: Sequence[str] = ("png",)) -> list[Path]:
    """Write all pictures. Raises OutputError."""
    paths: list[Path] = []
    with styled(mathematics=False):
        for name, figure in figures(result).items():
            paths += save_figure(figure, folder, name, formats)
    return paths


def figures(result: Result) -> dict[str, Figure]:
    """Name -> figure; call it inside :func:`asrsim.plots.output.styled`."""
    found: dict[str, Any] = {}
    for track, channels in enumerate(result.series):
        name = result.channels[sum(len(one) for one in result.series[:track])].recording
        suffix = f"_{Path(name).stem}" if len(result.series) > 1 else ""
        found[f"overlay{suffix}"] = _overlay(channels[:MOST], result.ends[track], name)
        found[f"residuals{suffix}"] = _residuals(channels[:MOST], result.ends[track], name)
    return found


def _grid(count: int, width: float, height: float, columns: int) -> tuple[Any, Any]:
    from matplotlib.figure import Figure

    rows = -(-count // columns)
    figure = Figure(figsize=(width * columns, height * rows + 0.4), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False)
    for axis in axes.ravel()[count:]:
        axis.remove()
    return figure, axes


def _overlay(channels: Sequence[Any], end: float, name: str) -> Any:
    figure, axes = _grid(len(channels), 8.5, 2.3, 1)
    for one, axis in zip(channels, axes.ravel(), strict=False):
        every = max(1, len(one["time"]) // POINTS)
        time = one["time"][::every]
        axis.plot(time, one["recorded"][::every], color="0.6", linewidth=2.2, label="recorded")
        if one["before"] is not None:
            axis.plot(time, one["before"][::every], "--", color="C1", linewidth=0.9, label="before")
        if one["after"] is not None:
            axis.plot(time, one["after"][::every], color="C0", linewidth=1.0, label="after")
        low, high = float(np.min(one["recorded"])), float(np.max(one["recorded"]))
        axis.set_ylim(low - 0.35 * (high - low), high + 0.35 * (high - low))
        _held(axis, end, one["time"])
        axis.set(ylabel=f"{one['key']}\n[{one['unit']}]")
    axes[0, 0].set_title(name, fontsize="medium")
    axes[0, 0].legend(fontsize="x-small", ncols=4, loc="upper right")
    axes[-1, 0].set_xlabel("time [s]")
    return figure


def _held(axis: Any, end: float, time: Array) -> None:
    """Shade what was only predicted."""
    if end < time[-1] - 1e-9:
        axis.axvspan(max(end, float(time[0])), float(time[-1]), color="C2", alpha=0.12, label="held out", linewidth=0)


def _residuals(channels: Sequence[Any], end: float, name: str) -> Any:
    figure, axes = _grid(2 * len(channels), 5.0, 2.2, 2)
    for one, (left, right) in zip(channels, axes, strict=False):
        if one["after"] is None:
            continue
        rest = one["after"] - one["recorded"]
        every = max(1, len(rest) // POINTS)
        left.plot(one["time"][::every], rest[::every], color="C0", linewidth=0.5)
        _held(left, end, one["time"])
        left.set(ylabel=f"{one['key']}\n[{one['unit']}]")
        inside = rest[one["time"] <= end] if end > 0.0 else rest
        lags = np.arange(1, min(60, len(inside) // 4) + 1)
        if len(lags):
            # As one collection: bars are a patch each, and take longer than all the rest.
            right.vlines(lags, 0.0, [lag_correlation(inside, int(lag)) for lag in lags], color="C0", linewidth=2.0)
            bound = 1.96 / np.sqrt(max(len(inside), 1))
            right.axhspan(-bound, bound, color="0.8", linewidth=0, zorder=0)
        right.set(ylim=(-1.05, 1.05), ylabel="correlation")
    axes[0, 0].set_title(f"{name}: predicted less recorded", fontsize="medium")
    axes[0, 1].set_title("of residuals, by lag", fontsize="medium")
    axes[-1, 0].set_xlabel("time [s]")
    axes[-1, 1].set_xlabel("samples")
    return figure
