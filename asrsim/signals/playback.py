"""Playback of a recording: a column of a CSV file, or a field of a topic in an MCAP file or ROS bag."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import ClassVar

import numpy as np

from asrsim.document.block import declare
from asrsim.document.kinds import NUMBER, Choice, File, Optional, Text
from asrsim.samples import Array
from asrsim.signals.base import Signal
from asrsim.signals.common import INTERPOLATIONS, between, driven, hold_jumps, interpolate, require
from asrsim.signals.curve import Curve, curve_through
from asrsim.signals.recorded import read_column

STAMP_LIMIT = 1e6
"""s: first times beyond it are taken for stamps of a clock, and start at 0."""

_RECORDING = File(noun="recording", folder=True, beside=".yaml")


def since(times: Array, zero: float, start: float = 0.0) -> Array:
    """Times (n,) in s from `zero`, which becomes `start`, rounded to what the clock resolves: 100.2 is 0.2 s after 100."""
    digits = min(9, int(np.floor(-np.log10(np.spacing(max(float(np.max(np.abs(times))), abs(start), 1e-3))))))
    return np.asarray(np.round(times - zero, digits) + start, dtype=np.float64)


@dataclass(frozen=True, kw_only=True)
class Playback(Signal):
    """A recorded series; before its first and after its last sample the end values hold."""

    kind: ClassVar[str] = "playback"

    file: Path = declare(_RECORDING, doc="a recording of any format; a document beside it says how it is read")
    column: str = declare(
        Text(noun="name of a column"),
        doc="the column, with or without its unit, or its number from 1; of bags and MCAP files topic and field, such as "
        "`/motor/target` of a number, `/states/position[2]` or `/joint_states/position[joint1]`",
    )
    time: str | None = declare(
        Optional(Text(noun="name of a column, or `header`")),
        doc="tables: the time's column (default: the one that is named so); bags: `header` for the messages' own stamps",
        default=None,
    )
    start: float | None = declare(
        Optional(NUMBER),
        doc="simulated time of the first sample; default: the recording's own times, stamps of a clock beginning at 0",
        unit="s",
        default=None,
    )
    scale: float = declare(NUMBER, doc="factor on the values, on top of units that the header names", default=1.0)
    offset: float = driven("added after scaling", default=0.0)
    interpolation: str = declare(
        Choice((*INTERPOLATIONS, "smooth")),
        doc="between samples: a line, the earlier sample's value, or a smooth curve that jumps where the recording does",
        default="linear",
    )
    _series: tuple[Array, Array] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        require(self.interpolation in (*INTERPOLATIONS, "smooth"), "must be linear, hold or smooth", key="interpolation")
        path = Path(self.file)
        times, values = read_column(path, self.column, self.time)
        first = float(times[0])
        if self.start is not None:
            times = since(times, first, self.start)
        elif abs(first) > STAMP_LIMIT:
            times = since(times, first)
        object.__setattr__(self, "_series", (times, self.scale * values + self.offset))

    @property
    def samples(self) -> tuple[Array, Array]:
        """Times in s and values of the recording as played back, (n,) each."""
        return self._series

    @cached_property
    def _curve(self) -> Curve:
        return curve_through(*self._series)

    def values(self, time: Array) -> Array:
        if self.interpolation == "smooth":
            return self._curve.values(np.asarray(time))
        return interpolate(np.asarray(time), *self._series, self.interpolation)

    def jumps(self, start: float, end: float) -> Array:
        if self.interpolation == "smooth":
            return between(self._curve.jumps, start, end)
        return hold_jumps(*self._series, start, end) if self.interpolation == "hold" else np.empty(0)
