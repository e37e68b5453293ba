"""Times that are counted from long ago: dates as days, and clocks of computers as ticks."""

from __future__ import annotations

from dataclasses import dataclass

SLOWEST, FASTEST = 0.5, 3e-5
"""s between samples that are not suspected."""
_DAY = 86400.0
"""s in a day."""


@dataclass(frozen=True)
class Calendar:
    """What a program counts."""

    counts: str
    unit: float
    """s of one."""
    zero: float
    """Number of 1970-01-01."""
    low: float
    high: float
    """Numbers of dates that recordings have."""


_CALENDARS = (
    Calendar("days, as MATLAB counts dates", _DAY, 719529.0, 690_000.0, 780_000.0),
    Calendar("days, as Excel counts dates", _DAY, 25569.0, 20_000.0, 70_000.0),
    Calendar("days, as an astronomer counts dates", _DAY, 2440587.5, 2_440_000.0, 2_500_000.0),
    Calendar("ticks of 100 ns, as Windows counts them", 1e-7, 1.16444736e17, 1.2e17, 1.5e17),
    Calendar("ticks of 100 ns, as .NET counts them", 1e-7, 6.21355968e17, 6.2e17, 6.7e17),
)
"""Known ones. Ticks, as ns since 1970, would be of 1974 and 1990, when nothing counted ns."""


def calendar_of(size: float, step: float) -> Calendar | None:
    """The calendar of numbers of that size that are `step` apart; None of times that are none of these."""
    found = next((one for one in _CALENDARS if one.low < size < one.high), None)
    if found is None or not FASTEST <= step * found.unit <= SLOWEST:
        return None
    # Some ten thousand s of a clock are no days, unless they would be too near to each other.
    return found if found.unit < 1.0 or step < FASTEST else None
