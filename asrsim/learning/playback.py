"""A scenario that plays the learned input, for `asrsim run`, and claims what was learned."""

from __future__ import annotations

import os
from collections.abc import Sequence
from math import ceil, floor, log10
from pathlib import Path
from typing import Any

from asrsim.learning.plant import Plant
from asrsim.outfile import write_text
from asrsim.plain import mapped
from asrsim.scenario.joint_keys import INVERSE_DYNAMICS

DIGITS = 3
"""Of a claimed error, rounded up: a replay on the same plant repeats it bit for bit, on another one it fails."""


def playback_data(
    plant: Plant, inputs: Path, folder: Path, *, largest: Sequence[float] = (), desired: Path | None = None
) -> dict[str, Any]:
    """The scenario as plain data: the learned one's, with its inputs played back from the CSV file `inputs`.

    Paths count from `folder`, where the scenario is to stand. It claims that the error of every joint against the motion in
    `desired` stays, over the whole time, within `largest` (rad, by joint), which was learned.
    """
    scenario = plant.scenario
    files = {name: os.path.relpath(path, folder) for name, path in scenario.attachments.items()}
    data: dict[str, Any] = mapped(scenario.resolved, lambda value: files.get(value, value) if isinstance(value, str) else value)
    robot = os.path.relpath(scenario.robot, folder)
    data["robot"] = {**data["robot"], "file": robot} if isinstance(data.get("robot"), dict) else robot
    learned = data.pop("ilc", {})
    for key in ("variant", "expect"):
        data.pop(key, None)
    # Two arms' learned inputs are played into two folders.
    variant = [scenario.variant] if scenario.variant != "default" else []
    data["name"] = "_".join([scenario.name, *variant, inputs.stem])
    # The error of a replay is that against what was to be learned.
    data["desired"] = learned.get("trajectory", {})
    data["references"] = {joint: dict(signals) for joint, signals in data.get("references", {}).items()}
    # What the entry for all joints says holds name by name.
    common = data["references"].pop("*", {})
    for joint, drive in zip(plant.joints, plant.drives, strict=True):
        names = drive.mode.references
        own = data["references"].setdefault(joint, {})
        own.pop(INVERSE_DYNAMICS, None)
        own[names[0]] = {"playback": {"file": os.path.relpath(inputs, folder), "column": joint}}
        if joint in plant.presets:
            own[names[1]] = {"playback": {"file": os.path.relpath(inputs, folder), "column": f"{joint}.{names[1]}"}}
        if common.get(INVERSE_DYNAMICS):
            own[INVERSE_DYNAMICS] = False
    # Without what every joint has of its own, which would do nothing.
    missed = {
        name
        for drive in plant.prepared.drives if drive.mode
        for name in (*drive.mode.references, INVERSE_DYNAMICS) if name not in data["references"].get(drive.name, {})
    }  # fmt: skip
    left = {name: signal for name, signal in common.items() if name in missed}
    data["references"] = ({"*": left} if left else {}) | data["references"]
    if desired is not None:
        if not plant.prepared.stepping.released:
            # Those of the trials: a replay repeats them bit for bit.
            resolution = plant.prepared.resolution
            data |= {"substeps": resolution.substeps, "motor_substeps": resolution.motor_substeps}
        data["expect"] = [
            {
                "joint": joint,
                "quantity": "link_position",
                "measure": "maximum_error",
                "comparison": "<=",
                "value": rounded_up(error),
                "against": os.path.relpath(desired, folder),
                "options": {"lag": "off"},
            }
            for joint, error in zip(plant.joints, largest, strict=True)
        ]
    return data


def write_playback(
    path: Path, plant: Plant, inputs: Path, *, largest: Sequence[float] = (), desired: Path | None = None
) -> None:
    """Write the scenario of :func:`playback_data` to `path`. Raises OutputError where it cannot be written."""
    import yaml

    text = f"# Plays what `asrsim ilc` found; the inputs are in {inputs.name}.\n"
    data = playback_data(plant, inputs, path.parent, largest=largest, desired=desired)
    write_text(path, text + yaml.safe_dump(data, sort_keys=False, allow_unicode=True), "learned scenario")


def rounded_up(value: float) -> float:
    """The value to some digits, never below it."""
    if value <= 0.0:
        return 0.0
    places = DIGITS - 1 - floor(log10(value))
    return float(round(ceil(value * 10.0**places) / 10.0**places, max(places, 0)))
