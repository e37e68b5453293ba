"""Files of a fit: fit.json, a scenario with the estimated `parameters:`, the robot with the estimated numbers, and pictures of
the recorded and predicted channels and of the residuals.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.identification.curves import CURVES, channel_charts, channel_curves, write_curves
from asrsim.identification.parameters import numbers_of, tied
from asrsim.identification.replay import as_plain
from asrsim.identification.result import AT_BOUND, NO_EFFECT, RATIO, FitResult
from asrsim.identification.resume import Resumed
from asrsim.identification.scenario import rotors_of_scenario, write_scenario
from asrsim.outfile import written
from asrsim.plain import finite_or_none, mapped
from asrsim.plots.charts import save_charts
from asrsim.robot.edit import edited_urdf
from asrsim.robot.vary import physical
from asrsim.samples import Array

MARK = b"<!-- written by asrsim identify -->\n"
"""Last line of each robot file that `asrsim identify` writes. A file with this line may be replaced."""


def fit_data(result: FitResult) -> dict[str, Any]:
    """Plain data of a fit for the file fit.json. `asrsim sweep --fit` reads `keys`, `mean`, `covariance`, `logarithmic`,
    `bounds` and `ties`.
    """
    rows, entries = result.estimates, result.layout.entries
    # A sweep draws parameters of the robot, except parameters without effect.
    drawn = [
        i
        for i, one in enumerate(rows)
        if one.track is None
        and numbers_of({one.key: one.value})
        and (one.has_interval or one.verdict == RATIO or (one.verdict == AT_BOUND and not entries[i].logarithmic))
    ]
    # If the search used the logarithm of a parameter, a sweep draws the logarithm, so that drawn values stay positive.
    logarithmic = [entries[i].logarithmic for i in drawn]
    means = [math.log(rows[i].value) if entries[i].logarithmic else rows[i].value for i in drawn]
    # A sweep must not vary parameters without an interval, so give them a spread of 0.
    spread = np.where(logarithmic, 1.0, result.layout.slopes(result.x)[drawn]) * [rows[i].has_interval for i in drawn]
    about = ("status", "fits", "accepted", "misfit", "causes", "remarks", "bandwidth", "evaluations", "seconds")
    data = {
        "name": result.task.name,
        **{name: getattr(result, name) for name in about},
        "scenario": str(result.task.scenario.absolute()),
        "experiments": [str(one.file.absolute()) for one in result.task.experiments],
        "variant": result.task.variant,
        "overrides": [*result.task.overrides],
        "replay": as_plain(result.replay),
        "estimates": [vars(one) for one in rows],
        "combinations": [{"text": one.text, "value": one.value, "margin": one.margin} for one in result.combinations],
        "channels": [{name: value for name, value in vars(one).items() if name != "lines"} for one in result.channels],
        "predictions": [
            {
                name: getattr(one, name)
                for name in ("recording", "key", "unit", "error", "fitted", "ratio", "seconds", "short", "text")
            }
            for one in result.transfers
        ],
        "correlations": _correlations(result.covariance),
        "profiles": [{"name": p.name, "values": p.values.tolist(), "rise": p.rise.tolist()} for p in result.profiles],
        "ties": [vars(tie) for tie in result.layout.ties],
        "keys": [rows[i].key for i in drawn],
        "mean": means,
        "covariance": (result.covariance[np.ix_(drawn, drawn)] * np.outer(spread, spread)).tolist(),
        "logarithmic": logarithmic,
        "bounds": [[entries[i].low, entries[i].high] for i in drawn],
    }
    plain: dict[str, Any] = mapped(data, lambda value: finite_or_none(value) if isinstance(value, float) else value)
    return plain


def _correlations(covariance: Array) -> list[list[float]]:
    """Correlations (n, n) of the estimates' errors; nan for parameters without a standard deviation."""
    sizes = np.sqrt(np.diag(covariance))
    with np.errstate(divide="ignore", invalid="ignore"):
        found: list[list[float]] = np.clip(covariance / np.outer(sizes, sizes), -1.0, 1.0).tolist()
    return found


def chosen_values(result: FitResult | Resumed, *, everything: bool) -> dict[str, float]:
    """Values of the parameters that have an effect, and of the parameters tied to them, by key. Weak and ambiguous values are
    included, since the values explain the recordings only together. everything: whether to include parameters without effect.
    """
    values = {
        one.key: one.value
        for one in result.estimates
        if one.track is None and (everything or result.accepted or one.verdict != NO_EFFECT)
    }
    return tied(values, result.ties)


def write_robot(result: FitResult | Resumed, folder: Path, *, everything: bool = False) -> tuple[list[Path], list[str]]:
    """Write the robot file and the scenario with the estimated numbers. Return paths and remarks. everything: whether to write
    parameters without effect, too.
    """
    chosen = chosen_values(result, everything=everything)
    changes = physical(result.robot, numbers_of(chosen))
    if not changes:
        return [], ["no free parameter of the robot has an effect, so no robot file is written (--all writes all estimates)"]
    said, source = [], result.robot.path
    if left := [one.key for one in result.estimates if one.track is None and one.key not in chosen]:
        said.append(f"not written, since without effect: {', '.join(left)} (--all writes all estimates)")
    data, name = source.read_bytes(), source.name
    if source.suffix != ".urdf" or b"xacro" in data[:4000]:
        data, name = result.robot.text.encode(), f"{source.name.partition('.')[0]}.urdf"
        said.append(f"{source.name} is written as expanded URDF, since xacro expressions cannot hold the numbers")
    # Parameters of actuators that the scenario mounts are not in the robot file.
    mounted = {
        block.joint: block.parameters for block in result.robot.actuators if {block.joint, "*"} & {*result.scenario.actuators}
    }
    rotors = rotors_of_scenario(result, changes)
    in_file = {
        owner: {k: v for k, v in own.items() if k not in mounted.get(owner, {}) and (k != "armature" or owner not in rotors)}
        for owner, own in changes.items()
    }
    edited = edited_urdf(data, result.robot, in_file).rstrip(b"\n") + b"\n"
    path = folder / name
    with written(path, "robot") as stream:
        stream.write(edited.removesuffix(MARK) + MARK)
    files, more = write_scenario(result, changes, path)
    return [path, *files], [*said, *more]


def draw_recordings(result: FitResult, folder: Path) -> list[Path]:
    """Write a picture of each recording. Raises OutputError."""
    paths: list[Path] = []
    for number, end in enumerate(result.ends):
        channels = [one for one in result.channels if one.track == number]
        # Number the pictures, since recordings in different folders may have the same name.
        name = f"overlay_{number + 1}_{Path(channels[0].recording).stem}" if len(result.ends) > 1 else "overlay"
        rows = [channel_charts(channel_curves(one, end)) for one in channels]
        paths += save_charts(folder / f"{name}.png", rows, title=f"{result.task.name} · {channels[0].recording}")
    return paths


def write_curves_of(result: FitResult, folder: Path) -> Path:
    """Write the curves of all channels for `asrsim report`, and return the file. Raises OutputError."""
    write_curves(folder / CURVES, [channel_curves(one, result.ends[one.track]) for one in result.channels])
    return folder / CURVES
