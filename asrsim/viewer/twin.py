"""Page with the estimates of a twin: the measured robot, and the external torques that act on it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from html import escape

import numpy as np

from asrsim.progress import Stop
from asrsim.samples import Array, Samples
from asrsim.simulation.prepared import Prepared
from asrsim.twin import TwinStep
from asrsim.twin.follow import Followed
from asrsim.twin.live import LiveTwin
from asrsim.viewer.events import Event
from asrsim.viewer.history import History
from asrsim.viewer.live import live_subject
from asrsim.viewer.page import Page
from asrsim.viewer.player import Player
from asrsim.viewer.subject import Subject

QUANTITIES = ("link_position", "external_torque", "stiffness")
"""Quantities that the page shows: the measured positions, and estimates of the twin."""


def twin_subject(prepared: Prepared, samples: Samples | None = None) -> Subject:
    """Subject of a page about a twin: the measured robot, with the twin's estimates as quantities of its joints."""
    joints = tuple(replace(joint, quantities=QUANTITIES, motors=0) for joint in prepared.info.joints)
    return replace(live_subject(prepared), joints=joints, history=History(joints, samples), path=None)


def followed_player(page: Page, prepared: Prepared, found: Followed) -> Player:
    """Playback of a recording with the external torques that a twin found in it, and with jumps to the twin's alarms."""
    values = dict(zip(QUANTITIES, (found.positions, found.external_torque, found.stiffness), strict=True))
    samples = Samples(time=found.time, joints=found.joints, values=values)
    events = [Event(start, f"alarm at {joint}") for j, joint in enumerate(found.joints) for start, _ in found.alarms(j)]
    return Player(page, twin_subject(prepared, samples), events=sorted(events))


class TwinPage:
    """Page with the measured robot and the external torques, which is updated while a twin estimates the torques."""

    def __init__(self, page: Page, prepared: Prepared) -> None:
        self._page, self._prepared, self._subject = page, prepared, twin_subject(prepared)
        self._rows: list[tuple[float, Array, Array, Array]] = []
        page.show(self._subject)
        page.finish()
        page.say("Waiting for positions.")

    def note(self, time: float, positions: Array, found: TwinStep) -> None:
        """Add a step of the twin at a time in s, with measured positions (n,). Draws a picture if it is time for the next
        picture."""
        self._rows.append((time, positions.copy(), found.external_torque, found.stiffness))
        if not self._page.due():
            return
        names = [self._prepared.drives[j].name for j in np.flatnonzero(found.alarm).tolist()]
        times, *columns = zip(*self._rows, strict=True)
        values = dict(zip(QUANTITIES, map(np.array, columns), strict=True))
        joints = tuple(drive.name for drive in self._prepared.drives)
        self._subject.history.write(Samples(time=np.array(times), joints=joints, values=values))
        self._rows.clear()
        latest = self._subject.history.latest
        if latest is not None:
            self._page.draw(latest)
        alarms = f" · alarm: {escape(', '.join(names))}" if names else ""
        self._page.say(f"<b>{time:.2f} s</b> followed{alarms}")


class TwinView(TwinPage):
    """Page with a twin that follows a robot in real time."""

    def __init__(self, page: Page, twin: LiveTwin) -> None:
        super().__init__(page, twin.prepared)
        self._twin = twin
        twin.watch = lambda positions, found: self.note(found.time, positions, found)

    def run(self, stop: Stop) -> None:
        """Follow the robot until `stop` returns True."""
        self._twin.run(stop=stop)


class FollowView(TwinPage):
    """Page with a twin that follows a recording. Torques are shown while they are computed, and are then played back."""

    def __init__(self, page: Page, prepared: Prepared, work: Callable[..., Followed], done: Callable[[Followed], None]) -> None:
        """work: function that follows the recording; the function gets the arguments `watch` and `stop` of
        `asrsim.twin.follow.follow_recording`. done: function that is called with the result, before the result is played back.
        """
        super().__init__(page, prepared)
        self._work, self._done = work, done

    def run(self, stop: Stop) -> Followed:
        """Follow the recording, then play the result until `stop` returns True."""
        found = self._work(watch=self.note, stop=stop)
        self._done(found)
        if not found.interrupted:
            followed_player(self._page, self._prepared, found).run(stop)
        return found
