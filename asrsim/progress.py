"""Progress of a long computation, and requests to stop it: types of the functions `progress` and `stop` of callers."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias


@dataclass(frozen=True, kw_only=True)
class Progress:
    """Progress of a long computation: its current part, and the finished fraction of this part."""

    task: str = ""
    """Name of the current part of the work, such as `finer steps`; "": the work does not consist of parts."""
    fraction: float = math.nan
    """Finished fraction of this part, from 0 to 1; nan: unknown."""
    time: float = math.nan
    """Simulated time in s that a run has reached; nan: the work is not a run."""


Tell: TypeAlias = Callable[[Progress], None]
"""Function that a long computation calls from time to time with its progress."""
Stop: TypeAlias = Callable[[], bool]
"""Function that a long computation calls often. If the function returns True, the computation ends early."""


def tell_nobody(_: Progress) -> None:
    """A function `progress` that does nothing with the progress."""


def never() -> bool:
    """A function `stop` that never stops the work."""
    return False
