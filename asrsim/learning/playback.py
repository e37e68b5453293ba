"""A scenario that plays the learned input, for `asrsim run`."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from asrsim.actuators import MODES
from asrsim.learning.plant import Plant
from asrsim.learning.settings import LearningSettings
from asrsim.outfile import write_text


def playback_data(plant: Plant, settings: LearningSettings, inputs: Path, folder: Path) -> dict[str, Any]:
    """The scenario as plain data: the learned one's, with its inputs played back from the CSV file `inputs`.

    Paths count from `folder`, where the scenario is to stand. It claims that every joint ends within the tolerance.
    """
    scenario = plant.scenario
    files = {name: os.path.relpath(path, folder) for name, path in scenario.attachments.items()}
    data: dict[str, Any] = _renamed(dict(scenario.resolved), files)
    robot = os.path.relpath(scenario.robot, folder)
    data["robot"] = {**data["robot"], "file": robot} if isinstance(data.get("robot"), dict) else robot
    learned = data.pop("ilc", {})
    for key in ("name", "variant"):
        data.pop(key, None)
    # The error of a replay is that against what was to be learned.
    data["desired"] = learned.get("trajectory", {})
    data["references"] = {joint: dict(signals) for joint, signals in data.get("references", {}).items()}
    for joint, drive in zip(plant.joints, plant.drives, strict=True):
        name = MODES[drive.mode].references[0]
        signal = {"playback": {"file": os.path.relpath(inputs, folder), "column": joint}}
        data["references"].setdefault(joint, {})[name] = signal
    data["expect"] = [
        {
            "joint": joint,
            "quantity": "link_position",
            "measure": "final",
            "value": float(goal),
            "tolerance": settings.tolerance,
        }
        for joint, goal in zip(plant.joints, plant.reference[-1], strict=True)
    ]
    return data


def write_playback(path: Path, plant: Plant, settings: LearningSettings, inputs: Path) -> None:
    """Write the scenario of :func:`playback_data` to `path`. Raises OutputError where it cannot be written."""
    import yaml

    text = f"# Plays what `asrsim ilc` learned; the inputs are in {inputs.name}.\n"
    text += yaml.safe_dump(playback_data(plant, settings, inputs, path.parent), sort_keys=False, allow_unicode=True)
    write_text(path, text, "learned scenario")


def _renamed(value: Any, files: dict[str, str]) -> Any:
    """Plain data with the names of files replaced."""
    if isinstance(value, dict):
        return {key: _renamed(item, files) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_renamed(item, files) for item in value]
    return files.get(value, value) if isinstance(value, str) else value
