"""Playback of a log on a page, with a time line, a choice of speed, and jumps to events."""

from __future__ import annotations

import time as clock
from collections.abc import Sequence
from functools import partial
from html import escape
from typing import Any

from asrsim.progress import Stop
from asrsim.viewer.events import Event
from asrsim.viewer.page import FRAME, Page, by_hand, on_click
from asrsim.viewer.subject import Companion, Subject

STEP = 0.01
"""Resolution of the time line, s."""
LISTED = 40
"""Largest number of events that the page lists."""


class Player:
    """Plays the samples of a subject on a page."""

    def __init__(
        self,
        page: Page,
        subject: Subject,
        *,
        companions: Sequence[Companion] = (),
        events: Sequence[Event] = (),
        speed: float = 1.0,
    ) -> None:
        self._page, self.subject = page, subject
        self.start, self.end = subject.history.span
        self.time, self.playing, self.speed = self.start, True, speed
        tabs, gui = page.show(subject, companions=companions), page.server.gui
        with tabs.add_tab("Play"):
            length = max(self.end - self.start, 1e-3)
            step = min(STEP, length / 100.0)
            self._line: Any = gui.add_slider(
                "Time, s", min=self.start, max=self.start + length, step=step, initial_value=self.start
            )
            self._button = gui.add_button("Pause")
            back = gui.add_button("To the start")
            pace = gui.add_slider("Speed", min=0.05, max=4.0, step=0.05, initial_value=min(max(speed, 0.05), 4.0))
            if events:
                with gui.add_folder("Events"):
                    for event in events[:LISTED]:
                        jump = gui.add_button(f"{event.time:.2f} s {event.text}"[:60], hint=event.text)
                        on_click(jump, partial(self.jump, event.time))
                    if len(events) > LISTED:
                        gui.add_markdown(f"and {len(events) - LISTED} more")
        page.finish()
        by_hand(self._line, self.jump)
        by_hand(pace, lambda value: setattr(self, "speed", float(value)))
        on_click(self._button, self.toggle)
        on_click(back, lambda: self.jump(self.start))
        page.say(" ".join(f"{escape(text)}." for text in subject.notes[:1]))

    def jump(self, time: float) -> None:
        """Go to a time in s, and pause there."""
        self.time, self.playing = min(max(float(time), self.start), self.end), False

    def toggle(self) -> None:
        """Pause or continue the playback; at the end of the samples, start from the beginning."""
        self.playing = not self.playing
        if self.playing and self.time >= self.end:
            self.time = self.start

    def run(self, stop: Stop) -> None:
        """Play until `stop` returns True."""
        before = clock.perf_counter()
        while not stop():
            now = clock.perf_counter()
            if self.playing:
                self.time = min(self.time + self.speed * (now - before), self.end)
                self.playing = self.time < self.end
            before = now
            self.draw()
            clock.sleep(max(0.0, FRAME - (clock.perf_counter() - now)))

    def draw(self) -> None:
        """Show the robot, plots and time line at the present time of the playback."""
        label = "Pause" if self.playing else "Play"
        if self._button.label != label:
            self._button.label = label
        self._line.value = self.time
        sample = self.subject.history.at(self.time)
        if sample is not None:
            self._page.draw(sample, time=self.time)
