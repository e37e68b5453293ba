"""A fit's progress on the terminal: what it does, cost, evaluations, time."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from asrsim.cli.bar import Bar

if TYPE_CHECKING:
    from asrsim.identification import Progress


class IdentifyProgress(Bar):
    """Shows nothing where nobody watches."""

    def __init__(self, title: str, *, show: bool) -> None:
        super().__init__(show=show)
        self._title = title

    def update(self, progress: Progress) -> None:
        """The search goes on."""
        if not self._show:
            return
        if self._bar is None:
            self._open()
        cost = f"cost {progress.cost:.4g}" if math.isfinite(progress.cost) else ""
        left = f"about {progress.remaining:.0f} s left of this start" if math.isfinite(progress.remaining) else ""
        self._bar.update(self._task, stage=progress.stage, cost=cost, count=f"{progress.evaluations} evaluations", left=left)

    def _open(self) -> None:
        from rich.console import Console
        from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

        self._bar = Progress(
            SpinnerColumn(), TextColumn("{task.description}: {task.fields[stage]}", markup=False),
            TextColumn("{task.fields[cost]}"), TextColumn("{task.fields[count]}"), TimeElapsedColumn(),
            TextColumn("{task.fields[left]}"), console=Console(stderr=True), transient=True,
        )  # fmt: skip
        self._task = self._bar.add_task(self._title, total=None, stage="", cost="", count="", left="")
        self._bar.start()
