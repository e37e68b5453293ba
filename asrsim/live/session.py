"""Live run, which consists of ticks in real time. Every tick reads commands, simulates and publishes messages. The log is
written during the run."""

from __future__ import annotations

import gc
import math
import time as clock
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

from asrsim.errors import DivergenceError, listed
from asrsim.live.commands import CommandInput, Target
from asrsim.live.pace import Pace
from asrsim.live.publisher import Publisher
from asrsim.live.transport import Access, Interface, TellUser, Transport, opened
from asrsim.log import LogWriter, open_log
from asrsim.log.commands import encoded, topic_of
from asrsim.outfile import write_json
from asrsim.progress import Stop
from asrsim.runs.described import LIVE, as_run
from asrsim.runs.execute import judged, result_metadata
from asrsim.runs.folder import LOG, SUMMARY, new_log, open_folder
from asrsim.runs.lock import owned
from asrsim.samples import Command, HeldWrench, Samples, WrenchCommand
from asrsim.simulation.examine import Plan
from asrsim.simulation.prepare import build
from asrsim.simulation.run import obey, run_of
from asrsim.simulation.simulation import Simulation
from asrsim.summary import Collector, RunSummary

TICK = 1e-3
"""Wall-clock time between ticks of a run with topics, s."""
BATCH = 0.128
"""Interval at which samples are written to the log, s."""
TOPICS_SHARE = 0.25
"""Fraction of the working time that topics take, above which the publishing rate is lowered so that the run can keep up."""
LEAST_RATE = 10.0
"""Lowest rate of the topics, Hz."""
IDLE = 0.02
"""Time between two checks for commands while a run is paused, s."""
FOREVER = 1e7
"""Simulated time after which a run without a given duration ends, s."""


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Settings of a live run."""

    speed: float = 1.0
    """Simulated seconds per wall-clock second; infinite: the run does not wait."""
    duration: float | None = None
    """Simulated time after which the run ends, s; None: the run ends when it is stopped."""
    rate: float = 1000.0
    """Highest rate of the topics, Hz of simulated time."""
    namespace: str = ""
    transports: Sequence[str] = ()
    access: Access = field(default_factory=Access)
    tick: float = TICK
    """Wall-clock time between ticks, s; the time step if the time step is longer."""
    batch: float = BATCH
    """Interval at which samples are written to the log and shown to an operator, s."""


class Operator(Protocol):
    """Person who operates a live run, for example in `asrsim view`. The operator sees the samples, and sets references by
    hand."""

    def ask(self, session: Session) -> Mapping[Target, float | None]:
        """References to set at this tick; None: the scenario's signal acts again. This method is called in each tick, also
        while the run is paused, in the run's thread. It may pause, step or end the session.
        """

    def write(self, samples: Samples) -> None:
        """Receive the next samples."""


class Session:
    """Live run, which the method `run` executes."""

    def __init__(
        self, plan: Plan, folder: Path, settings: Settings, *, overwrite: bool = False, tell: TellUser = lambda text: None
    ) -> None:
        """plan: the examined scenario. If the plan replaces the scenario's robot, the text of the new robot must describe this
        robot completely.
        """
        self.settings, self._tell = settings, tell
        self.operator: Operator | None = None
        """Person who operates the run."""
        prepared = build(plan, settable=True)
        self._scenario = replace(plan.scenario, reference_ranges=prepared.scenario.reference_ranges)
        self._folder, self._overwrite, self._step = folder, overwrite, plan.scenario.step
        self._duration = settings.duration or FOREVER
        self.paused = False
        """Whether the simulation waits; commands are still read."""
        self._singles = 0
        """Number of single steps that a paused run must still execute."""
        self._tick_steps = 1
        self._publish_steps = max(1, round(1.0 / (settings.rate * self._step)))
        self.simulation = Simulation(
            prepared,
            sinks=[self],
            duration=self._duration,
            chunk=max(1, round(settings.batch / self._step)) * prepared.resolution.substeps,
            expected_substeps=10**6,
        )
        self.publisher = Publisher(self.simulation, namespace=settings.namespace)
        self.commands = CommandInput(prepared.info.joints, self.publisher.ranges, prefix=self.publisher.prefix, tell=tell)
        self.pace = Pace(settings.speed)
        self.set_speed(settings.speed)
        self.transports: list[Transport] = []
        self._writer: LogWriter | None = None
        self._unwritten: list[tuple[Command | WrenchCommand, float]] = []
        """Applied commands that are not in the log yet, with their times in s."""
        self._overrides: dict[Target, float | None] = {}
        self._wrenches: dict[str, HeldWrench] = {}
        self._applied = self._steps_done = 0
        self._publishing = 0.0
        """Time spent publishing, s."""
        self._work = 0.0, 0.0
        """Time spent on all work, and the part of this time spent on topics, from the start of the run to the latest check of
        its pace, s."""
        self._said_slow = False

    def run(self, *, stop: Stop) -> RunSummary:
        """Execute the run until `stop` returns True, the duration is over, or the motion diverges, and return the summary.

        stop: function that is called in each tick. Raises AsrsimError; files written so far stay readable.
        """
        began, error = clock.perf_counter(), None
        with ExitStack() as stack:
            stack.callback(self.simulation.close)
            # Open the transports first, so that the log of an earlier run is not replaced if a transport fails.
            settings = self.settings
            interface = Interface(f"{self.publisher.prefix}/asrsim", self.publisher.outlets, self.commands.inlets)
            self.transports = stack.enter_context(opened(settings.transports, interface, settings.access, self._tell))
            drives = self.simulation.prepared.drives
            if imperfect := [drive.name for drive in drives if drive.command_imperfections is not None]:
                message = "act on the signals of the scenario, but not on commands that arrive or that are set by hand"
                self._tell(f"imperfections of the commands of {listed(imperfect, 4)} {message}")
            stack.enter_context(owned(self._folder))
            earlier = open_folder(self._folder, self._scenario, overwrite=self._overwrite)
            log_file = stack.enter_context(ExitStack())
            path = log_file.enter_context(new_log(self._folder, earlier))
            described = as_run(self.simulation.prepared.info, self._scenario)
            described = replace(described, metadata={**described.metadata, LIVE: "1"})
            self._writer = log_file.enter_context(LogWriter(path, described))
            # Exclude the existing objects from garbage collection, which would delay ticks. If the program has excluded
            # objects, they stay excluded.
            if not gc.get_freeze_count():
                gc.collect()
                gc.freeze()
                stack.callback(gc.unfreeze)
            try:
                self._advance(0)
                self.pace.start()
                while self._turn() and not stop():
                    pass
                self.simulation.flush()
            except DivergenceError as caught:
                error = caught
            return self._finish(log_file, earlier, clock.perf_counter() - began, error)

    @property
    def time(self) -> float:
        """Simulated time, s."""
        return self._steps_done * self._step

    @property
    def rate(self) -> float:
        """Rate of the topics, Hz of simulated time."""
        return 1.0 / (self._publish_steps * self._step)

    def _turn(self) -> bool:
        """Execute a tick: read commands, simulate, publish. Returns False when the duration of the run is over."""
        left = round(self._duration / self._step) - self._steps_done
        if self.paused:
            return self._wait(left) < left
        steps = min(self._tick_steps, left)
        late = self.pace.wait(steps * self._step)
        if self.pace.is_behind():
            self._ease()
        self._listen()
        if late is not None:
            self._advance(steps)
        return late is None or steps < left

    def _wait(self, left: int) -> int:
        """Execute the single steps that the user requested in a paused run, at most `left`. Without such a request, wait a
        moment. Returns the number of executed steps.
        """
        self._listen()
        steps, self._singles = min(self._singles, left), 0
        if steps:
            self._advance(steps)
        else:
            clock.sleep(IDLE)
        self.simulation.flush()
        # Restart the clock, so that the run does not try to make up for the time of the pause.
        self.pace.start()
        return steps

    def set_speed(self, speed: float) -> None:
        """Set the simulated seconds per wall-clock second."""
        self.pace.speed = speed
        self._tick_steps = max(1, round(self.settings.tick * (1.0 if math.isinf(speed) else speed) / self._step))

    def single_step(self, steps: int = 1) -> None:
        """Execute some steps of a paused run in its next tick."""
        self._singles += steps

    def _ease(self) -> None:
        """Halve the rate of the topics if publishing takes much of the working time; otherwise report once that the machine is
        too slow.
        """
        busy, publishing = self.pace.busy - self._work[0], self._publishing - self._work[1]
        self._work = self.pace.busy, self._publishing
        if publishing >= TOPICS_SHARE * busy and self.rate >= 2.0 * LEAST_RATE:
            self._publish_steps *= 2
            self._tell(f"this machine is too slow for the topics: their rate is now {self.rate:g} Hz")
        elif not self._said_slow:
            self._said_slow = True
            substeps = self.simulation.substeps
            self._tell(f"this machine is too slow for {substeps} substeps per step: narrow reference_ranges, or lower --speed")

    def _advance(self, steps: int) -> None:
        """Simulate `steps` whole steps and one further substep, which completes the record of the last step."""
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
        """Set the references that commands change, to the commanded values at the end of the coming tick."""
        received = (message for transport in self.transports for message in transport.poll())
        values: dict[Target, float | None] = {
            **self.commands.listen(received, self.simulation, self.time, self._tick_steps * self._step)
        }
        if self.operator is not None:
            values |= self.operator.ask(self)
        for target, value in values.items():
            if self._overrides.get(target) != value:
                self._obey(Command(self.simulation.substep, *target, value))
                self._overrides[target] = value

    def hold(self, wrench: HeldWrench) -> None:
        """Let a wrench act on a body until the next wrench for this body. An operator's `ask` calls this method, in the run's
        thread. Raises InputError in the same cases as `Simulation.set_wrench`.
        """
        if self._wrenches.get(wrench.body) != wrench:
            self._obey(WrenchCommand(self.simulation.substep, wrench))
            self._wrenches[wrench.body] = wrench

    def _obey(self, command: Command | WrenchCommand) -> None:
        """Apply a command, and keep it for the log."""
        obey(self.simulation, command)
        self._applied += 1
        self._unwritten.append((command, self.simulation.time))

    # -- log and summary ---------------------------------------------------------------------------------------------

    def write(self, samples: Samples) -> None:
        """Write samples of the simulation to the log, with the commands since the last samples. Raises OutputError."""
        if self._writer is not None:
            for command, time in self._unwritten:
                self._writer.aside(topic_of(command), time, encoded(command, time))
            self._unwritten.clear()
            self._writer.write(samples)
            self._writer.flush()
        if self.operator is not None:
            self.operator.write(samples)

    def _finish(self, log_file: ExitStack, earlier: Sequence[Path], wall: float, error: DivergenceError | None) -> RunSummary:
        """Close the log, and return the summary, which is also written beside the log. wall: duration, s."""
        writer, time = self._writer, self.time
        assert writer is not None
        run = run_of(self.simulation, "complete" if error is None else "diverged", wall_time=wall, message=str(error or ""))
        run = replace(run, simulated_time=time, scenario=replace(run.scenario, duration=max(time, self._step)))
        writer.close(result_metadata(run, error))
        log_file.close()
        log = self._folder / LOG
        collector = Collector(run.info.joints, samples=max(writer.samples, 1))
        for chunk in open_log(log).iter_samples():
            collector.write(chunk)
        # Do not judge the claims of the scenario, since commands override the references to which the claims refer.
        summary = judged(replace(self._scenario, expect=()), run, collector, samples=writer.samples)
        files = {"log": log, "summary": self._folder / SUMMARY}
        summary = replace(summary, files=files, replaced=tuple(earlier), live=self.figures())
        write_json(files["summary"], summary.as_dict())
        return summary

    def figures(self) -> dict[str, Any]:
        """Lateness of the ticks, load, and counts of commands from the start of the run until now, as plain data."""
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
        }
