"""Live runs on a page, one run after the other until the user ends the program. Each run writes a log that `rerun` repeats."""

from __future__ import annotations

import itertools
import time as clock
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.errors import AsrsimError
from asrsim.live.session import Session, Settings
from asrsim.live.transport import TellUser
from asrsim.progress import Stop
from asrsim.render.scene import RenderScene
from asrsim.render.shapes import drawable
from asrsim.samples import Array
from asrsim.simulation.examine import Plan
from asrsim.simulation.prepared import Prepared
from asrsim.simulation.run import simulate
from asrsim.simulation.start import Numbers
from asrsim.summary import RunSummary
from asrsim.viewer.desk import Desk
from asrsim.viewer.history import History
from asrsim.viewer.page import FRAME, Page
from asrsim.viewer.painter import Painter
from asrsim.viewer.subject import Companion, Subject, as_companion
from asrsim.viewer.tuning import differences, tunable, tuned

BEFORE = "the run before"
"""Label of the ghost that shows the run before the last reset."""
TICK = 4e-3
"""Wall-clock time between two ticks of a run without topics, s. Shorter ticks would not help a user, whose hand moves more
slowly, and would delay the run, since each tick may have to wait until a thread that draws or sends releases Python's lock.
"""
WAIT = 0.05
"""Time between two checks of whether the user wants another run, after a run has ended, s."""


@dataclass(frozen=True, kw_only=True)
class WantedRun:
    """Run that the user wants next: its variant, tuned numbers and speed, whether it starts paused, and a message to show."""

    variant: str
    tuned: Numbers
    speed: float
    paused: bool = False
    news: str = ""


class LiveView:
    """Live runs of a scenario's variants on a page."""

    def __init__(
        self,
        page: Page,
        plans: Sequence[Plan],
        *,
        variant: str | None = None,
        out: Path | None = None,
        overwrite: bool = False,
        settings: Settings | None = None,
        companions: Sequence[Companion] = (),
        tell: TellUser = lambda text: None,
    ) -> None:
        """plans: a plan for each variant; variant: variant of the first run; out: folder of the log, with a subfolder for each
        variant if there are several variants; settings: settings of the live runs; companions: ghosts; tell: function that
        receives messages for the user.
        """
        self._page, self._plans, self._tell = page, {plan.scenario.variant: plan for plan in plans}, tell
        self._settings = replace(settings or Settings(), batch=FRAME)
        if not self._settings.transports:
            self._settings = replace(self._settings, tick=TICK)
        self._out, self._overwrite, self._companions = out, overwrite, list(companions)
        first = variant or plans[0].scenario.variant
        self._wish = WantedRun(variant=first, tuned={}, speed=self._settings.speed)
        self.session: Session | None = None
        """The present run."""
        self._present: Desk | None = None
        """Desk of the present run."""
        self._episodes = 0
        """Number of runs so far."""
        self._numbers: Numbers = {}
        """Values in the latest run of the numbers that the user can tune."""

    def run(self, stop: Stop) -> RunSummary | None:
        """Execute runs until `stop` returns True; returns the summary of the last run. Raises an error that prevents the first
        run. An error that prevents a later run is shown on the page, and the previous run starts again.
        """
        with Painter(self._draw, self._page.lock) as painter:
            summary = self._runs(lambda: stop() or painter.error is not None)
        if painter.error is not None:
            raise painter.error
        return summary

    def _draw(self) -> None:
        """Show the present run."""
        if self._present is not None:
            self._present.show()

    def _runs(self, stop: Stop) -> RunSummary | None:
        summary: RunSummary | None = None
        desk: Desk | None = None
        last = self._wish
        # Do not call `stop` before the first run is built. Until the first call, Ctrl-C ends even a compilation at once.
        while desk is None or not stop():
            try:
                session = self._session(self._wish)
            except AsrsimError as error:
                if desk is None:
                    raise
                self._wish = replace(last, news=f"Not changed: {error}")
                continue
            session.paused = self._wish.paused
            with self._page.lock:
                same = desk is not None and last.variant == self._wish.variant
                desk = self._present = self._desk(session, desk, same=same)
            session.operator, self.session, last = desk, session, self._wish
            summary = session.run(stop=partial(_ends, desk, stop))
            if desk.wish is None and summary.status != "diverged":
                break
            if desk.wish is None and not stop():
                self._wait(desk, summary, stop)
            self._wish = self._next(session, desk)
        return summary

    def _session(self, wish: WantedRun) -> Session:
        plan = tuned(self._plans[wish.variant], wish.tuned)
        scenario = plan.scenario
        folder = Path("out") / scenario.name / f"{scenario.variant}_view"
        if self._out is not None:
            folder = self._out / scenario.variant if len(self._plans) > 1 else self._out
        # The first run may replace results in a folder that the user names. All other runs write to new folders, so that no
        # results are lost.
        if self._out is None or self._episodes:
            folder = next(path for path in _numbered(folder) if not path.exists())
        self._episodes += 1
        if self._episodes > 1:
            self._tell(f"run {self._episodes} is written to {folder}")
        settings = replace(self._settings, speed=wish.speed)
        return Session(plan, folder, settings, overwrite=self._overwrite, tell=self._tell)

    def _desk(self, session: Session, desk: Desk | None, *, same: bool) -> Desk:
        """Desk for a run. The desk of the previous run is kept, except for a run of another variant. same: whether the previous
        run had the same variant.
        """
        prepared, before = session.simulation.prepared, desk.subject if desk is not None else None
        changes = differences(self._numbers, tunable(prepared)) if same else []
        self._numbers = tunable(prepared)
        if desk is None or before is None or not same:
            return Desk(
                self._page,
                session,
                live_subject(prepared),
                variants=tuple(self._plans),
                companions=self._companions,
                simulate=self._ghost_of,
            )
        subject = replace(before, history=History(prepared.info.joints))
        if before.history.latest is not None:
            self._page.add(as_companion(before, BEFORE, shown=bool(changes)))
            self._page.list_ghosts()
        news = "; ".join(filter(None, (self._wish.news, *changes)))
        desk.begin(session, subject, tuned=self._wish.tuned, news=news)
        return desk

    def _ghost_of(self, variant: str) -> Companion:
        """Ghost with the motion of a variant as its scenario states it, without the user's changes on the page."""
        run = simulate(self._plans[variant])
        assert run.samples is not None
        robot, _ = drawable(run.robot, run.scenario.package_paths)
        subject = Subject(
            title=variant,
            joints=run.info.joints,
            scene=RenderScene(robot, run.scenario),
            history=History(run.info.joints, run.samples),
        )
        return as_companion(subject, variant)

    def _wait(self, desk: Desk, summary: RunSummary, stop: Stop) -> None:
        """Show why the run has ended, and wait until the user wants another run or `stop` returns True."""
        desk.ended(summary)
        while desk.wish is None and not stop():
            clock.sleep(WAIT)

    def _next(self, session: Session, desk: Desk) -> WantedRun:
        wish: Mapping[str, Any] = desk.wish or {}
        variant = str(wish.get("variant", self._wish.variant))
        # Discard the tuned numbers if the variant changes, since another variant may have other parameters.
        tuned = wish.get("tuned", self._wish.tuned) if variant == self._wish.variant else {}
        return WantedRun(variant=variant, tuned=tuned, speed=session.pace.speed, paused=session.paused)


def _numbered(folder: Path) -> Iterator[Path]:
    """Path of the folder, followed by paths beside it whose names end with 2, 3, ..."""
    yield folder
    yield from (folder.with_name(f"{folder.name}_{number}") for number in itertools.count(2))


def _ends(desk: Desk, stop: Stop) -> bool:
    return stop() or desk.wish is not None


def live_subject(prepared: Prepared) -> Subject:
    """Subject with the robot and world of a scenario; it has no samples yet."""
    scenario, info = prepared.scenario, prepared.info
    robot, notes = drawable(prepared.robot, scenario.package_paths)
    scene = RenderScene(robot, scenario)
    title = f"{scenario.name} / {scenario.variant}"
    return Subject(
        title=title,
        joints=info.joints,
        scene=scene,
        history=History(info.joints),
        notes=(*notes, *scene.notes),
        path=_task_path(prepared),
    )


def _task_path(prepared: Prepared) -> Array | None:
    """Desired path (n, 3) of a Cartesian task, m; None without a task."""
    if prepared.scenario.task is None:
        return None
    from asrsim.kinematics.tip import TipPoses

    return TipPoses(prepared.scenario, prepared.robot).goals(np.linspace(0.0, prepared.scenario.duration, 300))
