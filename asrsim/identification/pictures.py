"""Pictures of a fit: recorded and predicted channels before and after the fit, and residuals."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from asrsim.identification.judge import ChannelFit
from asrsim.identification.result import Result
from asrsim.plots.output import save_figure, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LINES = (
    ("recorded", {"color": "0.6", "linewidth": 2.2}),
    ("before", {"color": "C1", "linewidth": 0.9, "linestyle": "--"}),
    ("after", {"color": "C0", "linewidth": 1.0}),
)


def draw(result: Result, folder: Path, formats: Sequence[str] = ("png",)) -> list[Path]:
    """Write all pictures. Raises OutputError."""
    paths: list[Path] = []
    with styled(mathematics=False):
        for name, figure in figures(result).items():
            paths += save_figure(figure, folder, name, formats)
    return paths


def figures(result: Result) -> dict[str, Figure]:
    """Figures of the recordings, by file name; to be called inside `asrsim.plots.output.styled`."""
    found: dict[str, Figure] = {}
    for number, end in enumerate(result.ends):
        channels = [one for one in result.channels if one.track == number]
        name = f"overlay_{Path(channels[0].recording).stem}" if len(result.ends) > 1 else "overlay"
        # Recordings in different folders may have the same name.
        found[f"{name}_{number + 1}" if name in found else name] = _overlay(channels, end)
    return found


def _overlay(channels: Sequence[ChannelFit], end: float) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12.0, 2.3 * len(channels) + 0.4), layout="constrained")
    axes = figure.subplots(len(channels), 2, squeeze=False, sharex=True, width_ratios=(3, 2))
    for one, (left, right) in zip(channels, axes, strict=True):
        time, recorded = one.lines["time"], one.lines["recorded"]
        for label, style in LINES:
            if label in one.lines:
                left.plot(time, one.lines[label], label=label, **style)
        low, high = float(np.min(recorded)), float(np.max(recorded))
        left.set(ylabel=f"{one.key}\n[{one.unit}]", ylim=(1.35 * low - 0.35 * high, 1.35 * high - 0.35 * low))
        if "after" in one.lines:
            right.plot(time, one.lines["after"] - recorded, color="C0", linewidth=0.5)
        for axis in (left, right):
            # Shade the part that was predicted but not fitted.
            if end < time[-1] - 1e-9:
                axis.axvspan(max(end, float(time[0])), float(time[-1]), color="C2", alpha=0.12, label="held out", linewidth=0)
    axes[0, 0].set_title(channels[0].recording, fontsize="medium")
    axes[0, 1].set_title("predicted minus recorded", fontsize="medium")
    axes[0, 0].legend(fontsize="x-small", ncols=4, loc="upper right")
    for axis in axes[-1]:
        axis.set_xlabel("time [s]")
    return figure
