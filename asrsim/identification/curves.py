"""Curves of a fit, as a file and as charts: recorded and simulated values of each channel, the residuals, and the residuals'
spectrum.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.identification.judge import ChannelFit
from asrsim.metrics.values import root_mean_square
from asrsim.outfile import write_json
from asrsim.plain import PlainShape, finite_or_none
from asrsim.plots import style
from asrsim.plots.chart import Chart, Line, Shade
from asrsim.plots.decimate import Envelope
from asrsim.quantities import shown
from asrsim.samples import Array

CURVES = "curves.json"
"""Name of the file with the curves, in the folder of a fit."""
BINS = 1000
"""Number of intervals of a long channel in the file. Each interval keeps its smallest and its largest sample."""
SEGMENTS = 8
"""Number of segments whose spectra are averaged. Each segment overlaps the next segment by half."""
NAMES = ("recorded", "before", "after")
LOOKS: dict[str, dict[str, Any]] = {
    "recorded": {"label": "recorded", "colour": style.LIGHT, "width": style.WIDE},
    "before": {"label": "simulated at the start", "colour": style.BLUE, "width": 0.9},
    "after": {"label": "simulated after the fit", "colour": style.VERMILION},
}
"""Style of each line of a channel, by the line's name in `NAMES`."""
_NUMBERS = [(float, None)]
SHAPE: PlainShape = {
    "channels": [
        {
            "recording": str, "key": str, "unit": str, "track": int, "end": float, "rms": (float, None), "noise": float,
            "time": _NUMBERS, "lines": {"*": _NUMBERS}, "frequency": _NUMBERS, "density": _NUMBERS,
        }
    ],
    "*": object,
}  # fmt: skip
"""Structure of the file."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ChannelCurves:
    """Curves of a channel of a recording."""

    recording: str
    key: str
    unit: str
    track: int
    """Number of the recording."""
    end: float
    """End of the training part, s."""
    noise: float
    """Standard deviation of the channel's noise."""
    rms: float
    """Root mean square of the residuals over the whole recording; nan if the simulation diverges."""
    time: Array
    lines: Mapping[str, Array]
    """Values (n,) of each line, by its name in `NAMES`. The line of a simulation that diverges is missing."""
    frequency: Array
    """Frequencies (m,) of the residuals' spectrum, Hz."""
    density: Array
    """Amplitude spectral density (m,) of the residuals, unit / sqrt(Hz)."""

    @property
    def residuals(self) -> Array | None:
        """Simulated minus recorded values (n,) after the fit; None if the simulation diverges."""
        return self.lines["after"] - self.lines["recorded"] if "after" in self.lines else None


def channel_curves(one: ChannelFit, end: float) -> ChannelCurves:
    """Curves of a channel, from its samples. end: end of the training part, s."""
    time, left = one.lines["time"], np.empty(0)
    if "after" in one.lines:
        left = one.lines["after"] - one.lines["recorded"]
    frequency, density = _density(time, left)
    return ChannelCurves(
        recording=one.recording, key=one.key, unit=one.unit, track=one.track, end=end, noise=one.noise,
        rms=root_mean_square(left), time=time,
        lines={name: one.lines[name] for name in NAMES if name in one.lines}, frequency=frequency, density=density,
    )  # fmt: skip


def _density(time: Array, values: Array) -> tuple[Array, Array]:
    """Frequencies and amplitude spectral density of a series, by Welch's method. The two arrays are empty for a short
    series.
    """
    from scipy.signal import welch

    if len(values) < 16:
        return np.empty(0), np.empty(0)
    step = float(np.median(np.diff(time)))
    even = np.interp(np.arange(time[0], time[-1] + 0.5 * step, step), time, values)
    frequency, power = welch(even, 1.0 / step, nperseg=max(16, 2 * len(even) // (SEGMENTS + 1)))
    return np.asarray(frequency[1:], float), np.sqrt(np.asarray(power[1:], float))


def write_curves(path: Path, curves: Sequence[ChannelCurves]) -> None:
    """Write the curves for a report; long curves are thinned. Raises OutputError."""
    write_json(path, {"channels": [_plain(_thinned(one)) for one in curves]})


def _thinned(one: ChannelCurves) -> ChannelCurves:
    if len(one.time) <= 4 * BINS:
        return one
    width = (one.time[-1] - one.time[0]) / BINS
    envelope = Envelope(start=float(one.time[0]), end=float(one.time[-1]), bins=BINS)
    envelope.add(one.time, np.column_stack([*one.lines.values()]))
    lines = {name: envelope.pairs(j) for j, name in enumerate(one.lines)}
    time = one.time[0] + width * (0.25 + 0.5 * np.arange(2 * BINS))
    there = np.isfinite(lines["recorded"])
    count = len(one.frequency)  # 0 if the errors of the channel have no spectrum
    rows = np.unique(np.geomspace(1, count, BINS).astype(int)) - 1 if count else np.empty(0, int)
    return ChannelCurves(
        **{
            **vars(one), "time": time[there], "lines": {name: values[there] for name, values in lines.items()},
            "frequency": one.frequency[rows], "density": one.density[rows],
        }
    )  # fmt: skip


def _plain(one: ChannelCurves) -> dict[str, Any]:
    def numbers(values: Array) -> list[float | None]:
        return [finite_or_none(float(f"{value:.7g}")) for value in values.tolist()]

    about = {"recording": one.recording, "key": one.key, "unit": one.unit, "track": one.track, "end": one.end}
    return about | {
        "noise": one.noise, "rms": finite_or_none(one.rms), "time": numbers(one.time),
        "lines": {name: numbers(values) for name, values in one.lines.items()},
        "frequency": numbers(one.frequency), "density": numbers(one.density),
    }  # fmt: skip


def curves_of(data: Mapping[str, Any]) -> tuple[ChannelCurves, ...]:
    """Curves from data with the structure `SHAPE`. Channels whose series have different lengths are left out."""

    def numbers(values: Sequence[float | None]) -> Array:
        return np.array([np.nan if value is None else value for value in values], dtype=np.float64)

    found = []
    for one in data["channels"]:
        lines = {name: numbers(values) for name, values in one["lines"].items() if name in NAMES}
        arrays: dict[str, Any] = {name: numbers(one[name]) for name in ("time", "frequency", "density")}
        alike = {len(values) for values in lines.values()} == {len(arrays["time"])} and "recorded" in lines
        if not alike or not len(arrays["time"]) or len(arrays["frequency"]) != len(arrays["density"]):
            continue
        rms = np.nan if one["rms"] is None else float(one["rms"])
        plain = {name: one[name] for name in ("recording", "key", "unit", "track", "end", "noise")}
        found.append(ChannelCurves(**plain, rms=rms, lines=lines, **arrays))
    return tuple(found)


def channel_charts(one: ChannelCurves) -> list[Chart]:
    """Charts of a channel: the recorded curve with the simulated curves, and the residuals."""
    recorded, unit = one.lines["recorded"], one.unit
    owner, _, quantity = one.key.rpartition(".")
    lines = [Line(x=one.time, y=one.lines[name], **look) for name, look in LOOKS.items() if name in one.lines]
    low, high = float(np.nanmin(recorded)), float(np.nanmax(recorded))
    room = 0.35 * (high - low) or 1.0
    chart = _held_out(one, words=quantity.replace("_", " "), unit=unit, head=owner, lines=lines, span=(low - room, high + room))
    left = one.residuals
    if left is None:
        return [chart]
    size = 1.1 * float(np.nanmax(np.abs(left), initial=0.0)) or 1.0
    line = Line(label="", x=one.time, y=left, colour=style.PURPLE, width=0.7)
    residuals = _held_out(
        one, words="difference", unit=unit, span=(-size, size), note=f"RMS {shown(one.rms, unit)}", lines=[line]
    )
    return [chart, residuals]


def spectrum_chart(one: ChannelCurves) -> Chart:
    """Chart of the residuals' spectrum. A second line shows the spectral density of white noise with the standard deviation of
    the channel's noise.
    """
    unit = one.unit
    band = float(one.frequency[-1]) if len(one.frequency) else 1.0
    white = one.noise / band**0.5
    level = np.full(len(one.frequency), white)
    lines = [
        Line(label="residuals", x=one.frequency, y=np.maximum(one.density, 1e-300), colour=style.PURPLE),
        Line(label="noise, if white", x=one.frequency, y=level, colour=style.GREY, dash=1, width=0.9),
    ]
    return Chart(words="spectrum", unit=f"{unit}/√Hz", across="frequency", across_unit="Hz", lines=lines, logarithmic="xy")


def _held_out(one: ChannelCurves, *, span: tuple[float, float], **more: Any) -> Chart:
    """Chart in which the held-out part (predicted but not fitted) is shaded."""
    bands = []
    if one.end < one.time[-1] - 1e-9:
        edges = np.array([max(one.end, float(one.time[0])), float(one.time[-1])])
        low, high = (np.full(2, edge) for edge in span)
        bands = [Shade(label="held out", x=edges, low=low, high=high, colour=style.GREEN, opacity=0.1)]
    return Chart(span=span, bands=bands, **more)
