"""A run repeated from its log alone, and compared with it bit for bit."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import Any

from asrsim.engines import ENGINES
from asrsim.errors import ActuatorError, DivergenceError, LogError
from asrsim.log import LogReader, LogWriter, open_log
from asrsim.plain import one_or_more
from asrsim.robot import Robot, load_robot
from asrsim.runs.compare import Comparer, Difference
from asrsim.runs.described import LIVE, UNREPEATABLE
from asrsim.runs.execute import PLUGINS, result_metadata
from asrsim.runs.folder import LOG, new_log, open_folder
from asrsim.runs.lock import owned
from asrsim.samples import RunInfo
from asrsim.scenario import Scenario, scenario_from_data
from asrsim.simulation.recording import Sink
from asrsim.simulation.run import Run, simulate


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
    folder = Path(out) if out is not None else None
    if UNREPEATABLE in reader.metadata:
        message = f"the run cannot be repeated: no document says what was changed about it ({reader.metadata[UNREPEATABLE]})"
        raise LogError(message, file=reader.path, code="unrepeatable")
    with TemporaryDirectory(prefix="asrsim-rerun-") as temporary, ExitStack() as stack:
        _load_plugins(reader, Path(temporary), plugins, trust=trust_plugins)
        scenario, robot = restore(reader.info, Path(temporary))
        _require_engine(reader, scenario.engine)
        new: Path | None = None
        if folder is not None:
            stack.enter_context(owned(folder))
            earlier = open_folder(folder, scenario, overwrite=overwrite, inputs=(reader.path,))
            new = stack.enter_context(new_log(folder, earlier))
        comparer = Comparer(reader)
        writers: list[LogWriter] = []

        def sinks(info: RunInfo) -> Sequence[Sink]:
            if new is not None:
                writers.append(stack.enter_context(LogWriter(new, _as_the_original(info, reader.info))))
            return [comparer, *writers]

        def ended() -> bool:
            return (reader.status != "complete" and comparer.exhausted) or (stop is not None and stop())

        run, error = _simulated(reader, scenario, robot, sinks=sinks, progress=progress, stop=ended)
        for writer in writers:
            writer.close(result_metadata(run, error))
    return _repetition(reader, run, comparer, folder / LOG if folder is not None else None)


def _as_the_original(info: RunInfo, logged: RunInfo) -> RunInfo:
    """The repeated run's description, with the scenario of the original one instead of the copy that the log carried."""
    return replace(
        info,
        scenario=logged.scenario,
        scenario_path=logged.scenario_path,
        resolved=logged.resolved,
        attachments={**logged.attachments, **info.attachments},
    )


def _simulated(
    reader: LogReader,
    scenario: Scenario,
    robot: Robot,
    *,
    sinks: Callable[[RunInfo], Sequence[Sink]],
    progress: Callable[[float], None] | None,
    stop: Callable[[], bool],
) -> tuple[Run, DivergenceError | None]:
    """The run, and the error that ended it where it diverges, as the logged one may have done."""
    # A live run lasts as long as its log, and repeats the commands recorded there.
    live = LIVE in reader.metadata
    try:
        run = simulate(
            scenario, robot, sinks=sinks, keep=False, progress=progress, stop=stop,
            commands=reader.commands() if live else (), duration=_whole_steps(reader) if live else None,
        )  # fmt: skip
    except DivergenceError as error:
        if not isinstance(error.run, Run):
            raise
        return error.run, error
    return run, None


def _repetition(reader: LogReader, run: Run, comparer: Comparer, log: Path | None) -> Repetition:
    """What the comparison found; log: that of the repeated run, if one is written."""
    stopped = run.status == "interrupted" and not comparer.exhausted
    missing = 0 if stopped else comparer.rest()
    here, there = run.info.metadata, reader.info.metadata
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
            for name in ("asrsim", "engine_version", "numpy")
            if name in there and name in here and there[name] != here[name]
        },
        log=log,
    )


def _whole_steps(reader: LogReader) -> float:
    """s that a log lasts; its last chunk may hold a command that came after its last sample."""
    step = reader.info.step
    return max(1, math.floor(reader.duration / step + 1e-6)) * step


def _require_engine(reader: LogReader, name: str) -> None:
    """A run is repeated in its own engine: another gives other bits. Raises LogError if that is not installed."""
    entry = ENGINES.get(name)
    if not entry.available:
        version = reader.info.metadata.get("engine_version", name)
        raise LogError(
            f"the run was made with the engine '{name}' ({version}), and '{entry.module}' is not installed here",
            file=reader.path,
            hint="Install it, or run the scenario itself in another engine with asrsim run --engine NAME",
            code="engine-missing",
        )


def restore(info: RunInfo, folder: Path) -> tuple[Scenario, Robot]:
    """Scenario and robot from a log's description; files that they need are laid into `folder`.

    Raises LogError if it has none, and InputError where they cannot be read any more.
    """
    if "scenario" not in info.resolved:
        raise LogError("the log does not say how to repeat the run", code="no-scenario")
    files: dict[str, Path] = {}
    for number, (name, data) in enumerate(sorted(info.attachments.items())):
        # Names come from a file: only their last part, and each in its own folder.
        own_folder = folder / "files" / str(number)
        own_folder.mkdir(parents=True)
        files[name] = own_folder / (PurePosixPath(name.replace("\\", "/")).name or "file")
        files[name].write_bytes(data)
    urdf = folder / "robot.urdf"
    urdf.write_text(info.urdf, encoding="utf-8")
    robot = load_robot(urdf)
    # Meshes are sought where they were when the log was written.
    robot = replace(robot, path=Path(info.urdf_path).with_suffix(".urdf") if info.urdf_path else urdf)
    # Claims do not change a run, and may name recordings that are not here.
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


def _load_plugins(reader: LogReader, folder: Path, plugins: Sequence[str | Path], *, trust: bool) -> None:
    from asrsim.actuators import ACTUATORS
    from asrsim.actuators.user import load_plugin_file

    for path in one_or_more(plugins):
        load_plugin_file(path)
    carried = {name: data for name, data in reader.info.attachments.items() if name.startswith(PLUGINS)}
    if plugins or not carried or all(joint.actuator in (*ACTUATORS.names(), "rigid") for joint in reader.info.joints):
        return
    if not trust:
        names = ", ".join(name.removeprefix(PLUGINS) for name in carried)
        message = f"the run needs actuators of the user's own, whose Python code the log carries ({names})"
        hint = "Run that code with --trust-plugins if you trust the log's author, or name your own file with --plugin"
        raise ActuatorError(message, file=reader.path, hint=hint, code="plugin-code")
    for number, (name, data) in enumerate(carried.items()):
        path = folder / "plugins" / str(number) / (PurePosixPath(name).name or "plugin.py")
        path.parent.mkdir(parents=True)
        path.write_bytes(data)
        load_plugin_file(path)
