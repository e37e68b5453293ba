"""A multisine: several sinusoids at once, to excite several frequencies."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from asrsim.document.block import declare
from asrsim.document.composite import Either, ListOf, is_list, is_scalar
from asrsim.document.kinds import NUMBER, POSITIVE, Choice, Integer
from asrsim.samples import Array
from asrsim.signals.base import Signal
from asrsim.signals.common import VALUE, driven, require, since, start_time

_AMPLITUDES = Either(((is_scalar, NUMBER), (is_list, ListOf(of=NUMBER, minimum=1))))
_PHASES = Either(((is_scalar, Choice(("schroeder", "random", "zero"))), (is_list, ListOf(of=NUMBER, minimum=1))))


@dataclass(frozen=True, kw_only=True)
class Multisine(Signal):
    """offset + sum of amplitude_i sin(2 pi f_i (t - start) + phase_i)."""

    kind: ClassVar[str] = "multisine"

    frequencies: tuple[float, ...] = declare(ListOf(of=POSITIVE, minimum=1), doc="the frequencies", unit="Hz")
    amplitudes: float | tuple[float, ...] = declare(
        _AMPLITUDES, doc="amplitude of all, or of each", unit=VALUE, key="amplitude"
    )
    phases: str | tuple[float, ...] = declare(
        _PHASES,
        doc="phases: schroeder's (low peaks, Schroeder 1970), random by the seed, zero, or a list",
        unit="rad",
        default="schroeder",
        key="phase",
    )
    seed: int = declare(Integer(minimum=0), doc="of random phases", default=0)
    offset: float = driven("added to it", default=0.0)
    start: float = start_time()

    def __post_init__(self) -> None:
        count = len(self.frequencies)
        require(count > 0, "needs at least one frequency", key="frequencies")
        for key, values in (("amplitudes", self.amplitudes), ("phases", self.phases)):
            if isinstance(values, tuple):
                require(len(values) == count, f"has {len(values)} entries for {count} frequencies", key=key)

    def phase_values(self) -> Array:
        """(number of frequencies,) rad."""
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
