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
    """s, of the present stage, by what the ones before took, or such searches do; nan: unknown."""


OFTEN = 0.2
"""s."""
EVALUATIONS = 12
"""Of a search, for each parameter."""


class Teller:
    """Between the search and who watches it."""

    def __init__(self, progress: Callable[[Progress], None] | None, stop: Callable[[], bool] | None) -> None:
        self._progress, self._stop = progress, stop
        self.began = self._told = clock.perf_counter()
        self._stage, self._stage_began, self._searching = "start", self.began, False
        self._lengths: list[float] = []
        self.counter: Counter | None = None
        self.best: Best | None = None
        self.deaf = False
        """No more questions: what is there is judged."""

    def stage(self, name: str, *, search: bool = False) -> None:
        """Something else begins; search: another start."""
        now = clock.perf_counter()
        if self._searching:
            self._lengths.append(now - self._stage_began)
        if self.counter is not None:
            self.counter.cost = float("inf")
        self._stage, self._stage_began, self._searching = name, now, search
        self._tell(now)

    def attempt(self, name: str) -> None:
        """Another start is searched from."""
        self.stage(name, search=True)

    def tick(self) -> None:
        """An evaluation is done; raises Stopped."""
        if self._stop is not None and not self.deaf and self._stop():
            raise Stopped
        now = clock.perf_counter()
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
        if self._searching and counter.evaluations:
            usual = EVALUATIONS * (len(self.best.x) + 1) * (now - self.began) / counter.evaluations
            left = max(max(self._lengths, default=usual) - (now - self._stage_began), 0.0)
        self._progress(Progress(self._stage, min(self.best.cost, counter.cost), counter.evaluations, now - self.began, left))
