"""Desk of a live run. On a page, a person pauses, steps and resets the run, sets references, pulls links, and tunes
parameters."""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from html import escape
from queue import SimpleQueue
from threading import Thread
from typing import Any

import numpy as np

from asrsim.errors import AsrsimError
from asrsim.live.commands import Target
from asrsim.live.session import Session
from asrsim.plots.style import unit
from asrsim.samples import Array, HeldWrench, Samples
from asrsim.simulation.drives import EXTERNAL_TORQUE
from asrsim.simulation.start import Numbers
from asrsim.summary import RunSummary
from asrsim.viewer.colours import words_of
from asrsim.viewer.figure import frames_of
from asrsim.viewer.page import Page, by_hand, line, lines, on_click
from asrsim.viewer.pull import LIMIT, SPRING, Grip, torques_by_joint
from asrsim.viewer.stage import Pull
from asrsim.viewer.subject import Companion, Subject
from asrsim.viewer.tuning import tunable, unit_of_number

LONGEST = 0.05
"""Longest wall-clock time for which a slow run may leave the page without new samples, s."""
SAID = 0.25
"""Wall-clock time between two updates of the page's texts, s."""
NOBODY = "no variant"
WIDE = 10.0
"""Largest magnitude on the slider of a reference without limits, in the reference's unit."""


class Desk:
    """Controls of a live run on a page. The desk is the operator of the run's `asrsim.live.session.Session`."""

    def __init__(
        self,
        page: Page,
        session: Session,
        subject: Subject,
        *,
        variants: Sequence[str] = (),
        companions: Sequence[Companion] = (),
        simulate: Callable[[str], Companion] | None = None,
    ) -> None:
        """variants: names of the scenario's variants; companions: ghosts of other runs and recordings; simulate: function that
        returns the ghost of a variant, called in a separate thread.
        """
        self._simulate = simulate
        self._arrived = SimpleQueue[Companion | str]()
        """Ghosts that were computed and are not yet shown, or the reasons why ghosts could not be computed."""
        self._page = page
        self._sliders: dict[Target, Any] = {}
        self._present: dict[str, Any] = {}
        """Elements of the page that show the present references of a joint, by joint."""
        self._show_number: Callable[[], None] = lambda: None
        """Function that shows the present value of the parameter that the user has selected for tuning."""
        self._floats = not session.simulation.scenario.fixed_base
        self._begin(session, subject)
        tabs = page.show(subject, companions=companions)
        self._add_run(tabs, variants)
        self._add_joints(tabs)
        self._add_tuning(tabs)
        page.finish()
        page.stage.on_drag(self._drag)

    def _begin(self, session: Session, subject: Subject) -> None:
        self.session, self.subject = session, subject
        self.tuned: Numbers = {}
        """Numbers that the user has changed, by joint and name."""
        self.wish: Mapping[str, Any] | None = None
        """Variant and tuned numbers of the next run, after the user has asked for a next run; None: the present run
        continues."""
        self._news = ""
        self._by_hand: dict[Target, float | None] = {}
        """Values of the references that the user has set; None: the reference follows the scenario's signal again."""
        self._pushed: set[str] = set()
        """Joints on which a pull of the user causes an external torque."""
        self._held: str | None = None
        """Body on which a pull of the user causes a wrench; None without such a pull."""
        self._grip: Grip | None = None
        self._pull: Pull | None = None
        self._said = -1.0
        self._end = ""
        """HTML with the reason why the run has ended; empty while the run continues."""
        self._written = clock.perf_counter()
        """Wall-clock time of the last samples, s."""

    def begin(self, session: Session, subject: Subject, *, tuned: Numbers, news: str) -> None:
        """Control another run of the same variant. tuned: numbers that the user has changed; news: message for the user."""
        self._begin(session, subject)
        self.tuned, self._news = tuned, news
        self._page.renew(subject)
        for target, slider in self._sliders.items():
            slider.value = min(max(self._reference(target), slider.min), slider.max)
        self._pause.label = "Go on" if session.paused else "Pause"
        self._show_number()

    # -- controls ---------------------------------------------------------------------------------------------------

    def _add_run(self, tabs: Any, variants: Sequence[str]) -> None:
        gui = self._page.server.gui
        with tabs.add_tab("Run"):
            self._pause = gui.add_button("Go on" if self.session.paused else "Pause")
            step, reset = gui.add_button("Step", hint="One step of the simulation, while it is paused"), gui.add_button("Reset")
            speed = gui.add_slider(
                "Speed", min=0.05, max=4.0, step=0.05, initial_value=min(max(self.session.pace.speed, 0.05), 4.0)
            )
            if len(variants) > 1:
                name = self.session.simulation.scenario.variant
                variant = gui.add_dropdown("Variant", tuple(variants), initial_value=name)
                by_hand(variant, lambda chosen: self._ask_for(variant=chosen))
                if self._simulate is not None:
                    ghost = gui.add_dropdown(
                        "Ghost of",
                        (NOBODY, *variants),
                        hint="Shows a variant as the scenario states it, without changes by hand",
                    )
                    by_hand(ghost, self._add_ghost)
            with gui.add_folder("Pull", expand_by_default=True):
                self._spring = gui.add_number("Stiffness, N/m", SPRING, min=0.0, step=1.0)
                self._limit = gui.add_number("Largest force, N", LIMIT, min=0.0, step=1.0)
                gui.add_markdown("Drag a link or an object; let go to release it.")
        on_click(self._pause, self._toggle)
        on_click(step, self._step)
        on_click(reset, self._ask_for)
        by_hand(speed, lambda value: self.session.set_speed(float(value)))

    def _add_joints(self, tabs: Any) -> None:
        gui, prepared = self._page.server.gui, self.session.simulation.prepared
        infos = {joint.name: joint for joint in prepared.info.joints}
        with tabs.add_tab("Joints"):
            release = gui.add_button(
                "Follow the scenario", hint="References set by hand are removed; the signals of the scenario act again"
            )
            for drive in prepared.drives:
                with gui.add_folder(drive.name, expand_by_default=len(prepared.drives) < 4):
                    for slot, name in enumerate(drive.acting_references):
                        low, high = self.session.publisher.ranges[drive.name][name]
                        label = f"{words_of(name)}, {unit(f'reference_{slot + 1}', infos[drive.name])}"
                        self._add_slider((drive.name, name), label, low, high)
                    most = drive.joint.most_effort
                    label = f"external torque, {unit(EXTERNAL_TORQUE, infos[drive.name])}"
                    self._add_slider((drive.name, EXTERNAL_TORQUE), label, -most, most)
                    if drive.acting_references:
                        self._present[drive.name] = gui.add_html(lines(len(drive.acting_references), ""))
        on_click(release, self._release)

    def _add_slider(self, target: Target, label: str, low: float, high: float) -> None:
        low, high = max(low, -WIDE) if math.isinf(low) else low, min(high, WIDE) if math.isinf(high) else high
        if not low < high:
            return
        step = 10.0 ** math.floor(math.log10((high - low) / 200.0))
        slider = self._page.server.gui.add_slider(
            label, min=low, max=high, step=step, initial_value=min(max(self._reference(target), low), high)
        )
        self._sliders[target] = slider
        by_hand(slider, partial(self._set, target))

    def _reference(self, target: Target) -> float:
        """Present value of a reference; 0 if the target is an external torque."""
        if target[1] == EXTERNAL_TORQUE:
            return 0.0
        joint, slot = self.session.simulation.prepared.slot_of(*target)
        value = float(self.session.simulation.read([column := f"reference_{slot}"])[column][joint])
        return value if math.isfinite(value) else 0.0

    def _add_tuning(self, tabs: Any) -> None:
        gui, prepared = self._page.server.gui, self.session.simulation.prepared
        numbers = tunable(prepared)
        if not numbers:
            return
        with tabs.add_tab("Tune"):
            joint = gui.add_dropdown("Joint", tuple(numbers))
            first = next(iter(numbers))
            name = gui.add_dropdown("Parameter", tuple(numbers[first]))
            value: Any = gui.add_number("Value", next(iter(numbers[first].values())), step=None)
            now = gui.add_markdown("")
            apply = gui.add_button("Apply and start again", hint="The previous run stays as a ghost and as dashed curves")

        def show(_: Any = None) -> None:
            own = tunable(self.session.simulation.prepared)[str(joint.value)]
            if tuple(name.options) != tuple(own):
                name.options = tuple(own)
            value.value = own[str(name.value)]
            of = unit_of_number(prepared, str(joint.value), str(name.value))
            now.content = f"Now {value.value:g} {of}"

        def change() -> None:
            own = dict(self.tuned.get(str(joint.value), {}))
            own[str(name.value)] = float(value.value)
            self._ask_for(tuned={**self.tuned, str(joint.value): own})

        show()
        self._show_number = show
        by_hand(joint, show)
        by_hand(name, show)
        on_click(apply, change)

    # -- actions of the user -----------------------------------------------------------------------------------------

    def _set(self, target: Target, value: Any) -> None:
        self._by_hand[target] = float(value)

    def _toggle(self) -> None:
        self.session.paused = not self.session.paused
        self._pause.label = "Go on" if self.session.paused else "Pause"

    def _step(self) -> None:
        if not self.session.paused:
            self._toggle()
        self.session.single_step()

    def _add_ghost(self, variant: Any) -> None:
        """Simulate a variant in a separate thread."""

        def work() -> None:
            try:
                assert self._simulate is not None
                self._arrived.put(self._simulate(str(variant)))
            except AsrsimError as error:
                self._arrived.put(f"{variant}: {error}")

        if variant != NOBODY:
            Thread(target=work, daemon=True).start()

    def _welcome(self) -> None:
        """Show the ghosts that were computed since the last call."""
        while not self._arrived.empty():
            found = self._arrived.get()
            if isinstance(found, str):
                self._news = found
            else:
                self._page.add(found)
                self._page.list_ghosts()

    def _release(self) -> None:
        self._by_hand = dict.fromkeys(self._by_hand)

    def _ask_for(self, **wish: Any) -> None:
        self.wish = {"tuned": self.tuned, **wish}

    def _free(self, body: str) -> bool:
        """Whether a body is pulled by a wrench: an object, or a link of a robot with a floating base."""
        return self._floats or body in self.subject.scene.objects

    def _moves(self, grip: Grip) -> bool:
        """Whether the point of a grip can move."""
        simulation = self.session.simulation
        if self._free(grip.body):
            return grip.body in simulation.engine.holdable
        model = simulation.model
        return model is not None and bool(model.jacobian(np.zeros(len(model.joints)), grip.body, grip.point).any())

    def _drag(self, body: str, event: Any) -> None:
        """Start, move or end a pull on a body that the user drags. event: viser's event of the drag."""
        latest = self.subject.history.latest
        if event.phase == "end" or latest is None:
            self._grip = None
            return
        target = np.array(event.end_position)
        if event.phase == "start":
            frame = frames_of(self.subject.scene, latest)[body]
            grip = Grip.at(body, frame, np.array(event.start_position), target)
            self._grip = grip if self._moves(grip) else None
            if self._grip is None:
                self._news = f"'{body}' cannot be pulled: it stands still, or the engine takes no forces on it"
        elif self._grip is not None:
            self._grip = Grip(self._grip.body, self._grip.point, target)

    # -- the session's operator -------------------------------------------------------------------------------------

    def ask(self, session: Session) -> Mapping[Target, float | None]:
        """References that the user sets at this tick; see `asrsim.live.session.Operator`."""
        values = {**self._by_hand}
        grip, spring = self._grip, (float(self._spring.value), float(self._limit.value))
        pull: Pull | None = None
        if self._held is not None and (grip is None or grip.body != self._held):
            session.hold(HeldWrench(self._held, (0.0, 0.0, 0.0)))
            self._held = None
        if grip is not None and self._free(grip.body):
            wrench, pull = grip.wrench(self._frame_now(session, grip.body), *spring)
            session.hold(wrench)
            self._held = grip.body
        elif grip is not None:
            pulled, pull = self._pulled(session, grip, spring)
            values |= pulled
        elif self._pushed:
            for joint in self._pushed:
                values.setdefault((joint, EXTERNAL_TORQUE), None)
            self._pushed = set()
        self._pull = pull
        # In a slow run, write the samples before their block is full, so that the page shows them soon.
        if clock.perf_counter() - self._written > LONGEST:
            session.simulation.flush()
            self._written = clock.perf_counter()
        return values

    def _pulled(self, session: Session, grip: Grip, spring: tuple[float, float]) -> tuple[Mapping[Target, float], Pull]:
        """External torques that a pull on a link causes, plus the external torques that the user has set; and the pull. spring:
        stiffness in N/m and largest force in N of the spring.
        """
        model = session.simulation.model
        assert model is not None
        order = [session.simulation.joints.index(name) for name in model.joints]
        torques, pull = grip.torques(model, session.simulation.observe().link_position[order], *spring)
        by_joint = torques_by_joint(model, torques)
        self._pushed |= by_joint.keys()
        targets = {(joint, EXTERNAL_TORQUE): torque for joint, torque in by_joint.items()}
        return {target: torque + (self._by_hand.get(target) or 0.0) for target, torque in targets.items()}, pull

    def _frame_now(self, session: Session, body: str) -> Array:
        """Present frame (4, 4) of a body in the world."""
        simulation = session.simulation
        bodies = {name: np.array(pose) for name, pose in simulation.look().scene().bodies.items()}
        positions = dict(zip(simulation.joints, simulation.observe().link_position.tolist(), strict=True))
        return self.subject.scene.frames(positions, bodies)[body]

    def write(self, samples: Samples) -> None:
        """Keep the next samples; see `asrsim.live.session.Operator`."""
        self.subject.history.write(samples)
        self._written = clock.perf_counter()

    def ended(self, summary: RunSummary) -> None:
        """Show why the run has diverged; a reset starts the next run."""
        self._end = f"<b>{summary.simulated_time:.2f} s</b><p>{escape(summary.message)}</p><p>Press Reset to start again.</p>"
        self._said = -1.0

    def show(self) -> None:
        """Show the newest sample. Called in a separate thread."""
        self._welcome()
        latest = self.subject.history.latest
        if latest is None:
            return
        self._page.draw(latest, pull=self._pull)
        # Update the texts by the wall clock and not by the simulated time, so that the texts of a paused run also change.
        if (now := clock.perf_counter()) - self._said >= SAID:
            self._said = now
            self._say_references(latest)
            self._page.say(self._end or self._status(float(latest.time[-1])), last=bool(self._end))

    def _say_references(self, latest: Samples) -> None:
        """Show each joint's present references below its sliders. The sliders keep the user's values: a new value would
        overwrite a number that the user is typing.
        """
        for joint, text in self._present.items():
            parts = []
            for target in self._sliders:
                if target[0] == joint and target[1] != EXTERNAL_TORQUE:
                    source = "scenario" if self._by_hand.get(target) is None else "by hand"
                    column, slot = self.session.simulation.prepared.slot_of(*target)
                    value = float(latest.values[f"reference_{slot}"][-1, column])
                    parts.append(line(f"now {value:.4g} ({source}): {escape(words_of(target[1]))}"))
            if (shown := lines(len(parts), "".join(parts))) != text.content:
                text.content = shown

    def _status(self, time: float) -> str:
        session, pull = self.session, self._pull
        pace = "paused" if session.paused else f"{1e3 * session.pace.late:.0f} ms behind"
        parts = [f"<b>{time:.2f} s</b>", pace]
        if pull is not None:
            parts.append(f"pull {np.linalg.norm(pull.force):.3g} N")
        return line(" · ".join(parts)) + escape(self._news, quote=False)
