"""Progress bars on stderr, only on a terminal and for work that takes a while."""

from __future__ import annotations

import math
import sys
import time as clock
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from asrsim.cli.console import is_terminal, shown

if TYPE_CHECKING:
    from asrsim.identification import Progress as FitProgress
    from asrsim.sweeps.run import Progress as SweepProgress

PATIENCE = 0.4
"""Delay before a bar appears, s: short work needs neither a bar nor the import of rich."""


class Bar:
    """Context that removes its bar at the end. The bar goes to stderr, so that stdout contains only results."""

    def __init__(self, title: str = "", *, show: bool) -> None:
        self._title = shown(title)
        self._show = show and is_terminal(sys.stderr)
        self._began = clock.perf_counter()
        self._bar: Any = None
        self._task: Any = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if self._bar is not None:
            self._bar.stop()
            self._bar = None

    def _is_due(self) -> bool:
        """Whether stderr is a terminal and the delay is over."""
        return self._show and (self._bar is not None or clock.perf_counter() - self._began >= PATIENCE)

    def _open(self, *columns: Any, total: float | None, **fields: str) -> None:
        """Show the bar. columns: columns of rich, or texts with the task's fields; fields: their first values."""
        from rich.console import Console
        from rich.progress import Progress, TextColumn

        placed = [TextColumn(column, markup=False) if isinstance(column, str) else column for column in columns]
        self._bar = Progress(*placed, console=Console(stderr=True), transient=True)
        self._task = self._bar.add_task(self._title, total=total, **fields)
        self._bar.start()


class FractionBar(Bar):
    """Progress bar of work whose completed fraction is known."""

    def update(self, what: str, fraction: float) -> None:
        """Show that the task `what` is done to `fraction`, 0 to 1."""
        if not self._is_due():
            return
        if self._bar is None:
            from rich.progress import BarColumn, TimeRemainingColumn

            self._open("{task.description}", BarColumn(), "{task.percentage:3.0f} %", TimeRemainingColumn(), total=1.0)
        self._bar.update(self._task, description=what, completed=fraction)


class RunBar(Bar):
    """Progress bar of a run: simulated time, speed, remaining time."""

    def __init__(self, title: str, duration: float, *, show: bool) -> None:
        super().__init__(title, show=show)
        self._duration = duration
        self._part = ""

    def start(self, _info: object = None) -> None:
        """Start the bar when the simulation loop begins."""
        self._began = clock.perf_counter()

    def update(self, simulated: float) -> None:
        """Show that the run has reached `simulated` s."""
        if not self._is_due():
            return
        if self._bar is None:
            from rich.progress import BarColumn, TimeRemainingColumn

            self._open(
                "{task.description}", BarColumn(), "{task.completed:.2f} of {task.total:g} s", "{task.fields[speed]}",
                TimeRemainingColumn(), "left", total=self._duration, speed="",
            )  # fmt: skip
        speed = simulated / max(clock.perf_counter() - self._began, 1e-9)
        self._bar.update(self._task, completed=simulated, speed=f"{speed:.3g} x real time")

    def update_part(self, part: str, simulated: float) -> None:
        """Show that another run of the scenario, named `part`, has reached `simulated` s."""
        if part != self._part:
            self._part = part
            self.start()
            if self._bar is not None:
                self._bar.update(self._task, description=f"{self._title}, {part}")
        self.update(simulated)


class FitBar(Bar):
    """Progress bar of a fit: task, cost, evaluations, time."""

    def update(self, progress: FitProgress) -> None:
        """Show the progress of the search."""
        if not self._is_due():
            return
        if self._bar is None:
            from rich.progress import SpinnerColumn, TimeElapsedColumn

            self._open(
                SpinnerColumn(), "{task.description}: {task.fields[stage]}", "{task.fields[cost]}", "{task.fields[count]}",
                TimeElapsedColumn(), "{task.fields[left]}", total=None, stage="", cost="", count="", left="",
            )  # fmt: skip
        cost = f"cost {progress.cost:.4g}" if math.isfinite(progress.cost) else ""
        left = f"about {progress.remaining:.0f} s left" if math.isfinite(progress.remaining) else ""
        self._bar.update(self._task, stage=progress.stage, cost=cost, count=f"{progress.evaluations} evaluations", left=left)


class SweepBar(Bar):
    """Progress bar of a study: runs done, rate, remaining time, and number of failed runs."""

    def update(self, progress: SweepProgress) -> None:
        """Show the progress after new rows."""
        if not self._is_due():
            return
        if self._bar is None:
            from rich.progress import BarColumn, MofNCompleteColumn, TimeRemainingColumn

            self._open(
                "{task.description}", BarColumn(), MofNCompleteColumn(), "{task.fields[rate]}", TimeRemainingColumn(),
                "left {task.fields[bad]}", total=progress.total, rate="", bad="",
            )  # fmt: skip
        from asrsim.sweeps.table import shares

        self._bar.update(self._task, completed=progress.done, rate=f"{progress.rate:.3g} runs/s", bad=shares(progress.statuses))
