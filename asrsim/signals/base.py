"""What a signal is: a scalar function of time that knows its jumps."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np

from asrsim.samples import Array


class Signal(ABC):
    """A scalar function of simulated time. Immutable; evaluated in bulk before and between chunks of the run."""

    kind: ClassVar[str]
    """Registry name: the key in a scenario."""

    @abstractmethod
    def values(self, time: Array) -> Array:
        """Values at `time` (n,) in s, continuous from the right at jumps; (n,) in the unit of what it drives."""

    def jumps(self, start: float, end: float) -> Array:
        """Times in [start, end] at which the value jumps, ascending; a jump from rest at the very start counts too."""
        return np.empty(0)
