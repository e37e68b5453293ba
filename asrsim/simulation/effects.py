"""Imperfections: delay, hold at a rate, seeded noise and quantisation of commands (signals) and of sensors.

The PID controllers of the motors (modes 5, 6) or of the link (mode 1) use the sensors' measurements instead of the true values.
The laws of the actuators are unchanged: a position error acts like the opposite error of the reference, a velocity error like
a torque. All imperfections are off by default.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from asrsim.samples import Array
from asrsim.scenario.data import Effects
from asrsim.signals.base import Signal
from asrsim.signals.combine import Delay
from asrsim.signals.common import rounded

_BLOCK = 4096
"""Number of noise samples that are drawn in one call."""


@dataclass(frozen=True)
class Noise:
    """Gaussian random values by index; the values do not depend on the order of the calls."""

    seed: tuple[int, ...]
    deviation: float

    def draw(self, index: Array) -> Array:
        """Random values with the numbers `index` (n,), which are integers stored as floats."""
        blocks, places = np.divmod(index.astype(np.int64), _BLOCK)
        values = np.empty(np.shape(index))
        for block in np.unique(blocks).tolist():
            generator = np.random.Generator(np.random.Philox(np.random.SeedSequence([*self.seed, block & 0xFFFFFFFF])))
            mask = blocks == block
            values[mask] = generator.standard_normal(_BLOCK)[places[mask]]
        return self.deviation * values


@dataclass(frozen=True, kw_only=True)
class Imperfect(Signal):
    """A signal with the imperfections of `Effects`."""

    kind: ClassVar[str] = "imperfect"

    of: Signal
    effects: Effects
    step: float
    """Sampling interval in s of noise without a declared rate."""
    seed: tuple[int, ...]

    def values(self, time: Array) -> Array:
        effects = self.effects
        period = 1.0 / effects.rate if effects.rate else self.step
        # A tick at the time of a sample belongs to this sample, even if rounding makes the tick slightly later.
        ticks = np.floor(time / period + 1e-6)
        seen = rounded(ticks * period) if effects.rate else time
        # Before the delay has passed, the delayed signal has its value at t = 0.
        values = self._delayed.values(np.maximum(seen, effects.delay))
        if effects.noise:
            values = values + Noise(self.seed, effects.noise).draw(ticks)
        if effects.quantum:
            values = effects.quantum * np.round(values / effects.quantum)
        return values

    def jumps(self, start: float, end: float) -> Array:
        effects = self.effects
        if effects.rate:
            period = 1.0 / effects.rate
            return rounded(np.arange(np.ceil(start / period - 1e-9), np.floor(end / period + 1e-9) + 1) * period)
        return self._delayed.jumps(max(start, effects.delay), end)

    @cached_property
    def _delayed(self) -> Signal:
        return Delay(by=self.effects.delay, of=self.of) if self.effects.delay else self.of


@dataclass(frozen=True)
class Sensor:
    """The encoders of a joint's controllers."""

    effects: Effects
    delay: int
    """Delay in substeps."""
    on_link: bool
    """Whether the encoders measure the position of the link (mode 1) instead of the motors."""
    noises: tuple[Noise | None, ...]
    """Noise of each encoder."""

    @property
    def count(self) -> int:
        """Number of encoders."""
        return len(self.noises)

    def fill(self, table: Array, first: int, substep: float) -> None:
        """Fill `table` (n, 2 count): whether each encoder takes a sample, and its noise, at the substeps from `first` on."""
        every = 1.0 / (self.effects.rate * substep) if self.effects.rate else 1.0
        # A tick at the time of a substep belongs to this substep, even if rounding makes the tick slightly later.
        ticks = np.floor(np.arange(first - 1, first + len(table)) / every + 1e-6)
        samples_now = np.diff(ticks) > 0.0
        if first == 0:
            samples_now[0] = True
        for index, noise in enumerate(self.noises):
            table[:, 2 * index] = samples_now
            if noise is not None:
                table[:, 2 * index + 1] = noise.draw(ticks[1:])
