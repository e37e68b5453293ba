"""Base class of signals, which are scalar functions of time and list the times of their jumps."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np

from asrsim.registry import Registry
from asrsim.samples import Array


class Signal(ABC):
    """Scalar function of simulated time. A signal is immutable, and is evaluated for many times at once."""

    kind: ClassVar[str]
    """Name of the signal's class in the registry, which is also the key of the signal in a scenario."""

    @abstractmethod
    def values(self, time: Array) -> Array:
        """Values (n,) at the times (n,) in s, in the unit of the driven quantity. At a jump, this is the value after the
        jump."""

    def jumps(self, start: float, end: float) -> Array:
        """Times in s at which the value jumps, ascending, from `start` to `end` with both included."""
        return np.empty(0)


SIGNALS: Registry[type[Signal]] = Registry("signal", "asrsim.signals", base=Signal, label="kind")
"""Kinds of signals by name. `asrsim.signals` adds the kinds that come with asrsim."""
