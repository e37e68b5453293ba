"""Signals that combine other signals: sum, delay, scale."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from asrsim.document.block import declare
from asrsim.document.kinds import NOT_NEGATIVE, NUMBER, ListOf
from asrsim.samples import Array
from asrsim.signals.base import Signal
from asrsim.signals.common import between, require, rounded
from asrsim.signals.parse import SIGNAL


@dataclass(frozen=True, kw_only=True)
class Sum(Signal):
    """Sum of several signals."""

    kind: ClassVar[str] = "sum"
    main_field: ClassVar[str] = "terms"

    terms: tuple[Signal, ...] = declare(ListOf(of=SIGNAL, minimum=1), doc="the signals; `sum: [...]` sets them too")

    def values(self, time: Array) -> Array:
        total = np.zeros(np.shape(time))
        for term in self.terms:
            total += term.values(time)
        return total

    def jumps(self, start: float, end: float) -> Array:
        return np.unique(np.concatenate([np.empty(0), *(term.jumps(start, end) for term in self.terms)]))


@dataclass(frozen=True, kw_only=True)
class Scale(Signal):
    """Signal times a factor, such as 0.017453292519943295 for a signal in degrees."""

    kind: ClassVar[str] = "scale"

    by: float = declare(NUMBER, doc="the factor")
    of: Signal = declare(SIGNAL, doc="the signal")

    def values(self, time: Array) -> Array:
        return self.by * self.of.values(time)

    def jumps(self, start: float, end: float) -> Array:
        return self.of.jumps(start, end) if self.by else np.empty(0)


@dataclass(frozen=True, kw_only=True)
class Delay(Signal):
    """Signal delayed in time, together with its jumps."""

    kind: ClassVar[str] = "delay"

    by: float = declare(NOT_NEGATIVE, doc="the delay", unit="s")
    of: Signal = declare(SIGNAL, doc="the signal")

    def __post_init__(self) -> None:
        require(self.by >= 0.0, "must be at least 0", key="by")

    def values(self, time: Array) -> Array:
        time = np.asarray(time, dtype=np.float64)
        inner = time - self.by
        if inner.size:
            # Compare times with the delayed times of the jumps, as `jumps` returns them. Otherwise rounding could move a sample
            # across a jump, and `values` would contradict `jumps`.
            jumps = self.of.jumps(float(inner.min()) - 1e-6, float(inner.max()) + 1e-6)
            seen = np.searchsorted(rounded(jumps + self.by), time, side="right")
            found = np.searchsorted(jumps, inner, side="right")
            late, early = found < seen, found > seen
            inner[late] = jumps[seen[late] - 1]
            inner[early] = np.nextafter(jumps[found[early] - 1], -np.inf)
        return self.of.values(inner)

    def jumps(self, start: float, end: float) -> Array:
        inner = self.of.jumps(start - self.by - 1e-6, end - self.by + 1e-6)
        return between(rounded(inner + self.by), start, end)
