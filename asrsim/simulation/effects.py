"""Imperfections on signals: delay, hold at a control rate, seeded noise, quantisation, in this order."""

from __future__ import annotations

from dataclasses import dataclass, field
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
    _blocks: dict[int, Array] = field(default_factory=dict, repr=False, compare=False)

    def draw(self, index: Array) -> Array:
        """Random values with the numbers `index` (n,), which are integers stored as floats."""
        indices = index.astype(np.int64)
        result = np.empty(np.shape(indices))
        for block in np.unique(indices // _BLOCK):
            if block not in self._blocks:
                if len(self._blocks) > 8:
                    self._blocks.clear()
                generator = np.random.Generator(np.random.Philox(np.random.SeedSequence([*self.seed, int(block) & 0xFFFFFFFF])))
                self._blocks[int(block)] = generator.standard_normal(_BLOCK)
            mask = indices // _BLOCK == block
            result[mask] = self._blocks[int(block)][indices[mask] % _BLOCK]
        return self.deviation * result


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


def through(signal: Signal, effects: Effects | None, *, step: float, seed: tuple[int, ...]) -> Signal:
    """`signal` with the imperfections `effects`; the unchanged signal if none is active."""
    if effects is None or not effects.active:
        return signal
    return Imperfect(of=signal, effects=effects, step=step, seed=seed)
