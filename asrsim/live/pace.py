"""Real time: when the next tick is due, how late ticks come, and how much of their time is work."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

SLIP = 0.25
"""s behind at which a run gives up catching up and goes on from now."""
NAP = 0.1
"""s after which a long wait is interrupted, so that commands are heard and a run can be stopped."""
_PER_DECADE = 40
"""Classes of lateness for each factor of ten."""
_LEAST = 1e-6
"""s of lateness below which ticks are not told apart."""


class Lateness:
    """A histogram of waiting times in s, to 6 %; its memory does not grow."""

    def __init__(self) -> None:
        self._counts = [0] * (8 * _PER_DECADE)
        self.count, self.worst = 0, 0.0

    def add(self, late: float) -> None:
        """One more, in s."""
        place = int(_PER_DECADE * math.log10(late / _LEAST)) if late > _LEAST else 0
        self._counts[min(place, len(self._counts) - 1)] += 1
        self.count += 1
        self.worst = max(self.worst, late)

    def quantile(self, share: float) -> float:
        """s below which this share of them is."""
        wanted, seen = share * self.count, 0
        for place, count in enumerate(self._counts):
            seen += count
            if seen >= wanted and count:
                return min(_LEAST * math.pow(10.0, (place + 1) / _PER_DECADE), self.worst)
        return 0.0


class Pace:
    """Ticks of a simulation against the wall clock."""

    def __init__(
        self, speed: float, *, now: Callable[[], float] = time.perf_counter, sleep: Callable[[float], None] = time.sleep
    ) -> None:
        """speed: simulated s a second; infinite: as fast as it goes."""
        self._now, self._sleep = now, sleep
        self.lateness = Lateness()
        self.slips, self.slipped = 0, 0.0
        """How often the run fell behind for good, and by how many s in all."""
        self.busy = 0.0
        """s of work."""
        self.set_speed(speed)

    def set_speed(self, speed: float) -> None:
        """From here on."""
        self.speed = speed
        self.start()

    def start(self) -> None:
        """Time counts from now: at the beginning, after a pause."""
        self._due = self._awake = self._now()

    def wait(self, simulated: float) -> float | None:
        """Sleep until `simulated` s after the tick before this one are due; returns by how many s it is late.

        None: it is not due yet after a nap of 0.1 s; ask again."""
        now = self._now()
        self.busy += now - self._awake
        if math.isinf(self.speed):
            self._awake = now
            return 0.0
        due = self._due + simulated / self.speed
        if now < due:
            self._sleep(min(due - now, NAP))
        self._awake = self._now()
        if due - now > NAP:
            return None
        self._due = due
        late = self._awake - self._due
        self.lateness.add(late)
        if late > SLIP:
            self.slips += 1
            self.slipped += late
            self._due = self._awake
        return late
