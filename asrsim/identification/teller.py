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
    """Mean square residual of the best so far, in deviations of the noise."""
    evaluations: int
    elapsed: float
    """s."""
    remaining: float
    """s, of the present stage, by what the ones before took; nan: unknown."""


class Teller:
    """Between the search and who watches it."""

    def __init__(self, progress: Callable[[Progress], None] | None, stop: Callable[[], bool] | None) -> None:
        self._progress, self._stop = progress, stop
        self.began = self._told = clock.perf_counter()
        self._stage, self._stage_began, self._lengths = "start", self.began, [0.0]
        self.counter: Counter | None = None
        self.best: Best | None = None
        self.deaf = False
        """No more questions: what is there is judged."""

    def stage(self, name: str) -> None:
        """The search begins anew."""
        now = clock.perf_counter()
        self._lengths.append(now - self._stage_began)
        self._stage, self._stage_began = name, now

    def tick(self) -> None:
        """An evaluation is done; raises Stopped."""
        if self._stop is not None and not self.deaf and self._stop():
            raise Stopped
        now = clock.perf_counter()
        if self._progress is not None and self.counter is not None and self.best is not None and now - self._told > 0.2:
            self._told = now
            longest = max(self._lengths)
            left = longest - (now - self._stage_began) if len(self._lengths) > 2 else float("nan")
            self._progress(Progress(self._stage, self.best.cost, self.counter.evaluations, now - self.began, max(left, 0.0)))
