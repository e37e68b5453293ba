"""Log and summary of a live run, from a start to the next reset or the end."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import replace
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
    """Sink of the simulation that writes samples and commands to the open log."""

    def __init__(self, scenario: Scenario, info: RunInfo) -> None:
        described = as_run(info, scenario)
        self._scenario, self._info = scenario, replace(described, metadata={**described.metadata, LIVE: "1"})
        self.folder = Path()
        self._writer: LogWriter | None = None
        self._commands: list[tuple[Command, float]] = []
        self._files = ExitStack()

    def open(self, folder: Path, *, overwrite: bool) -> None:
        """Start a log in `folder`. Raises OutputError."""
        self.folder = folder
        with ExitStack() as files:
            files.enter_context(owned(folder))
            self._earlier = open_folder(folder, self._scenario, overwrite=overwrite)
            path = files.enter_context(new_log(folder, self._earlier))
            self._writer = files.enter_context(LogWriter(path, self._info))
            self._files = files.pop_all()

    def write(self, samples: Samples) -> None:
        """Write samples of the simulation, and the commands since the last samples. Raises DivergenceError and OutputError."""
        if self._writer is not None:
            for command, time in self._commands:
                self._writer.aside(command_topic(), time, encoded(command, time))
            self._commands.clear()
            self._writer.write(samples)
            self._writer.flush()

    def command(self, command: Command, time: float) -> None:
        """Record a reference that was set from outside at `time` s; it is written with the next samples."""
        self._commands.append((command, time))

    def close(
        self, simulation: Simulation, wall: float, time: float, error: DivergenceError | None, figures: dict[str, Any]
    ) -> RunSummary:
        """Summary, after closing the log; also written beside it. wall: duration, s; time: simulated, s. Raises OutputError."""
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
        files = {"log": log, "summary": self.folder / SUMMARY}
        summary = make_summary(run, seen, samples=writer.samples, files=files, replaced=self._earlier)
        summary = replace(summary, live=figures)
        save_summary(summary, self.folder / SUMMARY)
        return summary

    def abandon(self) -> None:
        """Close an open log after an error; its content stays readable."""
        if self._writer is not None:
            self._writer.close({"status": "failed"})
            self._writer = None
            self._files.close()
