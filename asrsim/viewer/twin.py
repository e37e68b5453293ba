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
"""Quantities of a twin that the page shows."""


def twin_subject(prepared: Prepared, samples: Samples | None = None) -> Subject:
    """The measured robot and its estimates."""
    joints = tuple(replace(joint, quantities=QUANTITIES, motors=0) for joint in prepared.info.joints)
    return replace(live_subject(prepared), joints=joints, history=History(joints, samples), path=None)


def followed_player(page: Page, prepared: Prepared, found: Followed) -> Player:
    """Playback of a recording with the torques that a twin found, and jumps to the alarms."""
    values = dict(zip(QUANTITIES, (found.positions, found.external_torque, found.stiffness), strict=True))
    samples = Samples(time=found.time, joints=found.joints, values=values)
    events = [Event(start, f"alarm at {joint}") for j, joint in enumerate(found.joints) for start, _ in found.alarms(j)]
    return Player(page, twin_subject(prepared, samples), events=sorted(events))


class TwinPage:
    """Measured robot and external torques on a page, as a twin finds them."""

    def __init__(self, page: Page, prepared: Prepared) -> None:
        self._page, self._prepared, self._subject = page, prepared, twin_subject(prepared)
        self._rows: list[tuple[float, Array, Array, Array]] = []
        page.show(self._subject)
        page.finish()
        page.say("Waiting for positions.")

    def note(self, time: float, positions: Array, found: TwinStep) -> None:
        """Show a step at a time in s; pictures are drawn at the page's rate."""
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
    """A twin of a robot in real time."""

    def __init__(self, page: Page, twin: LiveTwin) -> None:
        super().__init__(page, twin.prepared)
        self._twin = twin
        twin.watch = lambda positions, found: self.note(found.time, positions, found)

    def run(self, stop: Stop) -> None:
        """Follow the robot until `stop` returns True."""
        self._twin.run(stop=stop)


class FollowView(TwinPage):
    """A twin that follows a recording: the torques are shown while they are computed, and then played back."""

    def __init__(self, page: Page, prepared: Prepared, work: Callable[..., Followed], done: Callable[[Followed], None]) -> None:
        """work: function that follows the recording, with the arguments `watch` and `stop` of `asrsim.twin.follow.follow`;
        done: called with the result before it is played back.
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
