"""The folder of a run: its files, and the rule that keeps the results of other runs.

A folder that holds a log of the same scenario file and variant is written anew: that is what one does all day, and the
caller says what was replaced. A folder that holds anything else with the name of our log is left alone unless asked for.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from asrsim.errors import AsrsimError, InputError, OutputError, Problem
from asrsim.scenario.data import Scenario

LOG = "log.mcap"
SUMMARY = "summary.json"


def default_folder(scenario: Scenario) -> Path:
    """Where a run of this variant goes unless told otherwise: `out/<scenario>/<variant>`."""
    return Path("out") / scenario.name / scenario.variant


def find_logs(place: Path) -> list[Path]:
    """The log itself, or a folder's logs: its own, else those of its subfolders (variants), in the scenario's order.

    Raises InputError where there is none.
    """
    if place.is_file():
        return [place]
    own = [place / LOG] if (place / LOG).is_file() else sorted(place.glob("*.mcap"))
    logs = own or sorted(place.glob(f"*/{LOG}"))
    if not logs:
        message = "no such file or folder"
        if place.is_dir():
            message = "holds no log of a run (log.mcap), nor does a folder in it"
        hint = "Run a scenario first: asrsim run scenario.yaml"
        raise InputError(Problem(message=message, file=place, hint=hint, code="no-log"))
    return sorted(logs, key=_order(logs)) if len(logs) > 1 else logs


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


def open_folder(folder: Path, scenario: Scenario, *, overwrite: bool = False) -> tuple[Path, ...]:
    """Make the folder, and check that it may be written.

    Returns the files of an earlier run of the same scenario and variant, which :func:`clear` takes away.
    Raises OutputError if it cannot be made or holds the results of another run.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: cannot make the folder: {error.strerror or error}") from error
    earlier = _files(folder)
    if earlier and not overwrite:
        other = _other_run(folder / LOG, scenario)
        if other:
            raise OutputError(
                f"{folder}: holds the results of another run ({other}); nothing was written. "
                "Choose another folder with --out, or replace them with --overwrite"
            )
    return earlier


def clear(files: tuple[Path, ...]) -> None:
    """Take away an earlier run's files, so that none of them stands beside the new run's."""
    for path in files:
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            raise OutputError(f"{path}: cannot replace it: {error.strerror or error}") from error


def _files(folder: Path) -> tuple[Path, ...]:
    """Files of an earlier run: its log, its summary, and what the summary says it wrote here."""
    found = [path for path in (folder / LOG, folder / SUMMARY) if path.is_file()]
    with suppress(OSError, ValueError, AttributeError, TypeError):
        listed = json.loads((folder / SUMMARY).read_text(encoding="utf-8"))["files"].values()
        for entry in listed:
            for name in entry if isinstance(entry, list) else [entry]:
                # Only what lies here: a summary that was copied from elsewhere must not reach out.
                path = folder / Path(name).name
                if path.is_file() and not path.is_symlink() and path not in found:
                    found.append(path)
    return tuple(found)


def _other_run(log: Path, scenario: Scenario) -> str:
    """Which other run the log comes from; empty if it is an earlier one of this scenario and variant."""
    from asrsim.log import open_log

    if not log.is_file():
        return ""
    try:
        info = open_log(log).info
    except AsrsimError:
        return f"{log.name} that is no log of asrsim"
    if info.variant != scenario.variant:
        return f"variant '{info.variant}' of {info.scenario_path or 'a scenario without file'}"
    same = info.scenario_path == str(scenario.path or "")
    if not same and info.scenario_path and scenario.path is not None:
        same = Path(info.scenario_path).resolve() == scenario.path.resolve()
    return "" if same else (info.scenario_path or "a scenario without file")
