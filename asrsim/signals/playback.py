"""Playback of a recording: a column of a CSV file, or a field of a topic in an MCAP file or ROS bag."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import ClassVar

import numpy as np

from asrsim.document.block import declare
from asrsim.document.kinds import NUMBER, Choice, File, Text
from asrsim.samples import Array
from asrsim.signals.base import Signal
from asrsim.signals.common import INTERPOLATIONS, between, driven, hold_jumps, interpolate, require
from asrsim.signals.curve import CubicCurve, curve_through
from asrsim.signals.recorded import read_column

STAMP_LIMIT = 1e6
"""Earliest time of a recording above which its times count as stamps of a clock, s. Such times are shifted to start at 0."""

_RECORDING = File(noun="recording", folder=True, beside=".yaml")


def shifted(times: Array, zero: float, start: float = 0.0) -> Array:
    """Times (n,) in s, shifted so that the time `zero` becomes `start`. They are rounded to the resolution of the clock, so
    that 100.2 - 100 becomes 0.2.
    """
    digits = min(9, int(np.floor(-np.log10(np.spacing(max(float(np.max(np.abs(times))), abs(start), 1e-3))))))
    return np.asarray(np.round(times - zero, digits) + start, dtype=np.float64)


@dataclass(frozen=True, kw_only=True)
class Playback(Signal):
    """Recorded series, constant before the first sample and after the last sample."""

    kind: ClassVar[str] = "playback"

    file: Path = declare(_RECORDING, doc="a recording of any format; a reading document beside it applies")
    column: str = declare(
        Text(text="name of a column"),
        doc="header of the column, with or without unit, or its number from 1; for bags and MCAP files topic and field, "
        "such as `/motor/target` (a number), `/states/position[2]` or `/joint_states/position[joint1]`",
    )
    start: float | None = declare(
        NUMBER,
        doc="simulated time of the earliest sample in any column of the file; by default, the sample's time in the "
        "recording, or 0 if the times come from a wall clock",
        unit="s",
        default=None,
    )
    scale: float = declare(NUMBER, doc="factor on the values, in addition to the unit in the header", default=1.0)
    offset: float = driven("offset added after scaling", default=0.0)
    interpolation: str = declare(
        Choice((*INTERPOLATIONS, "smooth")),
        doc="between samples: a line, the earlier sample's value, or a smooth curve that jumps where the recording jumps and "
        "bridges its gaps",
        default="linear",
    )
    _series: tuple[Array, Array] = field(init=False, repr=False, compare=False)
    _earliest: float = field(init=False, repr=False, compare=False)
    _units: tuple[str, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        require(self.interpolation in (*INTERPOLATIONS, "smooth"), "must be linear, hold or smooth", key="interpolation")
        path = Path(self.file)
        times, values, earliest, units = read_column(path, self.column)
        start = 0.0 if self.start is None and abs(earliest) > STAMP_LIMIT else self.start
        if start is not None:
            # Shift all columns of a file by the same time, since columns with separate clocks begin at different times.
            times = shifted(times, earliest, start)
        object.__setattr__(self, "_series", (times, self.scale * values + self.offset))
        object.__setattr__(self, "_earliest", earliest if start is None else start)
        object.__setattr__(self, "_units", units)

    @property
    def samples(self) -> tuple[Array, Array]:
        """Times in s and values of the played samples, (n,) each."""
        return self._series

    @property
    def earliest(self) -> float:
        """Simulated time of the earliest sample in any column of the file, s."""
        return self._earliest

    @property
    def units(self) -> tuple[str, ...]:
        """SI units that the column may have before it is scaled, with "1" for a pure number, or an unknown unit in its header.
        No unit if neither header nor name states a unit.
        """
        return self._units

    @cached_property
    def _curve(self) -> CubicCurve:
        return curve_through(*self._series)

    def values(self, time: Array) -> Array:
        if self.interpolation == "smooth":
            return self._curve.values(np.asarray(time))
        return interpolate(np.asarray(time), *self._series, self.interpolation)

    def jumps(self, start: float, end: float) -> Array:
        if self.interpolation == "smooth":
            return between(self._curve.jumps, start, end)
        return hold_jumps(*self._series, start, end) if self.interpolation == "hold" else np.empty(0)
