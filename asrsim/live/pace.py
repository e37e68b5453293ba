"""Timing of a real-time run: when the next tick is due, how late ticks are, and how much time the run spends working."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable

import numpy as np

SLIP = 0.25
"""Lateness of a tick in s above which a run does not catch up. The next ticks are then due relative to the current time."""
NAP = 0.1
"""Longest sleep of one call of `Pace.wait`, s. Between calls, a run receives commands and can be stopped."""
RECENT = 10_000
"""Number of the latest ticks whose lateness is stored."""
MOST_LATE, MEMORY = 0.6, 2.0
"""MOST_LATE: fraction of late ticks above which a run counts as being behind; MEMORY: time constant of this fraction, s."""


class Pace:
    """Synchronises the ticks of a simulation with the wall clock."""

    def __init__(
        self, speed: float, *, now: Callable[[], float] = time.perf_counter, sleep: Callable[[float], None] = time.sleep
    ) -> None:
        """speed: simulated seconds per wall-clock second; infinite: the run does not wait."""
        self._now, self._sleep = now, sleep
        self._late: deque[float] = deque(maxlen=RECENT)
        self.ticks, self.worst = 0, 0.0
        self.slips, self.slipped = 0, 0.0
        """slips: number of times that the run stopped catching up; slipped: total time lost, s."""
        self.busy = 0.0
        """Time spent working (not sleeping), s."""
        self.speed = speed
        self._late_share = 0.0
        """Recent fraction of the ticks that were late by more than a tick."""
        self.start()

    def start(self) -> None:
        """Start the clock at the beginning of the run."""
        self._due = self._awake = self._now()

    def lateness(self) -> tuple[float, float]:
        """Median and 99th percentile of the lateness of recent ticks, s."""
        median, high = np.quantile(self._late or [0.0], (0.5, 0.99)).tolist()
        return median, high

    @property
    def late(self) -> float:
        """Lateness of the latest tick, s."""
        return self._late[-1] if self._late else 0.0

    def is_behind(self) -> bool:
        """Whether most ticks of the last two seconds were late by more than a tick. If the method returns True, all ticks up to
        this call count as punctual.
        """
        if behind := self._late_share > MOST_LATE:
            self._late_share = 0.0
        return behind

    def wait(self, simulated: float) -> float | None:
        """Sleep until the tick is due, `simulated` s after the previous tick, and return the lateness in s.

        One call sleeps for at most NAP s. If the tick is not due yet, the method returns None; then call it again.
        """
        now = self._now()
        self.busy += now - self._awake
        if math.isinf(self.speed):
            self._awake = now
            return 0.0
        tick = simulated / self.speed
        due = self._due + tick
        if now < due:
            self._sleep(min(due - now, NAP))
        self._awake = self._now()
        if due - now > NAP:
            return None
        self._due = due
        late = self._awake - due
        self._late.append(late)
        self.ticks, self.worst = self.ticks + 1, max(self.worst, late)
        self._late_share += min(1.0, tick / MEMORY) * ((late > tick) - self._late_share)
        if late > SLIP:
            self.slips += 1
            self.slipped += late
            self._due = self._awake
        return late
