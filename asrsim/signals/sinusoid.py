"""A sinusoid."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from asrsim.document.block import declare
from asrsim.document.kinds import NUMBER, POSITIVE, Optional
from asrsim.samples import Array
from asrsim.signals.base import Signal
from asrsim.signals.common import driven, require, since, start_time


@dataclass(frozen=True, kw_only=True)
class Sinusoid(Signal):
    """offset + amplitude sin(omega (t - start) + phase)."""

    kind: ClassVar[str] = "sinusoid"

    amplitude: float = driven("half of the peak-to-peak value")
    frequency: float | None = declare(Optional(POSITIVE), doc="frequency; this or angular_frequency", unit="Hz", default=None)
    angular_frequency: float | None = declare(
        Optional(POSITIVE), doc="angular frequency; this or frequency", unit="rad/s", default=None
    )
    phase: float = declare(NUMBER, doc="phase at the start", unit="rad", default=0.0)
    offset: float = driven("added to it", default=0.0)
    start: float = start_time()

    def __post_init__(self) -> None:
        given = [self.frequency, self.angular_frequency].count(None)
        require(given != 2, "needs the key frequency (Hz) or angular_frequency (rad/s)", key="")
        require(given != 0, "has both frequency and angular_frequency: give one", key="angular_frequency")

    @property
    def omega(self) -> float:
        """Angular frequency in rad/s."""
        if self.angular_frequency is not None:
            return self.angular_frequency
        return 2.0 * math.pi * (self.frequency or 0.0)

    def values(self, time: Array) -> Array:
        return self.offset + self.amplitude * np.sin(self.omega * since(time, self.start) + self.phase)
