"""Progress of a fit, and the wish to stop it."""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from asrsim.identification.search import Best, Stopped


@dataclass(frozen=True)
class Progress:
    """The state of a fit."""

    stage: str
    cost: float
    """Mean square residual of the best so far, or of this start, in deviations of the noise."""
    evaluations: int
    elapsed: float
    """s."""
    remaining: float
    """s to the end, if this start is the last; nan: unknown."""


OFTEN = 0.2
"""s."""
SEARCH, AFTERWARDS = 12, 40
"""Evaluations for each parameter: of a search, and of everything after it."""
UNFINISHED, INTERRUPTED = "unfinished", "interrupted"
"""How a fit ended whose time was over, or that the user stopped."""


class Watch:
    """Calls the user's functions between evaluations, and ends the search on time."""

    def __init__(
        self, progress: Callable[[Progress], None] | None, stop: Callable[[], bool] | None, seconds: float | None = None
    ) -> None:
        """seconds: after which the search ends."""
        self._progress, self._stop, self._seconds = progress, stop, math.inf if seconds is None else seconds
        self.ended = INTERRUPTED
        """Why the search was stopped."""
        self.began = self._reported = clock.perf_counter()
        self._stage, self._before = "start", 0
        self.best: Best | None = None
        self.ignore_stop = False
        """The fit is being judged."""

    def stage(self, name: str) -> None:
        """Another stage, or another start of the search, begins."""
        if self.best is not None:
            self.best.problem.meter.cost, self._before = math.inf, self.best.problem.meter.evaluations
        self._stage = name
        self._report()

    def tick(self) -> None:
        """An evaluation is done; raises Stopped."""
        late = clock.perf_counter() - self.began > self._seconds
        if not self.ignore_stop and (late or (self._stop is not None and self._stop())):
            self.ended = UNFINISHED if late else INTERRUPTED
            raise Stopped
        if clock.perf_counter() - self._reported > OFTEN:
            self._report()

    def unless_stopped(self, found: Callable[[], Iterable[Any]]) -> tuple[Any, ...]:
        """Results that can be done without: none where the user asks for the end."""
        self.ignore_stop = False
        try:
            return tuple(found())
        except Stopped:
            return ()
        finally:
            self.ignore_stop = True

    def _report(self) -> None:
        self._reported = clock.perf_counter()
        elapsed, left, cost, done = self._reported - self.began, math.nan, math.nan, 0
        if self._progress is None:
            return
        if self.best is not None:
            meter = self.best.problem.meter
            cost, done = min(self.best.cost, meter.cost), meter.evaluations
            wanted = self._before + (AFTERWARDS + SEARCH) * (len(self.best.x) + 1)
            if done:
                left = min(max(wanted - done, 0) * elapsed / done, max(self._seconds - elapsed, 0.0))
        self._progress(Progress(self._stage, cost, done, elapsed, left))
