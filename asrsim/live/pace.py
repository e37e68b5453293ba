"""Real time: when the next tick is due, how late ticks come, and how much of their time is work."""

from __future__ import annotations

import math
import os
import time
from collections import deque
from collections.abc import Callable

import numpy as np

SLIP = 0.25
"""s behind at which a run stops catching up and goes on from now."""
NAP = 0.1
"""Longest sleep in s, so that commands are taken and a run can be stopped."""
RECENT = 10_000
"""Ticks whose lateness is kept."""


def take_priority() -> bool:
    """Take real-time priority for this thread and those that it starts, where the system grants it.

    The ordinary scheduler leaves two busy threads on one processor for up to 90 ms while the other has little to do. A process
    with another policy, or with a positive niceness, keeps that.
    """
    try:
        if os.sched_getscheduler(0) == os.SCHED_OTHER and os.nice(0) <= 0:
            os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
            return True
    except (AttributeError, OSError):  # not on this system, or not permitted
        pass
    return False


def leave_priority() -> None:
    """Take ordinary priority again."""
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


class Pace:
    """Ticks of a simulation against the wall clock."""

    def __init__(
        self, speed: float, *, now: Callable[[], float] = time.perf_counter, sleep: Callable[[float], None] = time.sleep
    ) -> None:
        """speed: simulated s a second; infinite: as fast as it goes."""
        self._now, self._sleep = now, sleep
        self._late: deque[float] = deque(maxlen=RECENT)
        self.ticks, self.worst = 0, 0.0
        self.slips, self.slipped = 0, 0.0
        """How often the run stopped catching up, and the s that it lost."""
        self.busy = 0.0
        """s of work."""
        self.speed = speed
        self.start()

    def start(self) -> None:
        """Time counts from now: at the beginning, after a pause."""
        self._due = self._awake = self._now()

    def lateness(self) -> tuple[float, float]:
        """Median and 99th percentile of the lateness of recent ticks, s."""
        median, high = np.quantile(self._late or [0.0], (0.5, 0.99)).tolist()
        return median, high

    def wait(self, simulated: float) -> float | None:
        """Sleep until `simulated` s after the last tick are due; returns the lateness in s.

        None: the tick is not due yet after a nap; call again.
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
        if late > SLIP:
            self.slips += 1
            self.slipped += late
            self._due = self._awake
        return late
