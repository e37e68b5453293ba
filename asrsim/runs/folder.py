"""Folder of a run: finds the run's files, and protects other files in the folder.

A run replaces the files of an earlier run of the same scenario file and variant; the caller reports the replaced files. A file
is removed only if its name and its mark (`asrsim.outfile`) show that a run wrote it.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from asrsim.document.file import mistaken
from asrsim.errors import AsrsimError, InputError, LogError, OutputError, Problem, listed
from asrsim.outfile import check_output, is_special, remove_ours
from asrsim.scenario.data import Scenario

LOG = "log.mcap"
SUMMARY = "summary.json"
ASIDE = "log.mcap.part"
"""Name that a log has until its run ends, if the log will replace an earlier log."""

_NAMES = {
    re.escape(LOG): "log",
    re.escape(ASIDE): "log",
    re.escape(SUMMARY): "json",
    r"report\.html": "page",
    r"((joints|objects)(_\d+)?|energy|overview)\.(png|pdf|svg)": "picture",
}
"""Kinds of the files that `asrsim run` writes, each by a regular expression for the names of these files."""


def default_folder(scenario: Scenario) -> Path:
    """Default folder for a run of this scenario's variant: `out/<scenario>/<variant>`."""
    return Path("out") / scenario.name / scenario.variant


def origin_of(scenario: Scenario) -> str:
    """Absolute path of the scenario file, as stored in the log; "" for a scenario without a file."""
    return str(scenario.path.resolve()) if scenario.path else ""


def recorded_origin(path: Path) -> tuple[Any, Any] | None:
    """Scenario file and variant that a summary or another JSON file of asrsim states; None if one of them is missing."""
    with suppress(OSError, ValueError, KeyError, TypeError):
        data = json.loads(path.read_text(encoding="utf-8"))
        return data["scenario_path"], data["variant"]
    return None


def require_same(folder: Path, scenario: Scenario, origin: tuple[Any, Any] | None, unnamed: str) -> None:
    """Raise OutputError unless the results in a folder belong to this scenario and variant.

    origin: scenario file and variant of the results; None: unknown. unnamed: reason for the message if the origin is unknown.
    """
    own = origin_of(scenario), scenario.variant
    if origin == own:
        return
    other = unnamed
    if origin is not None:
        path = origin[0] or "a scenario without file"
        other = path if origin[1] == own[1] else f"variant '{origin[1]}' of {path}"
    raise OutputError(
        f"{folder}: contains the results of another run ({other}); nothing was written. "
        "Choose another folder with --out, or replace the results with --overwrite"
    )


def find_logs(place: Path) -> tuple[list[Path], list[Problem]]:
    """Logs at a path, and problems of the logs that are left out. The path may be a log, the folder of a log, or a folder whose
    subfolders contain the logs of variants, which are returned in the scenario's order.

    Unreadable and empty logs are left out if there is a readable log. Raises InputError if there is no log.
    """
    if place.is_file():
        return [place], []
    logs = [place / LOG] if (place / LOG).is_file() else sorted(place.glob("*.mcap")) or sorted(place.glob(f"*/{LOG}"))
    if not logs and not place.exists() and (place.parent / LOG).is_file():
        # The user may have named a subfolder of the folder with the log. With --out and one variant, there are no subfolders.
        hint = f"The folder above contains a log: {place.parent}"
        raise InputError("no such file or folder", file=place, hint=hint, code="no-log")
    if not logs:
        message, hint = "no such file or folder", "Run a scenario first: asrsim run scenario.yaml"
        if place.is_dir():
            message = "contains no log (log.mcap), and neither do its subfolders"
            other = mistaken(place, "log")
            if other is not None and not any(place.glob(f"*/*/{LOG}")):
                raise InputError([other])
            # The folder may contain the folders of several scenarios, so look for logs one level deeper.
            deeper = sorted({log.parent.parent for log in place.glob(f"*/*/{LOG}")})
            hint = f"Deeper folders contain logs: {listed(deeper, 3)}" if deeper else hint
        raise InputError(message, file=place, hint=hint, code="no-log")
    problems = [problem for log in logs for problem in _faults(log)] if len(logs) > 1 else []
    if len(problems) == len(logs):
        return logs, []
    bad = {problem.file for problem in problems}
    logs = [log for log in logs if log not in bad]
    variants = _variants_of(logs[0]) if len(logs) > 1 else []
    # The folder of a variant has the variant's name. Folders with other names come last.
    return sorted(logs, key=lambda log: [*variants, log.parent.name].index(log.parent.name)), problems


def _faults(log: Path) -> Iterator[Problem]:
    """A problem if the log is unreadable, or if it has no samples because its run was stopped before the first sample was
    written."""
    from asrsim.log import open_log

    try:
        # Read only the times of the first chunk, which show whether there are samples.
        if next(open_log(log).iter_samples(quantities=[], joints=[]), None) is None:
            yield Problem("left out: the log contains no samples", file=log, code="empty-log")
    except LogError as error:
        yield Problem(f"left out: {error.problems[0].message}", file=log, code="unreadable-log")


def _variants_of(log: Path) -> list[str]:
    """Names of all variants in the scenario of a log, in the scenario's order; empty if the log cannot be read."""
    from asrsim.document.yaml_reader import parse_yaml
    from asrsim.log import open_log

    with suppress(AsrsimError):
        scenario = parse_yaml(open_log(log).info.scenario).plain()
        if isinstance(scenario, dict) and isinstance(scenario.get("variants"), dict):
            return list(scenario["variants"])
    return []


def inputs_of(scenario: Scenario) -> tuple[Path, ...]:
    """All files that a run of the scenario reads."""
    recordings = (claim.against for claim in scenario.expect)
    files = (scenario.path, scenario.robot, *scenario.attachments.values(), *recordings)
    return tuple(file for file in files if file is not None)


def open_folder(folder: Path, scenario: Scenario, *, overwrite: bool) -> tuple[Path, ...]:
    """Files of an earlier run in the folder, which `new_log` will remove.

    Raises OutputError if the folder contains results of another scenario or variant and `overwrite` is not given. Also raises
    OutputError if a file whose name the run needs was not written by asrsim, or is an input file of this run.
    """
    there = sorted(path for path in folder.iterdir() if not is_special(path)) if folder.is_dir() else []
    files = {path: kind for path in there if (kind := _kind(path.name))}
    names = {folder / LOG: "log", folder / SUMMARY: "json", **files}
    for path, kind in names.items():
        check_output(path, kind, inputs=inputs_of(scenario))
    if files and not overwrite:
        require_same(folder, scenario, *_found(folder))
    return tuple(path for path in files if path.name != ASIDE)


def folder_problems(scenarios: Sequence[Scenario], folder_of: Callable[[Scenario], Path], *, overwrite: bool) -> list[Problem]:
    """Reasons why runs of these variants cannot write their results into their folders."""
    found = []
    for one in scenarios:
        folder = folder_of(one)
        there = next(path for path in (folder, *folder.absolute().parents) if path.exists())
        try:
            if not there.is_dir() or not os.access(there, os.W_OK):
                raise OutputError(f"{there}: results cannot be written here")
            open_folder(folder, one, overwrite=overwrite)
        except OutputError as error:
            found.append(Problem(str(error), code="output"))
    return found


def clear(files: Iterable[Path]) -> None:
    """Remove the files of an earlier run, so that they are not mixed with the files of the new run."""
    for path in files:
        remove_ours(path, _kind(path.name))


@contextmanager
def new_log(folder: Path, earlier: Sequence[Path]) -> Iterator[Path]:
    """Path for writing a run's log. When the block ends without error, the log gets the name `log.mcap` and replaces the files
    in `earlier`.
    Without an earlier log, the path has this name from the beginning. If the block raises an error, an earlier log is kept.
    Raises OutputError.
    """
    log, aside = folder / LOG, folder / ASIDE
    # Remove the unfinished log that a killed run may have left.
    clear([aside])
    path = aside if log in earlier else log
    try:
        yield path
    except BaseException:
        if path == aside:
            clear([aside])
        raise
    clear(one for one in earlier if one != path)
    if path == aside:
        try:
            aside.replace(log)
        except OSError as error:
            raise OutputError(f"{log}: cannot be replaced: {error.strerror or error}; the new log is {aside}") from error


def _kind(name: str) -> str:
    return next((kind for pattern, kind in _NAMES.items() if re.fullmatch(pattern, name)), "")


def _found(folder: Path) -> tuple[tuple[Any, Any] | None, str]:
    """Scenario file and variant of the results in the folder (None if unknown), and the reason why they are unknown."""
    from asrsim.log import read_origin

    if (folder / LOG).is_file() and (folder / LOG).stat().st_size:
        try:
            return read_origin(folder / LOG), ""
        except AsrsimError:
            return None, f"{LOG} cannot be read"
    return recorded_origin(folder / SUMMARY), f"neither {LOG} nor {SUMMARY} names its scenario"
