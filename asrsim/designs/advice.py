"""Advice on the next experiment after a fit: motions that would identify further parameters, and a limits file for `asrsim
design`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from shlex import join
from typing import Any

import numpy as np

from asrsim.actuators import MODES
from asrsim.identification.noise import bandwidth
from asrsim.identification.result import AT_BOUND, CLOSE, IDENTIFIED, RATIO, WEAK, FitResult
from asrsim.outfile import write_text
from asrsim.plain import mapped
from asrsim.plugins import plugin_options
from asrsim.robot.model import INERTIAS

LOAD_CELL = 0.05
"""Assumed noise of a torque sensor that could be added to the robot, N m."""
REPEATED = 10.0
"""Largest factor by which the advice proposes to lengthen the recording."""
LONGEST = 600
"""Longest duration of a proposed experiment, s."""


@dataclass(frozen=True)
class _Motion:
    """Motion of a joint in the recordings: unit and range of its positions, largest speed, and bandwidth `band` in Hz."""

    unit: str
    low: float = np.inf
    high: float = -np.inf
    speed: float = 0.0
    band: float = 0.0


def _moved(result: FitResult) -> dict[str, _Motion]:
    """Motion of each joint, over all recordings of the fit."""
    found: dict[str, _Motion] = {}
    for one in (one for one in result.channels if one.key.endswith("position")):
        joint, time, values = one.key.rpartition(".")[0], one.lines["time"], one.lines.get("after", one.lines["recorded"])
        was, speed = found.get(joint, _Motion(one.unit)), float(np.abs(np.gradient(values, time)).max())
        band = bandwidth(float(np.median(np.diff(time))), values, one.noise)
        low, high = min(was.low, float(values.min())), max(was.high, float(values.max()))
        found[joint] = _Motion(one.unit, low, high, max(was.speed, speed), max(was.band, band))
    return found


def advice(result: FitResult) -> Iterator[str]:
    """Sentences on motions by which parameters with wide intervals could be identified. There are none if causes of a misfit
    are suspected, since these must be corrected first.
    """
    if result.causes:
        return
    moved, children = _moved(result), {joint.child: joint.name for joint in result.robot.joints}
    wanted: dict[str, list[str]] = {}
    # Leave out weak parameters with a narrow interval. They are weak since the model is doubtful, and no further motion removes
    # this doubt.
    wide = [one for one in result.estimates if not (one.verdict == WEAK and one.margin <= CLOSE)]
    for one in wide:
        if one.verdict in (IDENTIFIED, AT_BOUND):
            continue
        owner, _, name = one.key.rpartition(".")
        joint = children.get(owner, owner)
        if joint in moved and (text := _movement(name, joint, moved[joint])):
            wanted.setdefault(text, []).append(one.name)
        if one.verdict == RATIO:
            wanted.setdefault("record a torque, or fix one of these parameters", []).append(one.name)
    yield from (f"{', '.join(names)}: {text}" for text, names in wanted.items())
    if result.misfit:
        # If the model is wrong, a longer recording does not reduce the errors of the estimates.
        return
    longer = {one.name: (one.margin / CLOSE) ** 2 for one in wide if one.verdict == WEAK}
    if near := {name: factor for name, factor in longer.items() if factor <= REPEATED}:
        yield f"{', '.join(near)}: a recording that is {max(near.values()):.1f} times as long reduces the interval to 5 %"


def _movement(name: str, joint: str, was: _Motion) -> str:
    """Text on a motion by which a parameter can be identified; empty if no such motion is known. was: recorded motion of the
    parameter's joint.
    """
    unit, speed, band = was.unit, was.speed, was.band
    if "friction" in name:
        return f"move {joint} at less than {0.1 * speed:.2g} {unit}/s, and reverse often (recorded: up to {speed:.2g})"
    if "damping" in name:
        return f"move {joint} faster than {speed:.2g} {unit}/s, and let its oscillation decay"
    if "inertia" in name or name in ("mass", *INERTIAS):
        return f"move {joint} at {band:.2g} to {3.0 * band:.2g} Hz (recorded: up to {band:.2g} Hz)"
    if name.startswith(("spring", "lever", "pulley", "hysteresis", "max_deflection")):
        size = 0.5 * (was.high - was.low)
        return f"deflect {joint} more, by loads, presets or reversals (recorded: {size:.2g} {unit} at up to {band:.2g} Hz)"
    return ""


def design_line(result: FitResult, folder: Path) -> tuple[list[Path], str]:
    """Write a limits file with the recorded ranges. Return its path, and the command that designs the next experiment within
    these limits. The two are empty if every parameter is identified, if no motion is recorded, or if causes of a misfit must be
    corrected first.
    """
    import yaml

    verdicts, moved = {one.verdict for one in result.estimates}, _moved(result)
    if verdicts <= {IDENTIFIED, AT_BOUND} or not moved or result.causes:
        return [], ""
    noise, choose = {one.key: one.noise for one in result.channels}, dict[str, Any]()
    for block in result.robot.actuators:
        if MODES[block.mode].controller and block.joint in moved:
            gain = block.parameters["controller_1_proportional"].value
            choose[f"{block.joint}.controller_1_proportional"] = [0.5 * gain, gain, 2.0 * gain]
    if RATIO in verdicts and not any("elastic_torque" in key for key in noise):
        noise["elastic_torque"], choose["sensors"] = LOAD_CELL, ["elastic_torque"]
    limits = {joint: {"link_position": [was.low, was.high], "link_velocity": was.speed} for joint, was in moved.items()}
    step = min(float(np.median(np.diff(one.lines["time"]))) for one in result.channels)
    data = {"limits": limits, "noise": noise, "rate": round(1.0 / step)} | ({"choose": choose} if choose else {})
    data = mapped(data, lambda value: float(f"{value:.4g}") if isinstance(value, float) else value)
    path, task = folder / "limits.yaml", result.task
    head = "# Limits of `asrsim design`: the recorded ranges and noise. Widen them to the limits of the robot.\n"
    write_text(path, head + yaml.safe_dump(data, sort_keys=False), "limits")
    duration = sum({one.track: float(one.lines["time"][-1]) for one in result.channels}.values())
    words = ["asrsim", "design", str(task.file or task.scenario)]
    if task.file is None:
        words += ["--variant", task.variant] if task.variant else []
        words += [word for text in task.overrides for word in ("--set", text)]
        words += [word for one in result.estimates if one.track is None for word in ("--free", one.key)]
        words += [word for tie in task.ties for word in ("--tie", f"{tie.key}={tie.factor:g}*{tie.to}")]
    words += [*plugin_options(task.plugins), "--limits", str(path)]
    return [path], join([*words, "--duration", f"{min(max(2.0 * duration, 4.0), LONGEST):.0f}", "--out", "next.csv"])
