"""A step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from asrsim.document.block import declare
from asrsim.document.kinds import NUMBER
from asrsim.samples import Array
from asrsim.signals.base import Signal
from asrsim.signals.common import between, driven


@dataclass(frozen=True, kw_only=True)
class Step(Signal):
    """A jump from one value to another; at the time of the jump the new value holds already."""

    kind: ClassVar[str] = "step"

    at: float = declare(NUMBER, doc="time of the jump", unit="s", default=0.0)
    before: float = driven("value before the jump", default=0.0, key="from")
    after: float = driven("value from the jump on", key="to")

    def values(self, time: Array) -> Array:
        return np.where(np.asarray(time) >= self.at, self.after, self.before)

    def jumps(self, start: float, end: float) -> Array:
        return between(np.array([self.at] if self.before != self.after else []), start, end)
