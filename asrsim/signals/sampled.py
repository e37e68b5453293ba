"""Samples of a signal that the library computed: planned references, learned inputs. Scenarios use `playback` instead."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from asrsim.samples import Array
from asrsim.signals.base import Signal


@dataclass(frozen=True, kw_only=True, eq=False)
class Sampled(Signal):
    """Straight lines between samples; the ends hold. Not in the registry: it has no form in a document."""

    kind: ClassVar[str] = "sampled"

    times: Array
    """(n,) s, ascending."""
    samples: Array
    """(n,) in the unit of what it drives."""

    def __post_init__(self) -> None:
        # No negative zero: a playback of the same numbers, which adds an offset, has none either.
        object.__setattr__(self, "samples", np.asarray(self.samples, dtype=np.float64) + 0.0)

    def values(self, time: Array) -> Array:
        return np.asarray(np.interp(time, self.times, self.samples), dtype=np.float64)
