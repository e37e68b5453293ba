"""Progress of a long computation on stderr: a bar on a terminal, else a line from time to time."""

from __future__ import annotations

import math
import sys
import time as clock
from typing import TYPE_CHECKING, Any, Self

from asrsim.cli.console import complain, is_terminal
from asrsim.errors import counted, printable

if TYPE_CHECKING:
    from asrsim.identification import FitProgress
    from asrsim.progress import Progress
    from asrsim.sweeps.run import StudyProgress

PATIENCE = 0.4
"""Delay in s before a progress bar appears, since short work needs no progress bar, and need not import rich."""


EVERY = 10.0
"""Time between lines of progress in a pipe or a file, s."""


class Bar:
    """Progress bar as a context manager, which removes the bar on exit. The bar is printed on stderr, since stdout contains
    only results. A pipe or a file gets a line every `EVERY` seconds instead.
    """

    def __init__(self, title: str = "", *, show: bool) -> None:
        self._title = title
        self._show, self._lines = show, not is_terminal(sys.stderr)
        self._began = self._said = clock.perf_counter()
        self._bar: Any = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.stop()
            self._bar = None

    def draw(self, fraction: float | None, note: str = "", title: str | None = None) -> None:
        """Show the completed fraction of the work (None: unknown), a note, and another title if one is given."""
        if not self._show:
            return
        if self._lines:
            self._say(note, self._title if title is None else title)
            return
        if self._bar is None and clock.perf_counter() - self._began < PATIENCE:
            return
        if self._bar is None:
            from rich.console import Console
            from rich.progress import BarColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
            from rich.progress import Progress as Columns

            texts = [TextColumn("{task." + name + "}", markup=False) for name in ("description", "fields[note]")]
            time = TimeElapsedColumn() if fraction is None else TimeRemainingColumn()
            self._bar = Columns(texts[0], BarColumn(), texts[1], time, console=Console(stderr=True), transient=True)
            self._bar.add_task("", total=None if fraction is None else 1.0, note="")
            self._bar.start()
        (task,) = self._bar.task_ids
        self._bar.update(task, completed=fraction, note=note, description=self._title if title is None else title)

    def _say(self, note: str, title: str) -> None:
        now = clock.perf_counter()
        if now - self._said >= EVERY:
            self._said = now
            complain(printable(f"{title}: {note}" if title else note))


class FractionBar(Bar):
    """Progress bar of work in several tasks whose completed fraction is known."""

    def update(self, progress: Progress) -> None:
        """Show the completed fraction of the current task."""
        self.draw(progress.fraction, f"{100.0 * progress.fraction:3.0f} %", progress.task)


class RunBar(Bar):
    """Progress bar of a run: simulated time and speed."""

    def __init__(self, title: str, duration: float, *, show: bool) -> None:
        super().__init__(title, show=show)
        self._duration = duration
        self._part, self._first = "", 0.0
        """_part: current part of the work; _first: simulated time in s at the first report of this part."""

    def start(self, _info: object = None) -> None:
        """Begin to measure the simulation speed; called when the simulation loop begins."""
        self._began, self._first = clock.perf_counter(), 0.0

    def update(self, progress: Progress) -> None:
        """Show the simulated time of the run, or of a further run of the same scenario; such a run has a `task`."""
        if progress.task != self._part:
            self._part = progress.task
            self.start()
            # This part began before its first report, so measure its speed from the time of this report.
            self._first = progress.time
        simulated = progress.time
        note = f"{simulated:.2f} of {self._duration:g} s"
        if simulated > self._first:
            speed = (simulated - self._first) / max(clock.perf_counter() - self._began, 1e-9)
            note += f", {speed:.3g} x real time"
        # The duration may be 0, since the log of a killed run may contain no time.
        self.draw(
            simulated / self._duration if self._duration > 0.0 else 1.0,
            note,
            f"{self._title}, {self._part}" if self._part else None,
        )


class FitBar(Bar):
    """Progress bar of a fit: task, cost and evaluations."""

    def update(self, progress: FitProgress) -> None:
        """Show the current stage of the fit, its cost, its number of evaluations, and the remaining time."""
        cost = f"cost {progress.cost:.4g}, " if math.isfinite(progress.cost) else ""
        left = f", about {progress.remaining:.0f} s left" if math.isfinite(progress.remaining) else ""
        self.draw(None, f"{progress.task}: {cost}{counted(progress.evaluations, 'evaluation')}{left}")


class SweepBar(Bar):
    """Progress bar of a study: number of finished runs, their rate, and numbers of failed runs."""

    def update(self, progress: StudyProgress) -> None:
        """Show the number of finished runs, their rate, and the numbers of failed runs."""
        from asrsim.sweeps.table import shares

        runs = f"{progress.done}/{progress.total}, {progress.rate:.3g} runs/s"
        self.draw(progress.fraction, f"{runs} {shares(progress.statuses)}")
