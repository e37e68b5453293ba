"""The folder of a run: its files, and the rule that keeps what others wrote.

What an earlier run of the same scenario file and variant left is replaced: that is what one does all day, and the caller says
what was replaced. Only what its name and its mark (:mod:`asrsim.outfile`) prove to be a run's is ever taken away.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from asrsim.document.mistaken import mistaken
from asrsim.errors import AsrsimError, InputError, LogError, OutputError, Problem, listed
from asrsim.outfile import check_output, is_special, remove_ours
from asrsim.scenario.data import Scenario

LOG = "log.mcap"
SUMMARY = "summary.json"
ASIDE = "log.mcap.part"
"""The log of a run that has an earlier one to replace, until it ends."""

_NAMES = {
    re.escape(LOG): "log",
    re.escape(ASIDE): "log",
    re.escape(SUMMARY): "json",
    r"report\.html": "page",
    r"(joints|joints_\d+|energy|overview|objects)\.(png|pdf|svg)": "picture",
}
"""Names (regular expressions) of all that `asrsim run` writes -> kind of file."""


def default_folder(scenario: Scenario) -> Path:
    """Default folder of a run of this variant: `out/<scenario>/<variant>`."""
    return Path("out") / scenario.name / scenario.variant


def origin_of(scenario: Scenario) -> str:
    """The scenario file that a run comes from, as its log keeps it: absolute; empty for one without a file."""
    return str(scenario.path.resolve()) if scenario.path else ""


def recorded_origin(path: Path) -> tuple[Any, Any] | None:
    """Scenario file and variant that a summary, or another JSON file of ours, names; None where it names none."""
    with suppress(OSError, ValueError, KeyError, TypeError):
        data = json.loads(path.read_text(encoding="utf-8"))
        return data["scenario_path"], data["variant"]
    return None


def require_same(folder: Path, scenario: Scenario, origin: tuple[Any, Any] | None, unnamed: str) -> None:
    """Raises OutputError unless a folder's results come from this scenario and variant; unnamed: what is said where they name
    none."""
    own = origin_of(scenario), scenario.variant
    if origin == own:
        return
    other = unnamed
    if origin is not None:
        path = origin[0] or "a scenario without file"
        other = path if origin[1] == own[1] else f"variant '{origin[1]}' of {path}"
    raise OutputError(
        f"{folder}: holds the results of another run ({other}); nothing was written. "
        "Choose another folder with --out, or replace them with --overwrite"
    )


def find_logs(place: Path) -> list[Path]:
    """The log itself, or a folder's logs: its own, else those of its subfolders (variants), in the scenario's order.

    Of several those that cannot be read are left out (:func:`unreadable_logs`). Raises InputError where there is none.
    """
    if place.is_file():
        return [place]
    logs = _logs_in(place)
    if not logs:
        message, hint = "no such file or folder", "Run a scenario first: asrsim run scenario.yaml"
        if place.is_dir():
            message = "holds no log of a run (log.mcap), nor does a folder in it"
            other = mistaken(place, "log")
            if other is not None and not any(place.glob(f"*/*/{LOG}")):
                raise InputError([other])
            # Of a study with logs, or of several scenarios.
            deeper = sorted({log.parent.parent for log in place.glob(f"*/*/{LOG}")})
            hint = f"Folders further down have some: {listed(deeper, 3)}" if deeper else hint
        raise InputError(message, file=place, hint=hint, code="no-log")
    bad = {problem.file for problem in unreadable_logs(place)}
    logs = [log for log in logs if log not in bad]
    return sorted(logs, key=_order(logs)) if len(logs) > 1 else logs


def unreadable_logs(place: Path) -> list[Problem]:
    """What is wrong with those of a folder's logs that cannot be read or hold no samples (a run was stopped before its first
    sample was written), where others do."""
    from asrsim.log import open_log

    logs = [] if place.is_file() else _logs_in(place)
    problems: list[Problem] = []
    for log in logs if len(logs) > 1 else ():
        try:
            # The times of the first chunk are enough.
            if next(open_log(log).iter_samples(quantities=[], joints=[]), None) is None:
                problems.append(Problem("left out: the log holds no samples", file=log, code="empty-log"))
        except LogError as error:
            problems.append(Problem(f"left out: {error.problems[0].message}", file=log, code="unreadable-log"))
    return problems if len(problems) < len(logs) else []


def _logs_in(place: Path) -> list[Path]:
    own = [place / LOG] if (place / LOG).is_file() else sorted(place.glob("*.mcap"))
    return own or sorted(place.glob(f"*/{LOG}"))


def _order(logs: list[Path]) -> Callable[[Path], tuple[float, str]]:
    """Key that sorts logs as their scenario lists its variants; those that it does not list come last."""
    from asrsim.document.yaml_reader import parse_yaml
    from asrsim.log import open_log

    places: dict[Path, float] = {}
    for log in logs:
        places[log] = math.inf
        # A log that cannot be read complains later, where it is read.
        with suppress(AsrsimError):
            info = open_log(log).info
            scenario = parse_yaml(info.scenario).plain()
            listed = scenario.get("variants") if isinstance(scenario, dict) else None
            names = list(listed) if isinstance(listed, dict) else []
            places[log] = names.index(info.variant) if info.variant in names else math.inf
    return lambda log: (places[log], str(log))


def inputs_of(scenario: Scenario) -> tuple[Path, ...]:
    """Every file that a run of the scenario reads by name."""
    recordings = (claim.against for claim in scenario.expect)
    files = (scenario.path, scenario.robot, *scenario.attachments.values(), *recordings)
    return tuple(file for file in files if file is not None)


def open_folder(folder: Path, scenario: Scenario, *, overwrite: bool, inputs: Sequence[Path] = ()) -> tuple[Path, ...]:
    """Look what the folder holds, and whether a run of this scenario may write there.

    inputs: what the command reads beside the scenario's files. Returns the files of an earlier run of the same scenario and
    variant, with `overwrite` of any run: :func:`new_log` takes them away.
    Raises OutputError if it holds something else under a name that we need, or a file that this run reads.
    """
    there = sorted(path for path in folder.iterdir() if not is_special(path)) if folder.is_dir() else []
    files = {path: kind for path in there if (kind := _kind(path.name))}
    names = {folder / LOG: "log", folder / SUMMARY: "json", **files}
    for path, kind in names.items():
        check_output(path, kind, inputs=(*inputs, *inputs_of(scenario)))
    if files and not overwrite:
        require_same(folder, scenario, *_found(folder))
    return tuple(path for path in files if path.name != ASIDE)


def clear(files: Iterable[Path]) -> None:
    """Take away an earlier run's files, so that none of them stands beside the new run's."""
    for path in files:
        remove_ours(path, _kind(path.name))


@contextmanager
def new_log(folder: Path, earlier: Sequence[Path]) -> Iterator[Path]:
    """Where to write a run's log; when the block ends without error it is `log.mcap`, and the earlier run's files are gone.

    Where there is an earlier log the new one is written aside until then; if the block raises, the earlier one stays.
    Raises OutputError.
    """
    log, aside = folder / LOG, folder / ASIDE
    # A killed run may have left its unfinished log.
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
    """Scenario file and variant that the folder's files come from, and what to say where they do not tell."""
    from asrsim.log import open_log

    if (folder / LOG).is_file() and (folder / LOG).stat().st_size:
        try:
            info = open_log(folder / LOG).info
        except AsrsimError:
            return None, f"{LOG} cannot be read"
        return (info.scenario_path, info.variant), ""
    return recorded_origin(folder / SUMMARY), f"neither {LOG} nor {SUMMARY} says which"
