"""Repeats a run from its log alone, and compares the samples bit for bit."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import Any

from asrsim.errors import ActuatorError, DivergenceError, InputError, LogError
from asrsim.log import LogReader, open_log
from asrsim.plain import one_or_more
from asrsim.plugins import load_plugin_file
from asrsim.progress import Stop, Tell
from asrsim.robot import Robot, load_robot
from asrsim.runs.compare import Comparer, Difference
from asrsim.runs.described import LIVE, UNREPEATABLE
from asrsim.runs.execute import INPUTS
from asrsim.samples import RunInfo
from asrsim.scenario import Scenario, scenario_from_data
from asrsim.scenario.carried import missing_plugins
from asrsim.scenario.digest import mesh_hashes
from asrsim.scenario.load import PLUGINS
from asrsim.simulation.run import Run, simulate


@dataclass(frozen=True, kw_only=True)
class Repetition:
    """Result of repeating a run and comparing it with its log."""

    path: Path
    variant: str
    logged_status: str
    """Status of the run according to its log, such as complete, interrupted, diverged or truncated."""
    status: str
    """Status of the repeated run."""
    logged_samples: int
    """Number of samples in the log; for a partial comparison, number of samples that were compared."""
    samples: int
    """Number of samples that were compared."""
    missing: int
    """Number of samples in the log that the repeated run did not reach."""
    differences: tuple[Difference, ...]
    """Series that differ, in the order of their first differences."""
    partial: bool
    """Whether the comparison was stopped before the end of the log."""
    versions: Mapping[str, tuple[str, str]]
    """Version at the time of the run and installed version of each library whose version has changed since the run, by
    library."""
    changed: tuple[str, ...] = ()
    """Files of meshes that have changed since the run. All other inputs cannot change, since they are in the log."""

    @property
    def identical(self) -> bool:
        """Whether every logged sample was repeated bit for bit."""
        return not self.differences and not self.missing and self.samples > 0 and not self.partial

    def as_dict(self) -> dict[str, Any]:
        """Fields of the result as plain values for JSON."""
        plain = {name: value for name, value in vars(self).items() if isinstance(value, str | int)}
        return {
            "ok": self.identical,
            "identical": self.identical,
            "log": str(self.path),
            **plain,
            "differences": [difference.as_dict() for difference in self.differences],
            "versions": {name: list(pair) for name, pair in self.versions.items()},
            "changed": list(self.changed),
        }


def rerun(
    path: str | Path,
    *,
    plugins: Sequence[str | Path] = (),
    trust_plugins: bool = False,
    progress: Tell | None = None,
    stop: Stop | None = None,
) -> Repetition:
    """Repeat the run of a log, and compare every sample.

    Scenario, robot and attached files are read from the log; only meshes are read from their files. The log of an interrupted,
    killed or diverged run is compared up to its last sample. The required memory does not grow with the length of the log.

    Args:
        path: Path of the log.
        plugins: Python files with users' actuators, which are run instead of the files in the log.
        trust_plugins: Whether the Python files that the log contains are run.
        progress: Function that is called with the progress of the repeated run.
        stop: Function that is called often; the comparison ends early when it returns True.

    Raises:
        LogError: The file is damaged or not a log of asrsim.
        ActuatorError: The run needs plugin files in the log, and neither `plugins` nor `trust_plugins` is given.
        InputError, SimulationError: The run cannot be built from its log any more.
    """
    reader = open_log(path)
    if UNREPEATABLE in reader.metadata:
        message = f"the run cannot be repeated: the log lacks changes of the run ({reader.metadata[UNREPEATABLE]})"
        raise LogError(message, file=reader.path, code="unrepeatable")
    comparer = Comparer(reader)

    def ended() -> bool:
        return (reader.status != "complete" and comparer.exhausted) or (stop is not None and stop())

    # A repeated live run lasts as long as its log, and receives the recorded commands.
    live = LIVE in reader.metadata
    with TemporaryDirectory(prefix="asrsim-rerun-") as temporary:
        _load_plugins(reader, Path(temporary), plugins, trust=trust_plugins)
        try:
            with _wanting_plugins(reader):
                scenario, robot = restore(reader.info, Path(temporary))
                run = simulate(
                    scenario,
                    robot,
                    sinks=[comparer],
                    keep=False,
                    progress=progress,
                    stop=ended,
                    commands=reader.commands() if live else (),
                    duration=_whole_steps(reader) if live else None,
                )
        except DivergenceError as error:
            # Compare a run that diverges like any other run, since the logged run may have diverged, too.
            if not isinstance(error.run, Run):
                raise
            run = error.run
    before = json.loads(reader.metadata.get(INPUTS, "{}"))
    now = mesh_hashes(scenario, robot) if before else {}
    changed = tuple(name for name, digest in now.items() if before.get(name) != digest)
    return _repetition(reader, run, comparer, changed)


def _repetition(reader: LogReader, run: Run, comparer: Comparer, changed: tuple[str, ...]) -> Repetition:
    """Result of comparing a repeated run with its log."""
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
        partial=stopped,
        differences=comparer.differences,
        versions={
            name: (there[name], here[name])
            for name in ("asrsim", "engine_version", "numpy")
            if name in there and name in here and there[name] != here[name]
        },
        changed=changed,
    )


def _whole_steps(reader: LogReader) -> float:
    """Duration of the log in whole steps, s; its last chunk may contain a command after the last sample."""
    step = reader.info.step
    return max(1, math.floor(reader.duration / step + 1e-6)) * step


def restore(info: RunInfo, folder: Path) -> tuple[Scenario, Robot]:
    """Scenario and robot from the description in a log. The files that they need are written into `folder`.

    Raises LogError if the log contains no scenario, and InputError if scenario or robot cannot be read any more.
    """
    if "scenario" not in info.resolved:
        raise LogError("the log contains no scenario, so the run cannot be repeated", code="no-scenario")
    files = unpacked(info.attachments, folder / "files")
    urdf = folder / "robot.urdf"
    urdf.write_text(info.urdf, encoding="utf-8")
    # Leave out claims, since they do not change a run and may refer to recordings that do not exist on this computer.
    keys = {key: value for key, value in info.resolved["scenario"].items() if key != "expect"}
    named = keys["robot"]["file"] if isinstance(keys["robot"], Mapping) else keys["robot"]
    scenario = scenario_from_data(
        keys,
        base_dir=Path(info.scenario_path).parent if info.scenario_path else folder,
        files={**files, str(named): urdf},
        name=Path(info.scenario_path).stem if info.scenario_path else "scenario",
        variant=info.variant,
    )
    robot = load_robot(urdf, locked=scenario.locked)
    # Read meshes from the folder that contained them when the log was written.
    robot = replace(robot, path=Path(info.urdf_path).with_suffix(".urdf") if info.urdf_path else urdf)
    plugins = {name: path for name, path in files.items() if name.startswith(PLUGINS)}
    path = Path(info.scenario_path) if info.scenario_path else None
    return replace(scenario, path=path, attachments={**scenario.attachments, **plugins}), robot


def unpacked(attachments: Mapping[str, bytes], folder: Path) -> dict[str, Path]:
    """Write the attachments of a log into `folder`. Returns their paths by their names in the log."""
    files: dict[str, Path] = {}
    for name, content in attachments.items():
        parts = PurePosixPath(name.replace("\\", "/")).parts
        # Reject paths outside the folder, since the names are from a file that is not trusted.
        if not parts or ".." in parts or PurePosixPath(name).is_absolute():
            continue
        path = folder.joinpath(*parts)
        with suppress(OSError, ValueError):  # if the system does not allow the name, the scenario lacks the file
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
            files[name] = path
    return files


def _load_plugins(reader: LogReader, folder: Path, plugins: Sequence[str | Path], *, trust: bool) -> None:
    """Run the plugin files that are given, or, with `trust`, the plugin files in the log."""
    carried = {name: data for name, data in reader.info.attachments.items() if trust and name.startswith(PLUGINS)}
    for path in one_or_more(plugins) or unpacked(carried, folder / "plugins").values():
        load_plugin_file(path)


@contextmanager
def _wanting_plugins(reader: LogReader) -> Iterator[None]:
    """Convert InputErrors to an ActuatorError if the log contains plugin files that have not run."""
    try:
        yield
    except InputError as error:
        missing = missing_plugins(reader.info.attachments)
        if isinstance(error, LogError) or not missing:
            raise
        message = f"the run needs plugin files, whose Python code is in the log ({', '.join(missing)})"
        hint = "Run this code with --trust-plugins if you trust the log's author, or give your copy of the file with --plugin"
        raise ActuatorError(message, file=reader.path, hint=hint, code="plugin-code") from error
