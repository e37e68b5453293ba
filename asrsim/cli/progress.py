"""A run's progress on the terminal: simulated time, speed, remaining time."""

from __future__ import annotations

import time as clock

from asrsim.cli.bar import Bar
from asrsim.cli.console import shown

PATIENCE = 0.4
"""s before a bar is shown: short runs end without one, and without the import."""


class RunProgress(Bar):
    """Progress of one run; shows nothing where nobody watches.

    Used as a context; `start` begins the clock, `update` is told the simulated time.
    """

    def __init__(self, title: str, duration: float, *, show: bool) -> None:
        super().__init__(show=show)
        self._title = shown(title)
        self._duration = duration
        self._part = ""

    def start(self, _info: object = None) -> None:
        """The run is built; its loop begins."""
        self._began = clock.perf_counter()

    def update(self, simulated: float) -> None:
        """The run has reached `simulated` s."""
        if not self._show:
            return
        elapsed = clock.perf_counter() - self._began
        if self._bar is None:
            if elapsed < PATIENCE:
                return
            self._open()
        speed = simulated / elapsed if elapsed > 0 else 0.0
        self._bar.update(self._task, completed=simulated, speed=f"{speed:.3g} x real time")

    def update_part(self, part: str, simulated: float) -> None:
        """Another run of the same scenario, named `part`, has reached `simulated` s."""
        if part != self._part:
            self._part = part
            self.start()
            if self._bar is not None:
                self._bar.update(self._task, description=f"{self._title}, {part}")
        self.update(simulated)

    def _open(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

        self._bar = Progress(
            TextColumn("{task.description}", markup=False),
            BarColumn(),
            TextColumn("{task.completed:.2f} of {task.total:g} s"),
            TextColumn("{task.fields[speed]}"),
            TimeRemainingColumn(),
            TextColumn("left"),
            console=Console(stderr=True),
            transient=True,
        )
        self._task = self._bar.add_task(self._title, total=self._duration, speed="")
        self._bar.start()
