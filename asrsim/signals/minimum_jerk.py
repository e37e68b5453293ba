"""Minimum jerk: the smooth point-to-point motion (Flash and Hogan 1985)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from asrsim.document.block import declare
from asrsim.samples import Array
from asrsim.signals.base import Signal
from asrsim.signals.common import POSITIVE, driven, require, since, start_time


@dataclass(frozen=True, kw_only=True)
class MinimumJerk(Signal):
    """Fifth-order polynomial 10 s^3 - 15 s^4 + 6 s^5 from rest to rest (Flash and Hogan 1985)."""

    kind: ClassVar[str] = "minimum_jerk"

    start: float = start_time()
    duration: float = declare(POSITIVE, doc="length of the motion", unit="s")
    initial: float = driven("value at the start", default=0.0, key="from")
    final: float = driven("value at the end and after it", key="to")

    def __post_init__(self) -> None:
        require(self.duration > 0.0, "must be larger than 0", key="duration")

    def values(self, time: Array) -> Array:
        s: Array = (since(time, self.start) / self.duration).clip(max=1.0)
        share = s * s * s * (10.0 + s * (6.0 * s - 15.0))
        return self.initial * (1.0 - share) + self.final * share
