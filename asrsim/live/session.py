"""Live run: ticks in real time; every tick reads commands and publishes messages; the log is written alongside."""

from __future__ import annotations

import gc
import math
import time as clock
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from asrsim.errors import DivergenceError
from asrsim.live.commands import CommandInput, Motion, Target
from asrsim.live.episode import Episode
from asrsim.live.pace import Pace, leave_priority, take_priority
from asrsim.live.publisher import Publisher
from asrsim.live.transport import TRANSPORTS, Access, Interface, Service, Transport
from asrsim.samples import Command
from asrsim.scenario.data import Scenario
from asrsim.simulation.ranges import ranges_of, with_ranges
from asrsim.simulation.simulation import Simulation
from asrsim.summary.data import RunSummary

TICK = 1e-3
"""Wall-clock time between ticks, s; a step if that is longer."""
BATCH = 0.128
"""Interval at which samples are written to the log, s."""
BREATH = 10.0
"""Time within which a run must fall behind twice before it publishes less, s; a single pause of the machine is ignored."""
SPEECH = 0.25
"""Share of the topics in the work from which publishing less helps."""
LEAST_RATE = 10.0
"""Lowest rate of the topics, Hz."""
FOREVER = 1e7
"""Duration of a run without end, s."""
LOOK = 0.25
"""Time between updates of notices and status, s."""


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Settings of a live run."""

    speed: float = 1.0
    """Simulated seconds per second; infinite: without waiting."""
    duration: float | None = None
    """Simulated time after which the run ends, s; None: the run ends when stopped."""
    rate: float = 1000.0
    """Highest rate of the topics, Hz of simulated time."""
    namespace: str = ""
    transports: Sequence[str] = ()
    access: Access = field(default_factory=Access)
    paused: bool = False
    """Whether the run starts paused."""


class Session:
    """Live run; `run` executes it. `tell` receives sentences for the user."""

    def __init__(
        self, scenario: Scenario, folder: Path, settings: Settings, *, overwrite: bool = False,
        tell: Callable[[str], None] = lambda text: None,
    ) -> None:  # fmt: skip
        self.settings, self._tell = settings, tell
        prepared = with_ranges(scenario)
        scenario = replace(scenario, reference_ranges=prepared.scenario.reference_ranges)
        self._folder, self._overwrite, self._step = folder, overwrite, scenario.step
        fast = 1.0 if math.isinf(settings.speed) else settings.speed
        self._tick_steps = max(1, round(TICK * fast / self._step))
        self._publish_steps = max(1, round(1.0 / (settings.rate * self._step)))
        self.episode = Episode(scenario, prepared.info)
        self.simulation = Simulation(
            prepared, sinks=[self.episode], duration=settings.duration or FOREVER,
            chunk=max(1, round(BATCH / self._step)) * prepared.resolution.substeps, expected_substeps=10**6,
        )  # fmt: skip
        self.publisher = Publisher(self.simulation, prepared.info, namespace=settings.namespace)
        self.commands = CommandInput(prepared.info.joints, ranges_of(prepared), prefix=self.publisher.prefix)
        self.pace = Pace(settings.speed)
        self.paused = settings.paused
        self.transports: list[Transport] = []
        self.summaries: list[RunSummary] = []
        """Summaries of the finished episodes."""
        self._held: dict[Target, float] = {}
        self._motions: dict[Target, tuple[Callable[[float], float], float, float]] = {}
        """Function of a trajectory, its arrival time, and its duration."""
        self._applied = self._steps_done = 0
        self._last_slip, self._publishing = -math.inf, 0.0
        self._work = 0.0, 0.0
        """Time for all work and for topics until the run last fell behind, s."""
        self._reset = self._told_slow = self._urgent = False

    # -- services ----------------------------------------------------------------------------------------------------

    @property
    def interface(self) -> Interface:
        """Topics and services of the run."""
        return Interface(
            node=f"{self.publisher.prefix}/asrsim", outlets=self.publisher.outlets, inlets=self.commands.inlets,
            latched=self.publisher.latched,
            services={
                "pause": Service(self._pause, takes_flag=True),
                "reset": Service(self._ask_reset),
                "release": Service(self._release),
            },
        )  # fmt: skip

    def _pause(self, flag: bool) -> str:
        self.paused = flag
        self.pace.start()
        return "paused" if flag else "running"

    def _ask_reset(self, _: bool) -> str:
        self._reset = True
        return "back to the start"

    def _release(self, _: bool) -> str:
        self._motions.clear()
        for target in list(self._held):
            self._set(target, None)
        return "all references follow the scenario"

    # -- the run -----------------------------------------------------------------------------------------------------

    def run(self, *, stop: Callable[[], bool], status: Callable[[], None] = lambda: None) -> RunSummary:
        """Summary of the last episode, after the run: it ends when `stop` returns True, the duration is over, or the motion
        diverges. status: called a few times per second. Raises AsrsimError; files written so far stay readable.
        """
        began = clock.perf_counter()
        with ExitStack() as stack:
            stack.callback(self.simulation.close)
            self._urgent = math.isfinite(self.settings.speed) and take_priority()
            stack.callback(self._leave_priority)
            # Open the transports first: if one fails, the log of an earlier run is not replaced.
            for name in self.settings.transports:
                transport = TRANSPORTS.get(name).make(self.interface, self.settings.access)
                stack.callback(transport.close)
                self.transports.append(transport)
                self._tell(f"{name}: {transport.where}")
            self.episode.open(self._folder, overwrite=self._overwrite)
            stack.callback(self.episode.abandon)
            # Exclude existing objects from garbage collection.
            gc.collect()
            gc.freeze()
            stack.callback(gc.unfreeze)
            error = None
            try:
                self._advance(0)
                self.pace.start()
                looked = clock.perf_counter()
                while self._turn() and not stop():
                    if clock.perf_counter() - looked > LOOK:
                        looked = clock.perf_counter()
                        self._tell_notices()
                        status()
            except DivergenceError as caught:
                error = caught
            self._leave_priority()
            self._tell_notices()
            return self._close(clock.perf_counter() - began, error)

    @property
    def time(self) -> float:
        """Simulated time, s."""
        return self._steps_done * self._step

    @property
    def rate(self) -> float:
        """Rate of the topics, Hz of simulated time."""
        return 1.0 / (self._publish_steps * self._step)

    def _turn(self) -> bool:
        """Do a tick: read commands, simulate, publish. Returns False at the end of the duration."""
        if self._reset:
            self._begin_again()
        if self.paused:
            self._listen()
            clock.sleep(2 * TICK)
            self.pace.start()
            return True
        left = round((self.settings.duration or FOREVER) / self._step) - self._steps_done
        steps = min(self._tick_steps, left)
        slips = self.pace.slips
        late = self.pace.wait(steps * self._step)
        if self.pace.slips > slips:
            self._ease()
        self._listen()
        if late is not None:
            self._advance(steps)
        return late is None or steps < left

    def _ease(self) -> None:
        """Give up real-time priority when the run falls behind; halve the publishing rate when it falls behind again."""
        now = clock.perf_counter()
        before, self._last_slip = self._last_slip, now
        busy, publishing = self.pace.busy - self._work[0], self._publishing - self._work[1]
        self._work = self.pace.busy, self._publishing
        if self._urgent:
            self._leave_priority()
            self._tell("this machine is too slow for ticks at real-time priority: real-time priority is given up")
            return
        if now - before > BREATH:
            return
        if publishing >= SPEECH * busy and self.rate >= 2.0 * LEAST_RATE:
            self._publish_steps *= 2
            self._tell(f"this machine is too slow for the topics: from now on their rate is {self.rate:g} Hz")
        elif not self._told_slow:
            self._told_slow = True
            substeps = self.simulation.substeps
            self._tell(f"this machine is too slow for {substeps} substeps a step: narrow reference_ranges, or lower --speed")

    def _leave_priority(self) -> None:
        if self._urgent:
            leave_priority()
        self._urgent = False

    def _advance(self, steps: int) -> None:
        """Simulate whole steps and one further substep, which completes the record of the last step."""
        end = self._steps_done + steps
        while self._steps_done < end or self.simulation.substep == 0:
            due = (self._steps_done // self._publish_steps + 1) * self._publish_steps
            wanted = 0 if self.simulation.substep == 0 else min(end, due)
            self.simulation.advance_to(wanted * self.simulation.substeps + 1)
            self._steps_done = wanted
            if wanted % self._publish_steps == 0 and self.transports:
                began, time = clock.perf_counter(), round(self.time * 1e9)
                messages = self.publisher.messages(time, [transport.wanted for transport in self.transports])
                for transport in self.transports:
                    transport.publish(time, messages)
                self._publishing += clock.perf_counter() - began

    def _listen(self) -> None:
        """Set each reference to its last received value, or to the current value of its trajectory."""
        wanted: dict[Target, float | Motion] = {}
        for transport in self.transports:
            for received in transport.poll():
                wanted.update(self.commands.check(received))
        for target, value in wanted.items():
            self._motions.pop(target, None)
            if isinstance(value, Motion):
                self._motions[target] = value.curve(self._reference(target)), self.time, value.times[-1]
            else:
                self._set(target, value)
        for target, (curve, began, duration) in list(self._motions.items()):
            # Use the value at the end of the coming tick, so that the log contains the trajectory's values.
            elapsed = self.time + self._tick_steps * self._step - began
            self._set(target, self.commands.clamp(target, curve(elapsed)))
            if elapsed >= duration:
                del self._motions[target]

    def _reference(self, target: Target) -> float:
        """Current value of a reference."""
        j, column = self.simulation.prepared.slot_of(*target)
        name = f"reference_{column}"
        return float(self.simulation.read([name])[name][j])

    def _set(self, target: Target, value: float | None) -> None:
        if self._held.get(target) == value:
            return
        self.simulation.set_reference(*target, value)
        if value is None:
            self._held.pop(target, None)
        else:
            self._held[target] = value
        self._applied += 1
        self.episode.command(Command(self.simulation.substep, *target, value), self.simulation.time)

    def _begin_again(self) -> None:
        self._reset = False
        self._close(self.pace.busy, None)
        self.simulation.reset()
        self._held.clear()
        self._motions.clear()
        self._steps_done = 0
        self.publisher.begin_again()
        self.episode.open(self._folder / f"reset_{len(self.summaries)}", overwrite=self._overwrite)
        self._tell(f"reset: the log continues in {self.episode.folder}")
        self._advance(0)
        self.pace.start()

    def _close(self, wall: float, error: DivergenceError | None) -> RunSummary:
        try:
            if error is None:
                self.simulation.flush()
        except DivergenceError as caught:
            error = caught
        summary = self.episode.close(self.simulation, wall, self.time, error, self.figures())
        self.summaries.append(summary)
        return summary

    def _tell_notices(self) -> None:
        for notices in (self.commands.notices, *(transport.notices for transport in self.transports)):
            while notices:
                self._tell(notices.pop(0))

    def figures(self) -> dict[str, Any]:
        """Lateness, load and command counts so far, as plain data."""
        pace, commands = self.pace, self.commands
        median, high = pace.lateness()
        return {
            "ticks": pace.ticks,
            "late_p50": median,
            "late_p99": high,
            "late_worst": pace.worst,
            "rate": self.rate,
            "slips": pace.slips,
            "slipped": pace.slipped,
            "busy": pace.busy,
            "commands": commands.taken,
            "applied": self._applied,
            "clamped": dict(commands.clamped),
            "dropped": dict(commands.refused),
            "lost": sum(transport.lost for transport in self.transports),
            "transports": [transport.where for transport in self.transports],
        }
