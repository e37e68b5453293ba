"""A progress bar for work whose fraction is known; on stderr, and only where somebody watches."""

from __future__ import annotations

import time as clock

from asrsim.cli.bar import Bar

PATIENCE = 0.6
"""s before the bar is shown."""


class FractionProgress(Bar):
    """Used as a context; `update` is told what is being done and which fraction of it is."""

    def update(self, what: str, fraction: float) -> None:
        """`what` is done to `fraction`, 0 to 1."""
        if not self._show or clock.perf_counter() - self._began < PATIENCE:
            return
        if self._bar is None:
            from rich.console import Console
            from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

            self._bar = Progress(
                TextColumn("{task.description}", markup=False), BarColumn(), TextColumn("{task.percentage:3.0f} %"),
                TimeRemainingColumn(), console=Console(stderr=True), transient=True,
            )  # fmt: skip
            self._task = self._bar.add_task(what, total=1.0)
            self._bar.start()
        self._bar.update(self._task, description=what, completed=fraction)
