"""A constant."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from asrsim.samples import Array
from asrsim.signals.base import Signal
from asrsim.signals.common import driven


@dataclass(frozen=True, kw_only=True)
class Constant(Signal):
    """The same value at all times; a bare number in a scenario means this."""

    kind: ClassVar[str] = "constant"
    main_field: ClassVar[str] = "value"

    value: float = driven("the value")

    def values(self, time: Array) -> Array:
        return np.full(np.shape(time), self.value)
