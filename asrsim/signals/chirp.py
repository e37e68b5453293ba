"""A chirp: a sinusoid whose frequency sweeps."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from asrsim.document.block import declare
from asrsim.document.kinds import NUMBER, POSITIVE, Choice
from asrsim.samples import Array
from asrsim.signals.base import Signal
from asrsim.signals.common import driven, require, since, start_time


@dataclass(frozen=True, kw_only=True)
class Chirp(Signal):
    """Sine sweep between two frequencies, linear or logarithmic in time; it rests at its last value after the end."""

    kind: ClassVar[str] = "chirp"

    amplitude: float = driven("half of the peak-to-peak value")
    start_frequency: float = declare(POSITIVE, doc="frequency at the start", unit="Hz", key="from")
    end_frequency: float = declare(POSITIVE, doc="frequency at the end", unit="Hz", key="to")
    duration: float = declare(POSITIVE, doc="length of the sweep", unit="s")
    law: str = declare(
        Choice(("linear", "logarithmic")), doc="how the frequency grows: by equal steps, or by equal factors", default="linear"
    )
    phase: float = declare(NUMBER, doc="phase at the start", unit="rad", default=0.0)
    offset: float = driven("added to it", default=0.0)
    start: float = start_time()

    def __post_init__(self) -> None:
        require(self.duration > 0.0, "must be larger than 0", key="duration")
        require(self.start_frequency > 0.0, "must be larger than 0", key="start_frequency")
        require(self.end_frequency > 0.0, "must be larger than 0", key="end_frequency")
        require(self.law in ("linear", "logarithmic"), "must be linear or logarithmic", key="law")

    def values(self, time: Array) -> Array:
        t = since(time, self.start).clip(max=self.duration)
        first, last, length = self.start_frequency, self.end_frequency, self.duration
        if self.law == "linear" or first == last:
            cycles = t * (first + 0.5 * (last - first) * t / length)
        else:
            rate = math.log(last / first) / length
            cycles = first * np.expm1(rate * t) / rate
        return self.offset + self.amplitude * np.sin(2.0 * math.pi * cycles + self.phase)
