"""Between a search and who watches it: progress told, the wish to stop heard."""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from dataclasses import dataclass

from asrsim.identification.fit import Best, Stopped
from asrsim.identification.residuals import Counter


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


class Teller:
    """Between the search and who watches it."""

    def __init__(
        self, progress: Callable[[Progress], None] | None, stop: Callable[[], bool] | None, seconds: float | None = None
    ) -> None:
        """seconds: after which the search ends."""
        self._progress, self._stop, self._seconds = progress, stop, seconds
        self.ended = INTERRUPTED
        """Why the search was stopped."""
        self.began = self._told = clock.perf_counter()
        self._stage, self._searching = "start", False
        self._stage_evaluations = 0
        self.counter: Counter | None = None
        self.best: Best | None = None
        self.deaf = False
        """No more questions: what is there is judged."""

    def stage(self, name: str, *, search: bool = False) -> None:
        """Something else begins; search: another start."""
        now = clock.perf_counter()
        if search or self._searching:
            self._stage_evaluations = self.counter.evaluations if self.counter is not None else 0
        if self.counter is not None:
            self.counter.cost = float("inf")
        self._stage, self._searching = name, search
        self._tell(now)

    def attempt(self, name: str) -> None:
        """Another start is searched from."""
        self.stage(name, search=True)

    def tick(self) -> None:
        """An evaluation is done; raises Stopped."""
        if self._stop is not None and not self.deaf and self._stop():
            raise Stopped
        now = clock.perf_counter()
        if self._seconds is not None and not self.deaf and now - self.began > self._seconds:
            self.ended = UNFINISHED
            raise Stopped
        if now - self._told > OFTEN:
            self._tell(now)

    def _tell(self, now: float) -> None:
        self._told = now
        if self._progress is None:
            return
        nobody_knows = float("nan")
        if self.counter is None or self.best is None:
            self._progress(Progress(self._stage, nobody_knows, 0, now - self.began, nobody_knows))
            return
        counter, left = self.counter, nobody_knows
        if counter.evaluations:
            # From the start that is searched, or from the end of the search.
            wanted = (AFTERWARDS + EVALUATIONS * self._searching) * (len(self.best.x) + 1)
            done = counter.evaluations - self._stage_evaluations
            left = max(wanted - done, 0) * (now - self.began) / counter.evaluations
            if self._seconds is not None:
                left = min(left, max(self._seconds - (now - self.began), 0.0))
        self._progress(Progress(self._stage, min(self.best.cost, counter.cost), counter.evaluations, now - self.began, left))
