"""From one value to another: straight, or smoothly with minimum jerk."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from asrsim.document.block import declare
from asrsim.document.kinds import POSITIVE
from asrsim.samples import Array
from asrsim.signals.base import Signal
from asrsim.signals.common import driven, require, since, start_time


@dataclass(frozen=True, kw_only=True)
class Ramp(Signal):
    """A straight line from one value to another, then rest."""

    kind: ClassVar[str] = "ramp"

    start: float = start_time()
    duration: float = declare(POSITIVE, doc="length of the ramp", unit="s")
    initial: float = driven("value at the start", default=0.0, key="from")
    final: float = driven("value at the end and after it", key="to")

    def __post_init__(self) -> None:
        require(self.duration > 0.0, "must be larger than 0", key="duration")

    def values(self, time: Array) -> Array:
        share = self._way((since(time, self.start) / self.duration).clip(max=1.0))
        return self.initial * (1.0 - share) + self.final * share

    def _way(self, s: Array) -> Array:
        """Share of the way at a share `s` of the time."""
        return s


@dataclass(frozen=True, kw_only=True)
class MinimumJerk(Ramp):
    """Fifth-order polynomial 10 s^3 - 15 s^4 + 6 s^5 from rest to rest (Flash and Hogan 1985)."""

    kind: ClassVar[str] = "minimum_jerk"

    duration: float = declare(POSITIVE, doc="length of the motion", unit="s")

    def _way(self, s: Array) -> Array:
        return s * s * s * (10.0 + s * (6.0 * s - 15.0))
