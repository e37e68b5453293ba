"""Base class of signals: scalar functions of time that list their jumps."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np

from asrsim.registry import Registry
from asrsim.samples import Array


class Signal(ABC):
    """Scalar function of simulated time. Signals are immutable, and are evaluated for many times at once."""

    kind: ClassVar[str]
    """Name in the registry, which is the signal's key in a scenario."""

    @abstractmethod
    def values(self, time: Array) -> Array:
        """Values (n,) at the times (n,) in s, in the unit of the driven quantity. At a jump: the value after the jump."""

    def jumps(self, start: float, end: float) -> Array:
        """Times in [start, end] at which the value jumps, ascending, s. A jump exactly at `start` is included."""
        return np.empty(0)


SIGNALS: Registry[type[Signal]] = Registry("signal", "asrsim.signals", base=Signal, label="kind")
"""Kinds of signals by name; `asrsim.signals` adds its own."""
