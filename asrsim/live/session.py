"""A live run: ticks in real time, what comes in and goes out at each, and the log beside it."""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from asrsim.errors import DivergenceError
from asrsim.live.board import Board
from asrsim.live.episode import Episode
from asrsim.live.gate import Gate, Target
from asrsim.live.pace import Pace
from asrsim.live.priority import RealTime, quiet_collector
from asrsim.live.transport import TRANSPORTS, Access, Interface, Parameter, Service, Transport
from asrsim.samples import Command
from asrsim.scenario.data import Scenario
from asrsim.simulation.ranges import ranges_of, with_ranges
from asrsim.simulation.simulation import Simulation
from asrsim.summary.data import RunSummary

TICK = 1e-3
"""s of wall time between ticks, or a step where that is longer."""
BATCH = 0.128
"""s between samples handed to the log."""
MOST_BEHIND = 48
"""Jobs of the log that wait for a tick that comes in time."""
FASTEST, SLOWEST = 1000.0, 1e-3
"""Speeds that one may ask for."""
BREATH = 10.0
"""s: a run that falls behind twice within them has too much to do; a halt of the machine is no reason to publish less."""
LEAST_RATE = 10.0
"""Hz of the topics, below which a run that is too slow no longer goes."""
FOREVER = 1e7
"""s: longer than anybody waits."""


@dataclass(frozen=True, kw_only=True)
class Settings:
    """How a live run goes."""

    speed: float = 1.0
    """Simulated s a second; infinite: as fast as it goes."""
    duration: float | None = None
    """Simulated s after which it ends; None: when it is stopped."""
    rate: float = 1000.0
    """Hz (simulated) at which topics are published, at most."""
    namespace: str = ""
    transports: Sequence[str] = ()
    access: Access = field(default_factory=Access)
    paused: bool = False
    """It begins paused."""


class Session:
    """One live run; :meth:`run` until it ends. Nothing here prints: `tell` takes sentences, `status` what stands now."""

    def __init__(
        self, scenario: Scenario, folder: Path, settings: Settings, *, overwrite: bool = False,
        tell: Callable[[str], None] = lambda text: None,
    ) -> None:  # fmt: skip
        self.settings, self._tell = settings, tell
        prepared = with_ranges(scenario)
        self.scenario = replace(scenario, reference_ranges=prepared.scenario.reference_ranges)
        self._folder, self._overwrite = folder, overwrite
        step, substeps = prepared.scenario.step, prepared.resolution.substeps
        fast = 1.0 if math.isinf(settings.speed) else settings.speed
        self._tick_steps = max(1, round(TICK * fast / step))
        self._publish_steps = max(1, round(1.0 / (settings.rate * step)))
        self.episode = Episode(self.scenario, prepared.info)
        self.simulation = Simulation(
            prepared, sinks=[self.episode], duration=settings.duration or FOREVER,
            chunk=max(1, round(BATCH / step)) * substeps, expected_substeps=10**6,
        )  # fmt: skip
        ranges = ranges_of(prepared)
        self.board = Board(self.simulation, prepared.info, namespace=settings.namespace)
        self.gate = Gate(prepared.info.joints, ranges, prefix=self.board.prefix)
        self.pace = Pace(settings.speed)
        self._priority = RealTime(wanted=math.isfinite(settings.speed))
        self.paused = settings.paused
        self.transports: list[Transport] = []
        self.overtaken = 0
        """Values that another for the same reference overtook before a step came."""
        self._held: dict[Target, float] = {}
        self._applied = 0
        self._steps_done = 0
        self._single = 0
        self._slips, self._slipped = 0, -math.inf
        self._reset = False
        self._end = False
        self.summaries: list[RunSummary] = []
        """Of the episodes that have ended."""

    # -- what the outside may ask ------------------------------------------------------------------------------------

    @property
    def interface(self) -> Interface:
        """Topics, services and parameters."""
        return Interface(
            node=f"{self.board.prefix}/asrsim", outlets=self.board.outlets, inlets=self.gate.inlets, latched=self.board.latched,
            services={
                "pause": Service("true: pause; false: go on", self._pause, takes_flag=True),
                "step": Service("one step of a paused run", self._step_once),
                "reset": Service("back to the start; the log is closed, another begins", self._ask_reset),
                "release": Service("all references follow the scenario again", self._release),
            },
            parameters={"speed": Parameter("simulated s a second", lambda: self.pace.speed, self._set_speed)},
        )  # fmt: skip

    def _pause(self, flag: bool) -> tuple[bool, str]:
        self.paused = flag
        self.pace.start()
        return True, "paused" if flag else "running"

    def _step_once(self, _: bool) -> tuple[bool, str]:
        if not self.paused:
            return False, "the run is not paused"
        self._single += 1
        return True, f"to {self._time + self.simulation.scenario.step * self._single:.9g} s"

    def _ask_reset(self, _: bool) -> tuple[bool, str]:
        self._reset = True
        return True, "back to the start"

    def _release(self, _: bool) -> tuple[bool, str]:
        for target in list(self._held):
            self._set(target, None)
        return True, "all references follow the scenario"

    def _set_speed(self, speed: float) -> str:
        if not (SLOWEST <= speed <= FASTEST):
            return f"must be between {SLOWEST:g} and {FASTEST:g}"
        self.pace.set_speed(speed)
        self._tick_steps = max(1, round(TICK * speed / self.simulation.scenario.step))
        return ""

    # -- the run -----------------------------------------------------------------------------------------------------

    def run(self, *, stop: Callable[[], bool], status: Callable[[], None] = lambda: None) -> RunSummary:
        """Until `stop`, the duration, or a divergence; the last episode's summary. Raises AsrsimError; what was written
        stays readable."""
        began = clock.perf_counter()
        with ExitStack() as stack, self._priority, quiet_collector():
            stack.callback(self.simulation.close)
            # First what may fail: an earlier run's log is not given up for a port that is taken.
            for name in self.settings.transports:
                transport = TRANSPORTS.get(name).make(self.interface, self.settings.access)
                stack.callback(transport.close)
                self.transports.append(transport)
                self._tell(f"{name}: {transport.where}")
            self.episode.open(self._folder, overwrite=self._overwrite)
            stack.callback(self.episode.abandon)
            error = None
            self.pace.start()
            looked = clock.perf_counter()
            try:
                self._advance(0)
                while not self._end:
                    self._turn()
                    self._end = self._end or stop()
                    now = clock.perf_counter()
                    if now - looked > 0.25:
                        looked = now
                        self._notices()
                        status()
            except DivergenceError as caught:
                error = caught
            self._priority.give_up()
            self._notices()
            return self._close(clock.perf_counter() - began, error)

    @property
    def _time(self) -> float:
        return self._steps_done * self.simulation.scenario.step

    def _turn(self) -> None:
        """A tick: listen, simulate, speak."""
        step = self.simulation.scenario.step
        if self._reset:
            self._begin_again()
        steps = self._tick_steps
        if self.paused:
            self._listen()
            if not self._single:
                clock.sleep(2 * TICK)
                self.pace.start()
                return
            self._single -= 1
            steps = 1
        left = round((self.settings.duration or FOREVER) / step) - self._steps_done
        if (steps := min(steps, left)) > 0:
            late = self.pace.wait(steps * step)
            if self.pace.slips > self._slips:
                self._ease()
            self._listen()
            if late is None:
                return
            waiting = self.episode.jobs
            in_time = min(len(waiting), 1) if late < 0.5 * TICK else 0
            self._advance(steps)
            for _ in range(max(in_time, len(waiting) - MOST_BEHIND)):
                self.episode.work()
        self._end = self._end or steps >= left

    @property
    def rate(self) -> float:
        """Hz (simulated) at which topics are published."""
        return 1.0 / (self._publish_steps * self.simulation.scenario.step)

    def _ease(self) -> None:
        """The run fell behind for good: it gives up its priority, and where that is not enough every other message."""
        now, before = clock.perf_counter(), self._slipped
        self._slips, self._slipped = self.pace.slips, now
        if self._priority.give_up():
            self._tell("this machine is too slow for ticks at real-time priority: others come first again")
        elif self.transports and now - before < BREATH and self.rate >= 2.0 * LEAST_RATE:
            self._publish_steps *= 2
            self._tell(f"this machine is too slow for what was asked: from here on topics come at {self.rate:g} Hz")

    def _advance(self, steps: int) -> None:
        """Go on by whole steps, to one substep beyond: with it the whole step's record is complete."""
        before = self._steps_done
        while self._steps_done < before + steps or self.simulation.substep == 0:
            due = (self._steps_done // self._publish_steps + 1) * self._publish_steps
            wanted = 0 if self.simulation.substep == 0 else min(before + steps, due)
            self.simulation.advance_to(wanted * self.simulation.substeps + 1)
            self._steps_done = wanted
            if wanted % self._publish_steps == 0 and self.transports:
                time = round(self._time * 1e9)
                messages = self.board.messages(time, [transport.wanted for transport in self.transports])
                for transport in self.transports:
                    transport.publish(time, messages)

    def _listen(self) -> None:
        """The last value of each reference is set."""
        wanted: dict[Target, float] = {}
        for transport in self.transports:
            for received in transport.poll():
                for target, value in self.gate.check(received):
                    self.overtaken += target in wanted
                    wanted[target] = value
        for target, value in wanted.items():
            if self._held.get(target) != value:
                self._set(target, value)

    def _set(self, target: Target, value: float | None) -> None:
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
        self._steps_done = self._single = 0
        self.board.begin_again()
        self.episode.open(self._folder / f"reset_{len(self.summaries)}", overwrite=self._overwrite)
        self._tell(f"reset: the log goes on in {self.episode.folder}")
        self._advance(0)
        self.pace.start()

    def _close(self, wall: float, error: DivergenceError | None) -> RunSummary:
        if error is None:
            try:
                self.simulation.flush()
            except DivergenceError as caught:
                error = caught
        error = self.episode.finish() or error
        summary = self.episode.close(self.simulation, wall, self._time, error, self.figures())
        self.summaries.append(summary)
        return summary

    def _notices(self) -> None:
        for notices in (self.gate.notices, *(transport.notices for transport in self.transports)):
            while notices:
                self._tell(notices.pop(0))

    def figures(self) -> dict[str, Any]:
        """Lateness, load and commands so far, as plain values."""
        late, pace, gate = self.pace.lateness, self.pace, self.gate
        return {
            "ticks": late.count,
            "late_p50": late.quantile(0.5),
            "late_p99": late.quantile(0.99),
            "late_worst": late.worst,
            "rate": self.rate,
            "slips": pace.slips,
            "slipped": pace.slipped,
            "busy": pace.busy,
            "commands": gate.taken,
            "applied": self._applied,
            "overtaken": self.overtaken,
            "clamped": dict(gate.clamped),
            "dropped": dict(gate.refused),
            "lost": sum(transport.lost for transport in self.transports),
            "transports": [transport.where for transport in self.transports],
        }
