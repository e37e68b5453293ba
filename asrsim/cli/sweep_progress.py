"""A study's progress on the terminal: runs done, rate, remaining time, and what did not end well."""

from __future__ import annotations

from typing import TYPE_CHECKING

from asrsim.cli.bar import Bar

if TYPE_CHECKING:
    from asrsim.sweeps.run import Progress


class SweepProgress(Bar):
    """Shows nothing where nobody watches."""

    def __init__(self, title: str, *, show: bool) -> None:
        super().__init__(show=show)
        self._title = title

    def update(self, progress: Progress) -> None:
        """Rows have come."""
        if not self._show:
            return
        if self._bar is None:
            self._open(progress.total)
        from asrsim.sweeps.table import shares

        self._bar.update(self._task, completed=progress.done, rate=f"{progress.rate:.3g} runs/s", bad=shares(progress.statuses))

    def _open(self, total: int) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        self._bar = Progress(
            TextColumn("{task.description}", markup=False),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[rate]}"),
            TimeRemainingColumn(),
            TextColumn("left {task.fields[bad]}"),
            console=Console(stderr=True),
            transient=True,
        )
        self._task = self._bar.add_task(self._title, total=total, rate="", bad="")
        self._bar.start()
