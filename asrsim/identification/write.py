"""What a fit leaves: fit.json, the scenario with its `parameters:`, and the robot with its numbers."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.errors import InputError
from asrsim.identification.result import Result
from asrsim.identification.verdicts import AT_BOUND, IDENTIFIED, RATIO, WEAK, Estimate
from asrsim.outfile import written
from asrsim.robot.edit import edited_urdf
from asrsim.robot.mounting import reference_names
from asrsim.robot.vary import JOINT_NAMES, LINK_NAMES, physical
from asrsim.scenario.data import for_joint
from asrsim.scenario.starter import relative_path

FIT, SCENARIO = "fit.json", "scenario.yaml"


def as_dict(result: Result) -> dict[str, Any]:
    """Plain values for JSON. `keys`, `mean`, `covariance`, `logarithmic`, `bounds` and `ties` are for `asrsim sweep --fit`."""
    from asrsim import __version__

    # What is estimated by its logarithm is drawn by it: as its interval, a draw does not fall below 0.
    logarithmic = [entry.parameter.logarithmic for entry in result.layout.entries]
    bounds = [(entry.parameter.low, entry.parameter.high) for entry in result.layout.entries]
    slopes = np.where(logarithmic, 1.0, result.layout.slopes(result.x))
    drawn = [i for i, one in enumerate(result.estimates) if _is_drawn(one, logarithmic=logarithmic[i]) and _sweeps(result, one)]
    # What goes with the others but has no interval is always what it was found with them.
    spread = np.where([math.isnan(one.low) for one in result.estimates], 0.0, slopes)
    covariance = np.nan_to_num(result.covariance) * np.outer(spread, spread)
    return {
        "generator": f"asrsim {__version__}",
        "format": 1,
        **{name: getattr(result, name) for name in ("status", "fits", "accepted", "misfit", "causes", "remarks")},
        "scenario": str(result.task.scenario.absolute()),
        "experiments": [str(one.file.absolute()) for one in result.task.experiments],
        "estimates": [_finite(one.as_dict()) for one in result.estimates],
        "ties": [{"key": tie.key, "to": tie.to, "factor": tie.factor} for tie in result.layout.ties],
        "combinations": [
            {"text": one.text, "value": one.value, "margin": one.margin} for one in result.combinations
        ],
        "names": [one.name for one in result.estimates],
        "correlation": np.round(result.correlation, 4).tolist(),
        "channels": [_finite(one.as_dict()) for one in result.channels],
        "training_ends": list(result.ends),
        "search": {
            "how": result.how, "attempts": result.attempts, "successes": result.successes, "evaluations": result.evaluations,
            "seconds": round(result.seconds, 3),
        },
        "keys": [result.estimates[i].key for i in drawn],
        "mean": [math.log(result.estimates[i].value) if logarithmic[i] else result.estimates[i].value for i in drawn],
        "covariance": covariance[np.ix_(drawn, drawn)].tolist(),
        "logarithmic": [logarithmic[i] for i in drawn],
        "bounds": [[limit if math.isfinite(limit) else None for limit in bounds[i]] for i in drawn],
    }  # fmt: skip


def _finite(data: Mapping[str, Any]) -> dict[str, Any]:
    return {key: None if isinstance(value, float) and not math.isfinite(value) else value for key, value in data.items()}


def _is_drawn(one: Estimate, *, logarithmic: bool) -> bool:
    """Whether an estimate is part of what a sweep draws: not what has no effect, nor what became nothing."""
    together = one.verdict == RATIO or (one.verdict == AT_BOUND and not logarithmic)
    return one.track is None and (together or not math.isnan(one.low))


def _sweeps(result: Result, one: Estimate) -> bool:
    """Whether a sweep can vary this key: numbers of the robot."""
    return bool(robot_changes(result, {one.key: one.value}))


def robot_changes(result: Result, values: Mapping[str, float]) -> dict[str, dict[str, float]]:
    """Joint or link -> name -> value of those keys that are the robot's."""
    joints = {joint.name for joint in result.robot.moving_joints}
    links = {link.name for link in result.robot.links}
    blocks = {block.joint: block.parameters for block in result.robot.actuators}
    changes: dict[str, dict[str, float]] = {}
    for key, value in values.items():
        owner, _, name = key.rpartition(".")
        if (owner in joints and (name in JOINT_NAMES or name in blocks.get(owner, {}))) or (
            owner in links and name in LINK_NAMES
        ):
            changes.setdefault(owner, {})[name] = float(value)
    return changes


def chosen_values(result: Result, *, everything: bool) -> dict[str, float]:
    """Key -> value of what is identified (or all), with what is tied to it."""
    kept = {
        one.key for one in result.estimates
        # Weakly known bristles are nearer than the law's own, with which the rest would not be what was found.
        if one.track is None
        and (
            everything or one.verdict == IDENTIFIED
            or (one.verdict == WEAK and (result.accepted or one.key.endswith("friction_stiffness")))
        )
    }  # fmt: skip
    values = {one.key: one.value for one in result.estimates if one.key in kept}
    return result.layout.tied(values)


def write_fit(result: Result, folder: Path) -> Path:
    """fit.json. Raises OutputError."""
    path = folder / FIT
    with written(path, "json") as stream:
        stream.write((json.dumps(as_dict(result), indent=1, allow_nan=False) + "\n").encode())
    return path


def write_robot(result: Result, folder: Path, *, everything: bool = False) -> tuple[list[Path], list[str]]:
    """The robot file with its new numbers, and a scenario with them under `parameters:`; and what is to be said of them."""
    chosen = chosen_values(result, everything=everything)
    changes = physical(result.robot, robot_changes(result, chosen))
    if not changes:
        return [], ["nothing of the robot is identified: no robot file is written (--all writes what there is)"]
    said = []
    source = result.robot.path
    data = source.read_bytes()
    name = source.name
    if source.suffix != ".urdf" or b"xacro" in data[:4000]:
        data, name = result.robot.text.encode(), f"{source.name.partition('.')[0]}.urdf"
        said.append(f"{source.name} is written as it is expanded: xacro's expressions have no place for numbers")
    mounted = set(result.scenario.actuators) | ({"*"} & set(result.scenario.actuators))
    in_file = {
        owner: {key: value for key, value in values.items() if not _is_mounted(result, owner, key, mounted)}
        for owner, values in changes.items()
    }
    path = folder / name
    with written(path, "robot", replace=False) as stream:
        stream.write(_marked(edited_urdf(data, result.robot, {owner: values for owner, values in in_file.items() if values})))
    scenario = folder / SCENARIO
    delays, alone = _delays(result, chosen)
    said += [f"{name}.delay has no place in {SCENARIO}: there a delay is of all references of a joint" for name in alone]
    with written(scenario, "fitted scenario") as stream:
        stream.write(_scenario_text(result, changes, delays, scenario, path).encode())
    return [path, scenario], said


def _delays(result: Result, values: Mapping[str, float]) -> tuple[dict[str, float], list[str]]:
    """Joint -> s of delay that all its references have, and references that have one of their own."""
    found: dict[str, float] = {}
    alone: list[str] = []
    for block in result.robot.actuators:
        names = [f"{block.joint}.reference_{i}" for i in range(1, len(reference_names(block)) + 1)]
        late = [name for name in names if values.get(f"{name}.delay")]
        if late and len({values.get(f"{name}.delay") for name in names}) == 1:
            found[block.joint] = values[f"{names[0]}.delay"]
        else:
            alone += late
    return found, alone


def _is_mounted(result: Result, owner: str, key: str, mounted: set[str]) -> bool:
    """Whether a number is an actuator's that the scenario, not the robot file, puts on the joint."""
    block = next((one for one in result.robot.actuators if one.joint == owner), None)
    return block is not None and key in block.parameters and (owner in mounted or "*" in mounted)


def _marked(data: bytes) -> bytes:
    """With a comment at the end, by which we know our own file."""
    mark = b"<!-- written by asrsim identify -->\n"
    return data if data.endswith(mark) else data.rstrip(b"\n") + b"\n" + mark


def _scenario_text(
    result: Result, changes: Mapping[str, Mapping[str, float]], delays: Mapping[str, float], path: Path, robot: Path
) -> str:
    """A scenario that replaces the fitted one's robot and parameters, for `asrsim run`."""
    import yaml

    blocks = {block.joint: block.parameters for block in result.robot.actuators}
    data = dict(result.scenario.resolved)
    given = data.get("robot")
    base = (result.task.scenario.parent).absolute()
    files = result.scenario.attachments
    data = _as_played(
        placed(data, lambda name: relative_path(files.get(name, base / name), path.parent.absolute())), result.played
    )
    arguments = {key: value for key, value in given.items() if key == "packages"} if isinstance(given, Mapping) else {}
    data["robot"] = {"file": relative_path(robot, path.parent), **arguments} if arguments else relative_path(robot, path.parent)
    parameters = {joint: dict(values) for joint, values in (data.get("parameters") or {}).items()}
    for owner, values in changes.items():
        own = {name: float(f"{value:.9g}") for name, value in values.items() if name in blocks.get(owner, {})}
        if own:
            parameters.setdefault(owner, {}).update(own)
    data["parameters"] = parameters
    if delays:
        effects = dict(data.get("effects") or {})
        effects["commands"] = commands = dict(effects.get("commands") or {})
        for joint, delay in delays.items():
            before = for_joint(commands, joint, {})
            commands[joint] = {**before, "delay": float(f"{before.get('delay', 0.0) + delay:.9g}")}
        data["effects"] = effects
    for key in ("name", "variant", "expect"):
        data.pop(key, None)
    lines = [
        "# Scenario with the parameters that `asrsim identify` found; inertias, damping and friction are in the robot.",
        *(f"# {one.name}: {one.value:.6g} {one.unit}, {one.verdict}" for one in result.estimates),
        *(f"# The model does not fit: {text}" for text in result.misfit),
    ]
    return "\n".join(lines) + "\n" + yaml.safe_dump(data, sort_keys=False, allow_unicode=True)


def placed(data: Any, place: Callable[[str], str]) -> Any:
    """With the files that it names where `place` has them."""
    if isinstance(data, Mapping):
        return {
            key: place(value) if key in ("file", "manager", "against") and isinstance(value, str) else placed(value, place)
            for key, value in data.items()
        }
    return [placed(value, place) for value in data] if isinstance(data, list) else data


def _as_played(data: Any, columns: Mapping[str, str]) -> Any:
    """With playbacks of these columns as they were played between their samples."""
    if isinstance(data, Mapping):
        between = columns.get(data.get("column", "")) if "file" in data else None
        return {key: _as_played(value, columns) for key, value in data.items()} | (
            {"interpolation": between} if between else {}
        )
    return data


def begin_of(folder: Path) -> dict[str, float]:
    """Name -> value where an earlier fit in the folder ended. Raises InputError where there is none."""
    path = folder / FIT
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        return {name: float(one["estimate"]) for name, one in zip(data["names"], data["estimates"], strict=True)}
    except FileNotFoundError:
        hint = "Without --resume the fit begins anew"
        raise InputError("there is no fit to go on with", file=path, hint=hint, code="no-fit") from None
    except (OSError, ValueError, KeyError, TypeError, OverflowError):
        raise InputError("is no fit of asrsim's", file=path, code="no-fit") from None
