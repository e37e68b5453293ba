"""Signal made of computed samples, such as planned references or learned inputs. Scenario files use `playback` instead."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from asrsim.samples import Array
from asrsim.signals.base import Signal
from asrsim.signals.common import between


@dataclass(frozen=True, kw_only=True, eq=False)
class Sampled(Signal):
    """Linear interpolation between samples, constant before the first and after the last sample. Of two samples at the same
    time, the first is the value before a jump, and the second is the value after the jump. Scenario files cannot contain this
    signal.
    """

    kind: ClassVar[str] = "sampled"

    times: Array
    """Ascending times (n,), s."""
    samples: Array
    """Values (n,) in the unit of the driven quantity."""

    def __post_init__(self) -> None:
        # Change the numbers -0.0 to 0.0 by adding 0.0. A playback of these samples from a log adds an offset, which has the
        # same effect.
        object.__setattr__(self, "samples", np.asarray(self.samples, dtype=np.float64) + 0.0)

    def values(self, time: Array) -> Array:
        return np.asarray(np.interp(time, self.times, self.samples), dtype=np.float64)

    def jumps(self, start: float, end: float) -> Array:
        twice = (self.times[1:] == self.times[:-1]) & (self.samples[1:] != self.samples[:-1])
        return between(self.times[1:][twice], start, end)
