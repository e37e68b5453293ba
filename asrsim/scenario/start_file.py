"""Write a starter scenario beside its JSON Schema, never over another file unless told to."""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from asrsim.document.yaml_reader import parse_yaml
from asrsim.errors import OutputError, Problem, RobotError, ScenarioError
from asrsim.outfile import check_output, make_folder, write_text
from asrsim.robot import Robot, load_robot, with_actuators, with_overrides
from asrsim.scenario.data import Scenario
from asrsim.scenario.load import scenario_from_data
from asrsim.scenario.schema import schema_text
from asrsim.scenario.starter import Starter, starter_text

if TYPE_CHECKING:
    from asrsim.kinematics.sizing import Sizing

MOUNTED_MODE = 6
"""Mode of actuators that the scenario gives, where none is asked for."""
ROUNDS = 6
"""Of parameters that hold the arm, and presets that follow from them."""

VISIBLE = 1e-3
"""rad or m by which a joint sags that is worth a start at equilibrium."""

SCHEMA_FILE = "asrsim.schema.json"


def write_starter(
    robot: Path,
    out: Path,
    *,
    mode: int | None = None,
    actuators: Mapping[str, str] | None = None,
    force: bool = False,
    schema: bool = True,
    arguments: Mapping[str, str] | None = None,
    packages: Mapping[str, Path] | None = None,
) -> tuple[tuple[Path, ...], tuple[Problem, ...]]:
    """Write a starter scenario for the robot to `out`, and the schema beside it.

    mode: replaces the robot file's modes. actuators: joint or `"*"` -> actuator that the scenario puts there, with
    parameters that hold the arm's own weight. arguments, packages: xacro arguments and folders of ROS packages.

    Gives the files written, and what to know of joints that sag, fall or are not driven.
    Raises RobotError for a robot that cannot be read, ScenarioError for an unknown actuator or joint, OutputError where a
    file is in the way or cannot be written.
    """
    from asrsim.kinematics.sizing import problems_of_weight, sizing
    from asrsim.kinematics.swing import calming, steadying

    loaded = moving_robot(robot, arguments, packages)
    given = {joint: (name, MOUNTED_MODE if mode is None else mode) for joint, name in (actuators or {}).items()}
    mounted = with_actuators(loaded, given, {})
    starter = Starter(
        robot=mounted if mode is None else with_overrides(mounted, modes={"*": mode}),
        file=relative_path(robot, out.parent),
        schema=SCHEMA_FILE if schema else None,
        mode=None if given else mode,
        given=tuple(one.name for one in loaded.moving_joints if one.name in given or "*" in given),
        arguments=arguments or {},
        packages={name: relative_path(folder, out.parent) for name, folder in (packages or {}).items()},
    )
    found = sizing(_first(starter, loaded, out.parent), starter.robot)
    if found.proposal and given:
        starter, found = _held(starter, found, loaded, out.parent)
    else:
        starter = replace(starter, proposal=found.proposal)
    mount = shlex.join(["asrsim", "init", str(robot), "--actuator", "qbmove", "--out", str(out), "--overwrite"])
    idle = (replace(one, hint=f"Put some on: {mount}") for one in loaded.warnings if one.code == "no-actuators" and not given)
    if given:
        starter = _sized(starter, steadying(_first(starter, loaded, out.parent), starter.robot))
    lasts, damped = calming(_first(starter, loaded, out.parent), starter.robot)
    damped = {joint: keys for joint, keys in damped.items() if not given or joint in starter.given}
    starter = replace(starter, damped=damped, hangs=_hangs(starter, found))
    text = starter_text(starter)
    locked = (one for one in loaded.warnings if one.code == "locked-joint")
    notes = (*idle, *locked, *problems_of_weight(found, starter.robot), *_swinging(starter, robot, lasts))
    beside = schema_beside(out) if schema else None
    check_output(out, "schema", inputs=[robot], replace=True)
    write_new(out, text, force=force)
    if beside is None:
        return (out,), notes
    write_new(beside, schema_text(), force=True)
    return (out, beside), notes


def _swinging(starter: Starter, file: Path, lasts: float) -> Iterator[Problem]:
    """A warning that an arm swings on, and what is written against it; lasts: s."""
    if starter.damped:
        how_long = f"for {lasts:.2g} s" if lasts < 100.0 else "without end"
        message = f"its joints have too little damping, so that the arm would swing on {how_long} after a step"
        where = "in the scenario" if starter.given else "that stands in the scenario as a comment"
        yield Problem(message, file=file, hint=f"`link_damping` {where} ends that", code="swings-on")


def moving_robot(path: Path, arguments: Mapping[str, str] | None, packages: Mapping[str, Path] | None) -> Robot:
    """The robot that a file tells of. Raises RobotError where it cannot be read, or no joint of it moves."""
    from asrsim.scenario.check import nothing_moves

    robot = load_robot(path, xacro_arguments=arguments or {}, package_paths=packages or {})
    if not robot.moving_joints:
        raise RobotError([nothing_moves(robot)])
    return robot


def _held(starter: Starter, found: Sizing, robot: Robot, folder: Path) -> tuple[Starter, Sizing]:
    """The starter with parameters that hold the arm, and how. Its presets follow from them, so they are judged with these
    again."""
    from asrsim.kinematics.sizing import ENOUGH, sizing

    for _ in range(ROUNDS):
        if not found.proposal:
            break
        starter = _sized(starter, found.proposal)
        found = sizing(_first(starter, robot, folder), starter.robot, sag=ENOUGH)
    return starter, found


def _sized(starter: Starter, proposal: Mapping[str, Mapping[str, float]]) -> Starter:
    """The starter with these parameters, too."""
    sized = {name: {**starter.sized.get(name, {}), **values} for name, values in proposal.items()}
    return replace(starter, robot=with_overrides(starter.robot, parameters=proposal), sized={**starter.sized, **sized})


def _hangs(starter: Starter, found: Sizing) -> bool:
    """Whether actuators that the scenario gives hold the whole arm, and give way a little."""
    held = {one.joint for one in found.joints} == {joint.name for joint in starter.robot.moving_joints}
    return bool(starter.given) and held and not found.weak and any(one.sag > VISIBLE for one in found.joints)


def _first(starter: Starter, robot: Robot, folder: Path) -> Scenario:
    """The starter's own scenario, without its variants."""
    return scenario_of(starter_text(starter), robot, folder)


def scenario_of(text: str, robot: Robot, folder: Path) -> Scenario:
    """The scenario of a text that is to stand in `folder`, without its variants."""
    data = parse_yaml(text, error=ScenarioError).plain()
    data.pop("variants", None)
    return scenario_from_data(data, base_dir=folder, robot=robot.path)


def write_new(path: Path, text: str, *, force: bool) -> None:
    """Write a text file with the folders above it; OutputError if it is there (unless `force`) or cannot be written."""
    if path.exists() and not force:
        raise OutputError(f"{path} is there already; use --overwrite to replace it, or --out for another file")
    make_folder(path.parent)
    write_text(path, text, "schema", replace=force)


def relative_path(target: Path, folder: Path) -> str:
    """`target` as seen from `folder`, with forward slashes; absolute if no way leads there."""
    try:
        return Path(os.path.relpath(target, folder)).as_posix()
    except ValueError:
        return target.absolute().as_posix()


def schema_beside(out: Path) -> Path:
    """Where the schema of a scenario file goes. Raises OutputError where a file that is no schema of ours has its name."""
    path = out.parent / SCHEMA_FILE
    try:
        foreign = path.exists() and '"asrsim scenario"' not in path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        foreign = True
    if foreign:
        raise OutputError(f"{path} is there and is no schema of asrsim; use --no-schema")
    return path
