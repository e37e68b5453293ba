"""Words that the shell completes: variants, joints and quantities, and keys, read from the files named on the command line.

A file that cannot be read gives no words, so that completion never fails.
"""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any


def variants(incomplete: str) -> list[str]:
    """Variants of the scenario on the command line."""
    found = _plain().get("variants")
    return _beginning(found if isinstance(found, Mapping) else (), incomplete)


def joints(incomplete: str) -> list[str]:
    """Joints of the first log on the command line."""
    return _beginning((joint.name for joint in _logged()), incomplete)


def quantities(incomplete: str) -> list[str]:
    """Quantities of the first log on the command line."""
    return _beginning((name for joint in _logged() for name in joint.quantities), incomplete)


def actuators(incomplete: str) -> list[str]:
    """Names of all actuators."""
    from asrsim.actuators import ACTUATORS

    return _beginning(ACTUATORS.names(), incomplete)


def measures(incomplete: str) -> list[str]:
    """Names of all measures."""
    from asrsim.metrics import MEASURES

    return _beginning(MEASURES.names(), incomplete)


def figures(incomplete: str) -> list[str]:
    """Names of all figures that `asrsim plot` can draw."""
    from asrsim.plots import FIGURES

    return _beginning(FIGURES.names(), incomplete)


def robot_keys(incomplete: str) -> list[str]:
    """Keys of the robot's numbers that can be identified or varied."""
    from asrsim.errors import AsrsimError
    from asrsim.identification.parameters import parameters_of
    from asrsim.scenario import apply_to_robot, load_scenario
    from asrsim.scenario.check import robot_of

    try:
        scenario = load_scenario(_path())[0]
        robot = apply_to_robot(scenario, robot_of(scenario))
    except (AsrsimError, OSError):
        return []
    return _beginning(parameters_of(robot, (), {}), incomplete)


def _beginning(names: Iterable[object], incomplete: str) -> list[str]:
    return [text for text in dict.fromkeys(map(str, names)) if text.startswith(incomplete)]


def _path() -> Path:
    """First existing file or folder on the command line that is being completed. The shells pass this line in environment
    variables.

    The parser cannot be used, since it gives no arguments for a line that ends in an option without a value.
    """
    line = os.environ.get("COMP_WORDS") or os.environ.get("_TYPER_COMPLETE_ARGS") or ""
    try:
        words = shlex.split(line, posix=True)
    except ValueError:
        words = line.split()
    places = [Path(word) for word in words[2:] if not word.startswith("-")]
    return next((place for place in places if place.exists()), Path("/"))


def _plain() -> Mapping[str, Any]:
    from asrsim.document.yaml_reader import read_yaml
    from asrsim.errors import AsrsimError

    try:
        data = read_yaml(_path())[0].plain()
    except (AsrsimError, OSError):
        return {}
    return data if isinstance(data, Mapping) else {}


def _logged() -> tuple[Any, ...]:
    from asrsim.errors import AsrsimError
    from asrsim.log import open_log
    from asrsim.runs.folder import find_logs

    try:
        logs, _ = find_logs(_path())
        return open_log(logs[0]).info.joints
    except (AsrsimError, OSError):
        return ()
