"""Files of learned inputs: a CSV file, and a scenario that plays it with `asrsim run` and claims the learned accuracy."""

from __future__ import annotations

import os
from collections.abc import Sequence
from math import ceil, floor, log10
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.learning.plant import Plant
from asrsim.outfile import csv_text, make_folder, write_text
from asrsim.samples import Array
from asrsim.scenario.starter import relocated

DIGITS = 3
"""Digits of a claimed error, which is rounded up. A replay on the same plant repeats the error bit for bit."""


def write_inputs(path: Path, time: Array, headings: Sequence[str], values: Array, *, comment: str) -> None:
    """Write `time` (n,) in s and `values` (n, columns) in full precision. Raises OutputError."""
    comments = "".join(f"# {line}\n" for line in comment.splitlines())
    make_folder(path.parent)
    write_text(path, comments + csv_text(["time [s]", *headings], np.column_stack([time, values])), "learned input")


def write_playback(
    path: Path, plant: Plant, inputs: Path, *, largest: Sequence[float] = (), desired: Path | None = None
) -> None:
    """Write a scenario that plays the learned inputs from the CSV file `inputs`. Raises OutputError.

    The scenario claims that the errors of the joints relative to the motion in `desired` stay within `largest` (rad, by joint).
    """
    import yaml

    scenario, folder = plant.scenario, path.parent
    data = relocated(scenario, folder)
    learned = data.pop("ilc", {})
    # Learned inputs of two variants are played into two folders.
    variant = [scenario.variant] if scenario.variant != "default" else []
    data["name"] = "_".join([scenario.name, *variant, inputs.stem])
    # The error of a replay is relative to the motion to be learned.
    data["desired"] = learned.get("trajectory", {})
    if scenario.inverse_dynamics:
        data["inverse_dynamics"] = {**scenario.inverse_dynamics, **dict.fromkeys(plant.joints, False)}
    data["references"] = _references(data.get("references", {}), plant, os.path.relpath(inputs, folder))
    if desired is not None:
        if not plant.prepared.stepping.released:
            # With the substeps of the trials, a replay repeats the trials bit for bit.
            resolution = plant.prepared.resolution
            data |= {"substeps": resolution.substeps, "motor_substeps": resolution.motor_substeps}
        claim = {
            "quantity": "link_position", "measure": "maximum_error", "comparison": "<=",
            "against": os.path.relpath(desired, folder), "options": {"lag": "off"},
        }  # fmt: skip
        data["expect"] = [
            {"joint": joint, "value": rounded_up(error), **claim} for joint, error in zip(plant.joints, largest, strict=True)
        ]
    text = f"# Plays what `asrsim ilc` found; the inputs are in {inputs.name}.\n"
    write_text(path, text + yaml.safe_dump(data, sort_keys=False, allow_unicode=True), "learned scenario")


def _references(given: dict[str, Any], plant: Plant, inputs: str) -> dict[str, Any]:
    references = {joint: dict(signals) for joint, signals in given.items()}
    # The entry for all joints applies separately to each parameter name.
    common = references.pop("*", {})
    for joint, name in zip(plant.joints, plant.names(), strict=True):
        own = references.setdefault(joint, {})
        own[name] = {"playback": {"file": inputs, "column": joint}}
    # A parameter of this entry that every joint replaces would have no effect.
    missed = {
        name
        for drive in plant.prepared.drives if drive.mode
        for name in drive.mode.references if name not in references.get(drive.name, {})
    }  # fmt: skip
    left = {name: signal for name, signal in common.items() if name in missed}
    return ({"*": left} if left else {}) | references


def rounded_up(value: float) -> float:
    """Error rounded up to `DIGITS` digits, so that the claim is not smaller than the error."""
    if value <= 0.0:
        return 0.0
    places = DIGITS - 1 - floor(log10(value))
    return float(round(ceil(value * 10.0**places) / 10.0**places, max(places, 0)))
