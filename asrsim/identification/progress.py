"""Progress reports and interruption of a fit."""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Iterable
from dataclasses import dataclass

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
        self._progress, self.stop = progress, stop
        """Functions of the user; `stop` is None if requests to stop are ignored."""
        self._seconds = self.limit = math.inf if seconds is None else seconds
        """Time after which the next evaluation ends the computation, s; infinity if the time limit is ignored."""
        self.ended = INTERRUPTED
        """Status of a search that was stopped."""
        self.began = self._reported = clock.perf_counter()
        self._stage, self._before = "start", 0
        self.best: Best | None = None

    def stage(self, name: str) -> None:
        """Begin a stage, or a start of the search."""
        if self.best is not None:
            self.best.problem.meter.cost, self._before = math.inf, self.best.problem.meter.evaluations
        self._stage = name
        self._report()

    def tick(self) -> None:
        """Report progress after an evaluation. Raises Stopped if the user stops the fit or its time is over."""
        late = clock.perf_counter() - self.began > self.limit
        if late or (self.stop is not None and self.stop()):
            self.ended = UNFINISHED if late else INTERRUPTED
            raise Stopped
        if clock.perf_counter() - self._reported > OFTEN:
            self._report()

    def in_time(self, found: Callable[[], Iterable[str]]) -> list[str]:
        """Results of an optional computation; empty if the time limit is reached during the computation."""
        self.limit = self._seconds
        try:
            return list(found())
        except Stopped:
            if self.ended == INTERRUPTED:
                raise
            return []
        finally:
            self.limit = math.inf

    def _report(self) -> None:
        self._reported = clock.perf_counter()
        if self._progress is None:
            return
        elapsed, left, cost, done = self._reported - self.began, math.nan, math.nan, 0
        if self.best is not None:
            meter = self.best.problem.meter
            cost, done = min(self.best.cost, meter.cost), meter.evaluations
            wanted = self._before + (AFTERWARDS + SEARCH) * (len(self.best.x) + 1)
            left = min(max(wanted - done, 0) * elapsed / max(done, 1), max(self._seconds - elapsed, 0.0))
        self._progress(Progress(self._stage, cost, done, elapsed, left))
