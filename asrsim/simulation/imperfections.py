"""Imperfections: delay, hold at a rate, seeded noise and quantisation of commands (signals) and of sensors.

The PID controllers of the motors (modes 5, 6) or of the link (mode 1) use the sensors' measurements instead of the true values.
The laws of the actuators are unchanged: a position error acts like the opposite error of the reference, and a velocity error
acts like a torque. All imperfections are off by default.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from asrsim.samples import Array
from asrsim.scenario.data import Imperfections
from asrsim.signals.base import Signal
from asrsim.signals.combine import Delay
from asrsim.signals.common import rounded

_BLOCK = 4096
"""Number of noise samples that are drawn in one call."""
LOOKS, BISECTIONS = 4, 40
"""LOOKS: number of samples of a quantised command in each step; BISECTIONS: number of bisections that find a jump between two
samples."""
SAME = 1e-6
"""Smallest time between two jumps, as a fraction of a step."""


@dataclass(frozen=True)
class Noise:
    """Gaussian random values by index; the values do not depend on the order of the calls."""

    seed: tuple[int, ...]
    deviation: float

    def draw(self, index: Array) -> Array:
        """Random values for the indices `index` (n,), which are integers stored as floats."""
        blocks, places = np.divmod(index.astype(np.int64), _BLOCK)
        values = np.empty(np.shape(index))
        for block in np.unique(blocks).tolist():
            generator = np.random.Generator(np.random.Philox(np.random.SeedSequence([*self.seed, block & 0xFFFFFFFF])))
            mask = blocks == block
            values[mask] = generator.standard_normal(_BLOCK)[places[mask]]
        return self.deviation * values


@dataclass(frozen=True, kw_only=True)
class Imperfect(Signal):
    """A signal with the imperfections of `Imperfections`."""

    kind: ClassVar[str] = "imperfect"

    of: Signal
    imperfections: Imperfections
    step: float
    """Sampling interval in s of noise without a declared rate."""
    seed: tuple[int, ...]

    def values(self, time: Array) -> Array:
        exact, quantum = self._exact(time), self.imperfections.quantum
        return quantum * np.round(exact / quantum) if quantum else exact

    def _exact(self, time: Array) -> Array:
        """Values before they are rounded to the quantum."""
        imperfections = self.imperfections
        period = 1.0 / imperfections.rate if imperfections.rate else self.step
        # Include a tick at the time of the sample, even if a rounding error makes the tick slightly later.
        ticks = np.floor(time / period + 1e-6)
        seen = rounded(ticks * period) if imperfections.rate else time
        # Before the delay has passed, the delayed signal has its value at t = 0.
        values = self._delayed.values(np.maximum(seen, imperfections.delay))
        if imperfections.noise:
            values = values + Noise(self.seed, imperfections.noise).draw(ticks)
        return values

    def jumps(self, start: float, end: float) -> Array:
        imperfections = self.imperfections
        if imperfections.rate:
            return ticks(1.0 / imperfections.rate, start, end)
        jumps = self._delayed.jumps(max(start, imperfections.delay), end)
        if imperfections.noise:
            jumps = np.union1d(jumps, ticks(self.step, start, end))
        if imperfections.quantum:
            jumps = np.union1d(jumps, self._crossings(start, end))
            # A jump of the signal is also found as a crossing, at nearly the same time. Keep only one of the two.
            jumps = jumps[np.diff(jumps, prepend=-1.0) > SAME * self.step]
        return jumps

    def _crossings(self, start: float, end: float) -> Array:
        """Times in [start, end] at which the rounded value changes by one quantum, s.

        The value is sampled `LOOKS` times a step. A value that changes by several quanta between two samples is treated as a
        value without a quantum.
        """
        apart = self.step / LOOKS
        times = apart * np.arange(np.floor(start / apart), np.ceil(end / apart) + 1)
        quantum = self.imperfections.quantum
        levels = np.round(self._exact(times) / quantum)
        at = np.flatnonzero(np.abs(np.diff(levels)) == 1.0)
        low, high = times[at], times[at + 1]
        for _ in range(BISECTIONS if len(at) else 0):
            middle = 0.5 * (low + high)
            before = np.round(self._exact(middle) / quantum) == levels[at]
            low, high = np.where(before, middle, low), np.where(before, high, middle)
        return high[(start <= high) & (high <= end)]

    @cached_property
    def _delayed(self) -> Signal:
        return Delay(by=self.imperfections.delay, of=self.of) if self.imperfections.delay else self.of


def ticks(period: float, start: float, end: float) -> Array:
    """Multiples of the period in [start, end], s."""
    return rounded(np.arange(np.ceil(start / period - 1e-9), np.floor(end / period + 1e-9) + 1) * period)


@dataclass(frozen=True, kw_only=True)
class Sensor:
    """The encoders of a joint's controllers. An encoder with a rate measures at its ticks and holds the measurements; other
    encoders measure at all times.
    """

    imperfections: Imperfections
    step: float
    """Sampling interval in s of noise without a declared rate."""
    substep: float
    """Length of a substep in s."""
    on_link: bool
    """Whether the encoders measure the position of the link (mode 1) instead of the motors."""
    noises: tuple[Noise | None, ...]
    """Noise of each encoder."""

    @property
    def count(self) -> int:
        """Number of encoders."""
        return len(self.noises)

    @property
    def delay(self) -> float:
        """Delay in substeps."""
        return self.imperfections.delay / self.substep

    @property
    def memory(self) -> int:
        """Number of substeps whose positions and velocities are remembered."""
        return int(self.delay + 0.5) + 3

    @property
    def _period(self) -> float:
        """Time in s for which a draw of the noise acts."""
        return 1.0 / self.imperfections.rate if self.imperfections.rate else self.step

    def jumps(self, start: float, end: float) -> Array:
        """Times in [start, end] at which measurements jump, s. If a quantised measurement has no rate, these are the times of
        all substeps."""
        imperfections = self.imperfections
        if imperfections.rate or (imperfections.noise and not imperfections.quantum):
            return ticks(self._period, start, end)
        return ticks(self.substep, start, end) if imperfections.quantum else np.empty(0)

    def fill(self, table: Array, begins: Array, margin: float, window: float) -> None:
        """Write two numbers per encoder into `table` (n, 2 count): whether the encoder takes a sample at the beginning of a
        piece of a kick, and the noise of the encoder in this piece. begins: times (n,) in s at which the pieces begin. A sample
        is taken if a tick is at most `margin` s later, and less than `window` s earlier.
        """
        numbers = np.floor((begins + margin) / self._period)
        samples = begins - numbers * self._period < window if self.imperfections.rate else True
        for index, noise in enumerate(self.noises):
            table[:, 2 * index] = samples
            if noise is not None:
                table[:, 2 * index + 1] = noise.draw(numbers)
