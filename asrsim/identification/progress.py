"""Between a search and who watches it: progress told, the wish to stop heard."""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from asrsim.identification.search import Best, Stopped


@dataclass(frozen=True)
class Progress:
    """Where a fit is."""

    stage: str
    cost: float
    """Mean square residual of the best so far, or of this start, in deviations of the noise."""
    evaluations: int
    elapsed: float
    """s."""
    remaining: float
    """s to the end, if this start is the last, by what evaluations took and such fits need; nan: unknown."""


OFTEN = 0.2
"""s."""
EVALUATIONS, AFTERWARDS = 12, 40
"""Of a search, and of all that follows it, for each parameter."""
UNFINISHED, INTERRUPTED = "unfinished", "interrupted"
"""How a fit ended whose time is over, or that the user stopped."""


class Watch:
    """Between the search and who watches it."""

    def __init__(
        self, progress: Callable[[Progress], None] | None, stop: Callable[[], bool] | None, seconds: float | None = None
    ) -> None:
        """seconds: after which the search ends."""
        self._progress, self._stop, self._seconds = progress, stop, math.inf if seconds is None else seconds
        self.ended = INTERRUPTED
        """Why the search was stopped."""
        self.began = self._told = clock.perf_counter()
        self._stage, self._searching, self._before = "start", False, 0
        self.best: Best | None = None
        self.ignore_stop = False
        """What is there is judged."""

    def stage(self, name: str, *, search: bool = False) -> None:
        """Something else begins; search: another start."""
        if self.best is not None:
            meter = self.best.problem.meter
            meter.cost = math.inf
            if search or self._searching:
                self._before = meter.evaluations
        self._stage, self._searching = name, search
        self._tell()

    def tick(self) -> None:
        """An evaluation is done; raises Stopped."""
        late = clock.perf_counter() - self.began > self._seconds
        if not self.ignore_stop and (late or (self._stop is not None and self._stop())):
            self.ended = UNFINISHED if late else INTERRUPTED
            raise Stopped
        if clock.perf_counter() - self._told > OFTEN:
            self._tell()

    def unless_stopped(self, found: Callable[[], Iterable[Any]]) -> tuple[Any, ...]:
        """What takes long and can be done without; nothing where the user asks for the end."""
        self.ignore_stop = False
        try:
            return tuple(found())
        except Stopped:
            return ()
        finally:
            self.ignore_stop = True

    def _tell(self) -> None:
        self._told = clock.perf_counter()
        elapsed, left, cost, done = self._told - self.began, math.nan, math.nan, 0
        if self._progress is None:
            return
        if self.best is not None:
            meter = self.best.problem.meter
            cost, done = min(self.best.cost, meter.cost), meter.evaluations
            # From the start that is searched, or from the end of the search.
            wanted = (AFTERWARDS + EVALUATIONS * self._searching) * (len(self.best.x) + 1) + self._before
            if done:
                left = min(max(wanted - done, 0) * elapsed / done, max(self._seconds - elapsed, 0.0))
        self._progress(Progress(self._stage, cost, done, elapsed, left))
