"""A run repeated from its log alone, and compared with it bit for bit."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from asrsim.errors import ActuatorError, DivergenceError, LogError, Problem
from asrsim.log import LogReader, LogWriter, open_log
from asrsim.robot import Robot, load_robot
from asrsim.runs.execute import PLUGINS, result_metadata
from asrsim.runs.folder import LOG, open_folder
from asrsim.samples import Array, RunInfo, Samples
from asrsim.scenario import Scenario, scenario_from_data
from asrsim.simulation.run import Run, Sink, simulate


@dataclass(frozen=True, kw_only=True)
class Difference:
    """A series that came out otherwise, at its first differing sample."""

    kind: str
    """time, value, body or contact."""
    name: str
    """Quantity, body or pair of bodies."""
    joint: str | None
    time: float
    """s."""
    sample: int
    """Index of the sample, from 0."""
    logged: float
    repeated: float
    count: int
    """Samples that differ."""

    def __str__(self) -> str:
        what = f"{self.name} of {self.joint}" if self.joint else self.name
        return (
            f"{what}: {self.count} samples differ, the first at t = {self.time:.6g} s (sample {self.sample}): "
            f"{self.logged!r} in the log, {self.repeated!r} now"
        )

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON; numbers that are not finite as text."""
        return {
            key: str(value) if isinstance(value, float) and not np.isfinite(value) else value
            for key, value in vars(self).items()
        }


@dataclass(frozen=True, kw_only=True)
class Repetition:
    """What came of repeating a run."""

    path: Path
    variant: str
    logged_status: str
    """Of the log: complete, interrupted, diverged, truncated, ..."""
    status: str
    """Of the repeated run."""
    logged_samples: int
    samples: int
    """Samples compared: what both have."""
    missing: int
    """Samples of the log that the repeated run did not reach."""
    differences: tuple[Difference, ...]
    """In the order in which they appear."""
    versions: Mapping[str, tuple[str, str]]
    """Library -> (version that wrote the log, version here), where they differ."""
    log: Path | None = None
    """Log of the repeated run, if it was written."""

    @property
    def identical(self) -> bool:
        """Every logged sample came out again, bit for bit."""
        return not self.differences and not self.missing and self.samples > 0

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {
            "ok": self.identical,
            "identical": self.identical,
            "log": str(self.path),
            "variant": self.variant,
            "logged_status": self.logged_status,
            "status": self.status,
            "logged_samples": self.logged_samples,
            "samples": self.samples,
            "missing": self.missing,
            "differences": [difference.as_dict() for difference in self.differences],
            "versions": {name: list(pair) for name, pair in self.versions.items()},
            "repeated": str(self.log) if self.log is not None else None,
        }


def repeat(
    path: str | Path,
    *,
    out: str | Path | None = None,
    plugins: Sequence[str | Path] = (),
    trust_plugins: bool = False,
    overwrite: bool = False,
    progress: Callable[[float], None] | None = None,
    stop: Callable[[], bool] | None = None,
) -> Repetition:
    """Run again what a log describes, and compare every sample.

    Scenario, robot and attached files come from the log; nothing else is read but meshes, whose shapes a log does not hold.
    The log of a run that was interrupted, killed or diverged is compared as far as it goes. Memory does not grow with it.

    Args:
        path: The log.
        out: Folder for the repeated run's log; None: it is not written.
        plugins: Python files with users' actuators, instead of those in the log.
        trust_plugins: Run the Python files that the log carries.
        overwrite: Replace the results of another run in `out`.
        progress: Told the simulated time.
        stop: Asked now and then; True ends the comparison early.

    Raises:
        LogError: The file is no log of asrsim, or is damaged.
        ActuatorError: The log carries a user's actuator, and neither `plugins` nor `trust_plugins` is given.
        InputError, SimulationError: The run cannot be built any more.
        OutputError: `out` cannot be written.
    """
    reader = open_log(path)
    if "scenario" not in reader.info.resolved:
        message = "the log does not say how to repeat the run"
        raise LogError(Problem(message=message, file=reader.path, code="no-scenario"))
    folder = Path(out) if out is not None else None
    if folder is not None and (folder / LOG).resolve() == reader.path.resolve():
        message = "the repeated run would replace the log that it is compared with"
        raise LogError(Problem(message=message, file=reader.path, hint="Choose another folder", code="same-file"))
    with TemporaryDirectory(prefix="asrsim-rerun-") as temporary, ExitStack() as stack:
        _load_plugins(reader, Path(temporary), plugins, trust=trust_plugins)
        scenario, robot = restore(reader.info, Path(temporary))
        comparer = Comparer(reader)
        writer: LogWriter | None = None

        def sinks(info: RunInfo) -> Sequence[Sink]:
            nonlocal writer
            if folder is None:
                return [comparer]
            open_folder(folder, scenario, overwrite=overwrite)
            writer = stack.enter_context(LogWriter(folder / LOG, replace(info, scenario=reader.info.scenario)))
            return [comparer, writer]

        def ended() -> bool:
            return (reader.status != "complete" and comparer.exhausted) or (stop is not None and stop())

        error: DivergenceError | None = None
        try:
            run = simulate(scenario, robot, sinks=sinks, keep=False, progress=progress, stop=ended)
        except DivergenceError as caught:
            if not isinstance(caught.run, Run):
                raise
            error, run = caught, caught.run
        if writer is not None:
            writer.close(result_metadata(run, error))
    stopped = run.status == "interrupted" and not comparer.exhausted
    missing = 0 if stopped else comparer.rest()
    here = run.info.metadata
    there = reader.info.metadata
    return Repetition(
        path=reader.path,
        variant=reader.info.variant,
        logged_status=reader.status,
        status=run.status,
        logged_samples=comparer.samples + missing,
        samples=comparer.samples,
        missing=missing,
        differences=comparer.differences,
        versions={
            name: (there[name], here[name])
            for name in ("asrsim", "pybullet", "numpy")
            if name in there and name in here and there[name] != here[name]
        },
        log=folder / LOG if folder is not None else None,
    )


def restore(info: RunInfo, folder: Path) -> tuple[Scenario, Robot]:
    """Scenario and robot from a log's description; files that they need are laid into `folder`."""
    files: dict[str, Path] = {}
    for number, (name, data) in enumerate(sorted(info.attachments.items())):
        # Names come from a file: only their last part, and each in its own folder.
        place = folder / "files" / str(number)
        place.mkdir(parents=True)
        files[name] = place / (PurePosixPath(name.replace("\\", "/")).name or "file")
        files[name].write_bytes(data)
    urdf = folder / "robot.urdf"
    urdf.write_text(info.urdf, encoding="utf-8")
    robot = load_robot(urdf)
    # Meshes are sought where they were when the log was written.
    robot = replace(robot, path=Path(info.urdf_path).with_suffix(".urdf") if info.urdf_path else urdf)
    # What the run should have given is no part of it, and may name recordings that are not here.
    keys = {key: value for key, value in info.resolved["scenario"].items() if key != "expect"}
    named = keys["robot"]["file"] if isinstance(keys["robot"], Mapping) else keys["robot"]
    scenario = scenario_from_data(
        keys,
        base_dir=Path(info.scenario_path).parent if info.scenario_path else folder,
        files={**files, str(named): urdf},
        name=Path(info.scenario_path).stem if info.scenario_path else "scenario",
        variant=info.variant,
    )
    plugins = {name: path for name, path in files.items() if name.startswith(PLUGINS)}
    path = Path(info.scenario_path) if info.scenario_path else None
    return replace(scenario, path=path, attachments={**scenario.attachments, **plugins}), robot


class Comparer:
    """A sink that holds samples against those of a log, in memory that does not grow."""

    def __init__(self, reader: LogReader) -> None:
        self._chunks: Iterator[Samples] = reader.iter_samples()
        self._chunk: Samples | None = None
        self._row = 0
        self._found: dict[tuple[str, str, str | None], Difference] = {}
        self.samples = 0
        """Samples compared."""
        self.exhausted = False
        """The log has no more."""

    @property
    def differences(self) -> tuple[Difference, ...]:
        """Differing series in the order in which they appear."""
        return tuple(sorted(self._found.values(), key=lambda one: one.sample))

    def write(self, samples: Samples) -> None:
        """Hold a chunk of the repeated run against the log."""
        position = 0
        while position < len(samples.time):
            logged = self._ahead()
            if logged is None:
                return
            count = min(len(samples.time) - position, len(logged.time) - self._row)
            here, there = slice(position, position + count), slice(self._row, self._row + count)
            self._compare(samples, here, logged, there)
            position += count
            self._row += count
            self.samples += count

    def rest(self) -> int:
        """Samples of the log that were not asked for; goes through to its end."""
        count = 0
        while (logged := self._ahead()) is not None:
            count += len(logged.time) - self._row
            self._row = len(logged.time)
        return count

    def _ahead(self) -> Samples | None:
        while self._chunk is None or self._row >= len(self._chunk.time):
            self._chunk, self._row = next(self._chunks, None), 0
            if self._chunk is None:
                self.exhausted = True
                return None
        return self._chunk

    def _compare(self, new: Samples, here: slice, old: Samples, there: slice) -> None:
        time = old.time[there]
        self._series("time", "time", None, time, time, new.time[here])
        for name in dict.fromkeys((*old.values, *new.values)):
            for joint in old.joints:
                before = old.values[name][there, old.joints.index(joint)] if name in old.values else None
                after = new.values[name][here, new.joints.index(joint)] if name in new.values and joint in new.joints else None
                self._series("value", name, joint, time, before, after)
        for kind, logged, made in (("body", old.bodies, new.bodies), ("contact", old.contacts, new.contacts)):
            for name in dict.fromkeys((*logged, *made)):
                table, other = logged.get(name), made.get(name)
                width = (table if table is not None else made[name]).shape[1]
                for column in range(width):
                    before = None if table is None else table[there, column]
                    after = None if other is None else other[here, column]
                    self._series(kind, name, None, time, before, after)

    def _series(self, kind: str, name: str, joint: str | None, time: Array, before: Array | None, after: Array | None) -> None:
        empty = np.full(len(time), np.nan)
        before, after = (empty if part is None else np.ascontiguousarray(part, np.float64) for part in (before, after))
        differs = (before.view(np.uint64) != after.view(np.uint64)) & ~(np.isnan(before) & np.isnan(after))
        count = int(np.count_nonzero(differs))
        if not count:
            return
        key = (kind, name, joint)
        first = self._found.get(key)
        if first is not None:
            self._found[key] = replace(first, count=first.count + count)
            return
        row = int(np.argmax(differs))
        self._found[key] = Difference(
            kind=kind, name=name, joint=joint, time=float(time[row]), sample=self.samples + row,
            logged=float(before[row]), repeated=float(after[row]), count=count,
        )  # fmt: skip


def _load_plugins(reader: LogReader, folder: Path, plugins: Sequence[str | Path], *, trust: bool) -> None:
    from asrsim.actuators import ACTUATORS
    from asrsim.actuators.user import load_plugin_file

    for path in plugins:
        load_plugin_file(path)
    carried = {name: data for name, data in reader.info.attachments.items() if name.startswith(PLUGINS)}
    if plugins or not carried or all(joint.actuator in (*ACTUATORS.names(), "rigid") for joint in reader.info.joints):
        return
    if not trust:
        names = ", ".join(name.removeprefix(PLUGINS) for name in carried)
        message = f"the run needs actuators of the user's own, whose Python code the log carries ({names})"
        hint = "Run that code with --trust-plugins if you trust the log's author, or name your own file with --plugin"
        raise ActuatorError(Problem(message=message, file=reader.path, hint=hint, code="plugin-code"))
    for number, (name, data) in enumerate(carried.items()):
        path = folder / "plugins" / str(number) / (PurePosixPath(name).name or "plugin.py")
        path.parent.mkdir(parents=True)
        path.write_bytes(data)
        load_plugin_file(path)
