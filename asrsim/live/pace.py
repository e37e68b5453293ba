"""Timing of a real-time run: due time of the next tick, lateness of ticks, and fraction of the time spent working."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable

import numpy as np

SLIP = 0.25
"""Delay in s from which a run stops catching up and continues from the current time."""
NAP = 0.1
"""Longest sleep, s, so that commands are received and a run can be stopped."""
RECENT = 10_000
"""Number of ticks whose lateness is kept."""
WINDOW = 1.0
"""Length of the time window in which late ticks are counted, s."""


class Pace:
    """Synchronises the ticks of a simulation with the wall clock."""

    def __init__(
        self, speed: float, *, now: Callable[[], float] = time.perf_counter, sleep: Callable[[float], None] = time.sleep
    ) -> None:
        """speed: simulated seconds per wall-clock second; infinite: run without waiting."""
        self._now, self._sleep = now, sleep
        self._late: deque[float] = deque(maxlen=RECENT)
        self.ticks, self.worst = 0, 0.0
        self.slips, self.slipped = 0, 0.0
        """Number of times that the run stopped catching up, and total time lost, s."""
        self.busy = 0.0
        """Time spent working (not sleeping), s."""
        self.speed = speed
        self._window = [0, 0]
        """Number of ticks since the last judgement of the pace, and number of these ticks that were late by more than a tick.
        """
        self._was_behind = False
        self.start()
        self._judge_at = self._awake + WINDOW

    def start(self) -> None:
        """Restart the clock at the beginning of the run and after a pause."""
        self._due = self._awake = self._now()

    def lateness(self) -> tuple[float, float]:
        """Median and 99th percentile of the lateness of recent ticks, s."""
        median, high = np.quantile(self._late or [0.0], (0.5, 0.99)).tolist()
        return median, high

    def is_behind(self) -> bool:
        """Whether more than half of the ticks were late by more than a tick in each of the last two seconds. Returns True only
        once for these two seconds, so that a single pause of the machine is ignored.
        """
        if self._awake < self._judge_at:
            return False
        ticks, late = self._window
        behind = 2 * late > ticks
        twice = behind and self._was_behind
        self._was_behind = behind and not twice
        self._window, self._judge_at = [0, 0], self._awake + WINDOW
        return twice

    def wait(self, simulated: float) -> float | None:
        """Sleep until the tick is due, `simulated` s after the previous tick, and return the lateness in s.

        None: the longest sleep ended before the tick is due; call again.
        """
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
        late = self._awake - due
        self._late.append(late)
        self.ticks, self.worst = self.ticks + 1, max(self.worst, late)
        self._window[0] += 1
        self._window[1] += late > simulated / self.speed
        if late > SLIP:
            self.slips += 1
            self.slipped += late
            self._due = self._awake
        return late
