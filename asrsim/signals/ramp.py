"""A ramp."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from asrsim.document.block import declare
from asrsim.samples import Array
from asrsim.signals.base import Signal
from asrsim.signals.common import POSITIVE, driven, require, since, start_time


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
        share = (since(time, self.start) / self.duration).clip(max=1.0)
        return self.initial * (1.0 - share) + self.final * share
