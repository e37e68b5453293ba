"""A twin's estimates on a page: the measured robot with the external torques that were found on it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from asrsim.samples import Array, Samples
from asrsim.simulation.prepare import Prepared
from asrsim.twin import TwinStep
from asrsim.twin.follow import Followed
from asrsim.twin.live import LiveTwin
from asrsim.viewer.events import Event
from asrsim.viewer.history import History
from asrsim.viewer.live import live_subject
from asrsim.viewer.page import Page, plain
from asrsim.viewer.player import Player
from asrsim.viewer.subject import Subject

QUANTITIES = ("link_position", "external_torque", "stiffness")
"""Quantities of a twin that the page shows."""


def twin_subject(prepared: Prepared, samples: Samples | None = None) -> Subject:
    """The measured robot and its estimates."""
    joints = tuple(replace(joint, quantities=QUANTITIES, motors=0) for joint in prepared.info.joints)
    return replace(live_subject(prepared), joints=joints, history=History(joints, samples), path=None)


def followed_player(page: Page, prepared: Prepared, found: Followed) -> Player:
    """Playback of a recording with the torques that a twin found, and jumps to the alarms."""
    values = dict(zip(QUANTITIES, (found.positions, found.external_torque, found.stiffness), strict=True))
    samples = Samples(time=found.time, joints=found.joints, values=values)
    events = [
        Event(start, f"alarm at {joint}") for j, joint in enumerate(found.joints) for start, _ in found.alarms(j)
    ]  # fmt: skip
    return Player(page, twin_subject(prepared, samples), events=sorted(events))


class TwinView:
    """A twin beside a robot in real time."""

    def __init__(self, page: Page, twin: LiveTwin) -> None:
        self._page, self._twin, self._subject = page, twin, twin_subject(twin.prepared)
        self._rows: list[tuple[float, Array, Array, Array]] = []
        self._alarms = ""
        twin.watch = self._watch
        page.show(self._subject)
        page.finish()
        page.say("Waiting for positions.")

    def run(self, stop: Callable[[], bool]) -> None:
        """Follow the robot until `stop` returns True."""
        self._twin.run(stop=stop)

    def _watch(self, positions: Array, found: TwinStep) -> None:
        """Show a step; pictures are drawn at the page's rate."""
        self._rows.append((found.time, positions.copy(), found.external_torque, found.stiffness))
        names = [self._twin.prepared.drives[j].name for j in np.flatnonzero(found.alarm).tolist()]
        self._alarms = f" · alarm: {plain(', '.join(names))}" if names else ""
        if self._page.due():
            time, *columns = zip(*self._rows, strict=True)
            values = dict(zip(QUANTITIES, map(np.array, columns), strict=True))
            joints = tuple(drive.name for drive in self._twin.prepared.drives)
            self._subject.history.write(Samples(time=np.array(time), joints=joints, values=values))
            self._rows.clear()
            latest = self._subject.history.latest
            if latest is not None:
                self._page.draw(latest)
            self._page.say(f"**{found.time:.2f} s** followed{self._alarms}")
