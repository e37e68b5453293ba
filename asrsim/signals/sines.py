"""Signals that consist of sines: sinusoid, chirp and multisine."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from asrsim.document.block import declare
from asrsim.document.kinds import NUMBER, POSITIVE, Choice, Either, Integer, ListOf
from asrsim.samples import Array
from asrsim.signals.base import Signal
from asrsim.signals.common import VALUE, driven, require, since, start_time


@dataclass(frozen=True, kw_only=True)
class Sinusoid(Signal):
    """offset + amplitude sin(omega (t - start) + phase)."""

    kind: ClassVar[str] = "sinusoid"

    amplitude: float = driven("half of the peak-to-peak value")
    frequency: float | None = declare(POSITIVE, doc="frequency (or angular_frequency)", unit="Hz", default=None)
    angular_frequency: float | None = declare(POSITIVE, doc="angular frequency (or frequency)", unit="rad/s", default=None)
    phase: float = declare(NUMBER, doc="phase at the start", unit="rad", default=0.0)
    offset: float = driven("constant added to the signal", default=0.0)
    start: float = start_time()

    def __post_init__(self) -> None:
        given = [self.frequency, self.angular_frequency].count(None)
        require(given != 2, "needs the key frequency (Hz) or angular_frequency (rad/s)", key="")
        require(given != 0, "is not allowed with the key frequency: give one of the two", key="angular_frequency")

    @property
    def omega(self) -> float:
        """Angular frequency in rad/s."""
        if self.angular_frequency is not None:
            return self.angular_frequency
        return 2.0 * math.pi * (self.frequency or 0.0)

    def values(self, time: Array) -> Array:
        return self.offset + self.amplitude * np.sin(self.omega * since(time, self.start) + self.phase)


@dataclass(frozen=True, kw_only=True)
class Chirp(Signal):
    """Sine sweep between two frequencies, linear or logarithmic in time, constant after the end."""

    kind: ClassVar[str] = "chirp"

    amplitude: float = driven("half of the peak-to-peak value")
    start_frequency: float = declare(POSITIVE, doc="frequency at the start", unit="Hz", key="from")
    end_frequency: float = declare(POSITIVE, doc="frequency at the end", unit="Hz", key="to")
    duration: float = declare(POSITIVE, doc="length of the sweep", unit="s")
    law: str = declare(
        Choice(("linear", "logarithmic")),
        doc="growth of the frequency: by equal differences (linear) or by equal factors (logarithmic)",
        default="linear",
    )
    phase: float = declare(NUMBER, doc="phase at the start", unit="rad", default=0.0)
    offset: float = driven("constant added to the signal", default=0.0)
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


_AMPLITUDES = Either((NUMBER, ListOf(of=NUMBER, minimum=1)))
_PHASES = Either((Choice(("schroeder", "random", "zero")), ListOf(of=NUMBER, minimum=1)))


@dataclass(frozen=True, kw_only=True)
class Multisine(Signal):
    """offset + sum of amplitude_i sin(2 pi f_i (t - start) + phase_i)."""

    kind: ClassVar[str] = "multisine"

    frequencies: tuple[float, ...] = declare(ListOf(of=POSITIVE, minimum=1), doc="the frequencies", unit="Hz")
    amplitudes: float | tuple[float, ...] = declare(
        _AMPLITUDES, doc="one amplitude for all frequencies, or a list", unit=VALUE, key="amplitude"
    )
    phases: str | tuple[float, ...] = declare(
        _PHASES,
        doc="phases: schroeder (small peaks, Schroeder 1970), random (by the seed), zero, or a list",
        unit="rad",
        default="schroeder",
        key="phase",
    )
    seed: int = declare(Integer(minimum=0), doc="seed of the random phases", default=0)
    offset: float = driven("constant added to the signal", default=0.0)
    start: float = start_time()

    def __post_init__(self) -> None:
        count = len(self.frequencies)
        require(count > 0, "needs at least one frequency", key="frequencies")
        for key, values in (("amplitudes", self.amplitudes), ("phases", self.phases)):
            if isinstance(values, tuple):
                require(len(values) == count, f"has {len(values)} entries for {count} frequencies", key=key)

    def phase_values(self) -> Array:
        """Phases (number of frequencies,), rad."""
        count = len(self.frequencies)
        if isinstance(self.phases, tuple):
            return np.array(self.phases)
        if self.phases == "random":
            return np.random.default_rng(self.seed).uniform(0.0, 2.0 * math.pi, count)
        if self.phases == "schroeder":
            index = np.arange(count)
            return -math.pi * index * (index + 1) / count
        return np.zeros(count)

    def values(self, time: Array) -> Array:
        t = since(time, self.start)
        total = np.full(t.shape, self.offset)
        amplitudes = np.broadcast_to(np.array(self.amplitudes), (len(self.frequencies),))
        for frequency, amplitude, phase in zip(self.frequencies, amplitudes, self.phase_values(), strict=True):
            total += amplitude * np.sin(2.0 * math.pi * frequency * t + phase)
        return total
