"""Progress reports and interruption of a fit."""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from asrsim.identification.search import Best, Stopped


@dataclass(frozen=True)
class Progress:
    """Progress of a running fit."""

    stage: str
    cost: float
    """Smallest mean square residual so far, relative to the noise."""
    evaluations: int
    elapsed: float
    """Time since the start of the fit, s."""
    remaining: float
    """Estimated remaining time if the search tries no further start, s; nan: unknown."""


OFTEN = 0.2
"""Time between progress reports, s."""
SEARCH, AFTERWARDS = 12, 40
"""Estimated number of evaluations per parameter in a search, and in all later stages together."""
UNFINISHED, INTERRUPTED = "unfinished", "interrupted"
"""Status of a fit that reached its time limit, or that the user stopped."""


class Watch:
    """Observer that calls the user's functions between evaluations, and ends the search at its time limit."""

    def __init__(
        self, progress: Callable[[Progress], None] | None, stop: Callable[[], bool] | None, seconds: float | None = None
    ) -> None:
        """seconds: time limit of the search."""
        self._progress, self._stop, self._seconds = progress, stop, math.inf if seconds is None else seconds
        self.ended = INTERRUPTED
        """Status of a search that was stopped."""
        self.began = self._reported = clock.perf_counter()
        self._stage, self._before = "start", 0
        self.best: Best | None = None
        self.ignore_stop = self.ignore_time = False
        """Whether requests to stop, or the time limit, are ignored."""

    def stage(self, name: str) -> None:
        """Begin a stage, or a start of the search."""
        if self.best is not None:
            self.best.problem.meter.cost, self._before = math.inf, self.best.problem.meter.evaluations
        self._stage = name
        self._report()

    def tick(self) -> None:
        """Report progress after an evaluation. Raises Stopped if the user stops the fit or its time is over."""
        late = not self.ignore_time and clock.perf_counter() - self.began > self._seconds
        if not self.ignore_stop and (late or (self._stop is not None and self._stop())):
            self.ended = UNFINISHED if late else INTERRUPTED
            raise Stopped
        if clock.perf_counter() - self._reported > OFTEN:
            self._report()

    def in_time(self, found: Callable[[], Iterable[Any]]) -> tuple[Any, ...]:
        """Results of an optional computation; empty if the time limit is reached during the computation."""
        self.ignore_time = False
        try:
            return tuple(found())
        except Stopped:
            if self.ended == INTERRUPTED:
                raise
            return ()
        finally:
            self.ignore_time = True

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
