"""The log of a live run from one start to the next reset, or the end."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from asrsim.errors import DivergenceError
from asrsim.log import LogWriter, open_log
from asrsim.log.commands import command_topic, encoded
from asrsim.runs.described import LIVE, as_run
from asrsim.runs.execute import result_metadata, save_summary
from asrsim.runs.folder import LOG, SUMMARY, new_log, open_folder
from asrsim.runs.lock import owned
from asrsim.samples import Command, RunInfo, Samples
from asrsim.scenario.data import Scenario
from asrsim.simulation.run import run_of
from asrsim.simulation.simulation import Simulation
from asrsim.summary import Collector, RunSummary, make_summary


class Episode:
    """A sink of the simulation: samples go to the log that is open.

    To write samples and to close a chunk with them takes up to a millisecond each: they are jobs, of which a tick that has
    the time does one. A thread would hold Python's lock in the midst of a tick.
    """

    def __init__(self, scenario: Scenario, info: RunInfo) -> None:
        described = as_run(info, scenario)
        self._scenario, self._info = scenario, replace(described, metadata={**described.metadata, LIVE: "1"})
        self.folder = Path()
        self._writer: LogWriter | None = None
        self.jobs: deque[Callable[[], None]] = deque()
        """That wait."""
        self._commands: list[tuple[Command, float]] = []
        self._files = ExitStack()
        self._earlier: tuple[Path, ...] = ()

    def open(self, folder: Path, *, overwrite: bool) -> None:
        """Begin a log in `folder`. Raises OutputError."""
        self.folder = folder
        files = ExitStack()
        try:
            files.enter_context(owned(folder))
            self._earlier = open_folder(folder, self._scenario, overwrite=overwrite)
            path = files.enter_context(new_log(folder, self._earlier))
            self._writer = files.enter_context(LogWriter(path, self._info))
        except BaseException:
            files.close()
            raise
        self._files = files

    def write(self, samples: Samples) -> None:
        """From the recording."""
        self.jobs += (partial(self._write, samples), self._flush)

    def _write(self, samples: Samples) -> None:
        commands, self._commands = self._commands, []
        if self._writer is not None:
            for command, time in commands:
                self._writer.aside(command_topic(), time, encoded(command, time))
            self._writer.write(samples)

    def _flush(self) -> None:
        if self._writer is not None:
            self._writer.flush()

    def work(self) -> None:
        """Do the next job. Raises DivergenceError where energy came from nowhere, and OutputError."""
        self.jobs.popleft()()

    def finish(self) -> DivergenceError | None:
        """Do all jobs; returns what they found first. Raises OutputError."""
        found = None
        while self.jobs:
            try:
                self.work()
            except DivergenceError as error:
                found = found or error
        return found

    def command(self, command: Command, time: float) -> None:
        """Note what was set from outside at `time` s; written with the samples."""
        self._commands.append((command, time))

    def close(
        self, simulation: Simulation, wall: float, time: float, error: DivergenceError | None, figures: dict[str, Any]
    ) -> RunSummary:
        """End the log; the summary stands beside it then. wall: s that it took; time: s simulated. Raises OutputError."""
        writer = self._writer
        if writer is None:
            raise RuntimeError("no log is open")
        run = run_of(simulation, "complete" if error is None else "diverged", wall_time=wall, message=str(error or ""))
        run = replace(run, simulated_time=time, scenario=replace(run.scenario, duration=max(time, run.scenario.step)))
        writer.close(result_metadata(run, error))
        self._writer = None
        self._files.close()
        log = self.folder / LOG
        collector = Collector(run.info.joints, samples=max(writer.samples, 1))
        for chunk in open_log(log).iter_samples():
            collector.write(chunk)
        seen = collector.seen(run.scenario.desired, balanced=run.scenario.initial_equilibrium)
        summary = make_summary(run, seen, samples=writer.samples, files={"log": log}, replaced=self._earlier)
        summary = replace(summary, live=figures, files={**summary.files, "summary": self.folder / SUMMARY})
        save_summary(summary, self.folder / SUMMARY)
        return summary

    def abandon(self) -> None:
        """Close what is still open, after an error; what is in the log stays readable."""
        if self._writer is not None:
            self.finish()
            self._writer.close({"status": "failed"})
            self._writer = None
            self._files.close()
