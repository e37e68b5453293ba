"""The page: 3-D scene, moving plots, and controls that choose what is shown. It shows samples from any source."""

from __future__ import annotations

import html
import math
import time as clock
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from threading import RLock
from typing import Any

import numpy as np

from asrsim.samples import Samples
from asrsim.viewer.colours import SCALES, words_of
from asrsim.viewer.plots import Plots
from asrsim.viewer.server import PageServer
from asrsim.viewer.stage import SEEN, Pull, ViewerStage
from asrsim.viewer.subject import Companion, Subject

FRAME = 1.0 / 30.0
"""Time between two pictures of the 3-D scene, s."""
PLOT = 0.125
"""Time between two pictures of the plots, s."""
MANY = 3
"""Smallest number of ghosts at which all ghosts are hidden at first, and at which the first plots show one joint."""
PREPARING = (
    "The simulation is being prepared. After an installation, the first simulation is compiled, which may take half a minute."
)
NARROW = 700
"""Width of a window below which viser puts the controls below the robot, pixels."""
LIFT = 0.2
"""Distance by which the robot is moved above the middle of a narrow window, as a fraction of the window's height."""
LINE = 21
"""Height of a line of a text that is updated during a run, pixels."""
SAID = 3
"""Number of lines in the text field above the tabs."""
UP = (0.0, 0.0, 1.0)
"""Direction that is up on the page."""
OWN = "their own"
"""Name of the choice in which links have their original colours."""
BRAND = (0, 90, 140)
"""Colour of the page's controls."""


class Page:
    """Page that shows one subject, such as a run. `show` begins with a new subject; `draw` shows a sample of the subject."""

    def __init__(self, server: PageServer) -> None:
        self.server = server.viser
        self.lock = RLock()
        """Lock that is held while the page is drawn or gets another subject."""
        self.stage: ViewerStage
        self.plots: Plots
        self._drawn = self._plotted = -1.0
        """Wall-clock times of the last picture of the scene and of the last picture of the plots, s."""
        self.server.on_client_connect(self._make_room)
        self.server.gui.add_html(lines(0, PREPARING))
        self.server.gui.configure_theme(show_logo=False, show_share_button=False, brand_color=BRAND, control_width="medium")

    def _make_room(self, client: Any) -> None:
        """Move the robot up in a narrow window, where the controls stand below the robot."""
        start, camera = self.server.initial_camera, client.camera
        if camera.image_width >= NARROW:
            return
        way = np.subtract(start.look_at, start.position)
        above = np.cross(np.cross(way, UP), way)
        above *= LIFT * np.linalg.norm(way) * 2.0 * math.tan(0.5 * start.fov) / max(float(np.linalg.norm(above)), 1e-9)
        with client.atomic():
            camera.position, camera.look_at = start.position - above, start.look_at - above

    def show(self, subject: Subject, *, companions: Sequence[Companion] = ()) -> Any:
        """Clear the page and begin with a new subject. Returns the page's group of tabs, to which the caller may add tabs."""
        gui = self.server.gui
        with self.server.atomic():
            gui.reset()
            self.server.scene.reset()
            gui.set_panel_label(subject.title)
            self.stage = ViewerStage(self.server, subject)
            self._status = gui.add_html(lines(SAID, PREPARING))
            tabs = gui.add_tab_group()
            panel = gui.add_panel()
            panel.dock_left()
            self.plots = Plots(gui, subject, panel.add_tab("Plots"), together=len(companions) < MANY)
        self._companions: dict[str, Any] = {}
        self._notes = subject.notes
        self._tabs = tabs
        for companion in companions:
            self.add(companion if len(companions) < MANY else replace(companion, shown=False))
        return tabs

    def finish(self) -> None:
        """Add the tab in which the user chooses what is shown. This tab follows the tabs that the caller has added."""
        with self.server.atomic():
            self._add_look(self._tabs)

    def renew(self, subject: Subject) -> None:
        """Show another subject with the same robot, without building the page anew."""
        self.stage.subject = self.plots.subject = subject
        self._drawn = self._plotted = -1.0

    def add(self, companion: Companion) -> None:
        """Show a companion, a second motion, beside the subject."""
        self.stage.add(companion)
        self.plots.companions[companion.label] = companion

    def drop(self, label: str) -> None:
        """Remove the companion with this label."""
        self.stage.drop(label)
        self.plots.companions.pop(label, None)

    def say(self, text: str, *, last: bool = False) -> None:
        """Show a text, given as HTML, in the field above the tabs; an empty text hides the field. last: whether the text is the
        last one of a run: the field then becomes as high as the text.
        """
        shown = lines(0 if last else SAID, text)
        if shown != self._status.content:
            self._status.content = shown
            self._status.visible = bool(text)

    def due(self) -> bool:
        """Whether it is time for the next picture of the scene."""
        return clock.perf_counter() - self._drawn >= FRAME

    def draw(self, samples: Samples, *, pull: Pull | None = None, time: float | None = None) -> None:
        """Show the last sample in the scene, and plots that end at `time` in s; None: at the time of the last sample."""
        now = clock.perf_counter()
        self._drawn = now
        at = float(samples.time[-1]) if time is None else time
        with self.server.atomic():
            self.stage.draw(samples, pull=pull)
            if now - self._plotted >= PLOT:
                self._plotted = now
                self.plots.draw(at)
                self.stage.draw_trace(at)
                self._show_legend()

    # -- what is shown ----------------------------------------------------------------------------------------------

    def _add_look(self, tabs: Any) -> None:
        gui, look, stage = self.server.gui, self.stage.look, self.stage
        with tabs.add_tab("Show"):
            boxes = {
                "equilibrium": (
                    "Equilibrium (faint)",
                    "A faint robot at the positions where the springs would rest without load",
                ),
                "forces": ("Forces and torques", "Contact forces and external torques as arrows"),
                "trace": ("Trace of the tip", "Path of the tip in the last 5 s"),
                "collisions": ("Collision shapes", "Shows collision shapes instead of visuals"),
            }
            for name, (label, hint) in boxes.items():
                box = gui.add_checkbox(label, bool(getattr(look, name)), hint=hint)
                by_hand(box, partial(setattr, look, name))
                if name == "collisions":
                    by_hand(box, lambda shown: stage.figure.fade(SEEN if shown else None))
            names = [name for name in SCALES if name in self.plots.subject.quantities()]
            if names:
                colour = gui.add_dropdown("Colour of the links", (OWN, *map(words_of, names)), initial_value=OWN)
                known = dict(zip(map(words_of, names), names, strict=True))
                by_hand(colour, lambda word: setattr(look, "colour", known.get(word, "")))
            self._legend = gui.add_html("")
            self._ghosts = gui.add_folder("Ghosts")
            self.list_ghosts()
            if self._notes:
                gui.add_markdown("**Notes**\n" + "\n".join(f"- {plain(note)}" for note in self._notes))

    def list_ghosts(self) -> None:
        """List the ghosts, each with a box that shows or hides the ghost."""
        known = self.stage.ghosts
        for label in [label for label in self._companions if label not in known]:
            self._companions.pop(label).remove()
        for label, (_, figure) in known.items():
            if label not in self._companions:
                with self._ghosts:
                    box = self._companions[label] = self.server.gui.add_checkbox(label, figure.visible)
                by_hand(box, partial(self._set_visible, label))
        self._ghosts.visible = bool(known)

    def _set_visible(self, label: str, shown: bool) -> None:
        if label in self.stage.ghosts:
            self.stage.ghosts[label][1].visible = shown

    def _show_legend(self) -> None:
        if hasattr(self, "_legend") and self._legend.content != (text := self.stage.legend()):
            self._legend.content = text


def by_hand(control: Any, act: Callable[[Any], object]) -> None:
    """Let `act` be called with the control's value each time that a user changes the control, in the order of the changes."""

    async def changed(event: Any) -> None:
        if event.client_id is not None:
            act(event.target.value)

    control.on_update(changed)


def on_click(button: Any, act: Callable[[], object]) -> None:
    """Let `act` be called each time that a user presses the button."""

    async def clicked(event: Any) -> None:
        act()

    button.on_click(clicked)


def lines(number: int, content: str) -> str:
    """HTML of a text that changes while a user works with the page. Its field is always as high as `number` lines, so that the
    controls below the field do not move; 0: the field is as high as the text.
    """
    room = f"height: {number * LINE}px; overflow-y: auto; " if number else ""
    style = f"{room}padding: 0 12px; margin-bottom: 8px; font-size: 14px; line-height: {LINE}px; overflow-wrap: anywhere"
    return f'<div style="{style}">{content}</div>'


def line(content: str) -> str:
    """HTML of one line, which is cut off if it is too long."""
    return f'<div style="overflow: hidden; white-space: nowrap; text-overflow: ellipsis">{content}</div>'


def plain(text: str) -> str:
    """Foreign text, such as names in a robot's file, escaped so that it does not act as Markdown or HTML."""
    escaped = html.escape(text, quote=False)
    return "".join(f"\\{sign}" if sign in "\\`*_[]()#!|{}" else sign for sign in escaped)
