"""Actuators that a data sheet can describe: an actuator by name, the actuators of a plugin file, or the actuators on a robot's
joints."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from asrsim.actuators import ACTUATORS, MODES
from asrsim.actuators.drive import Drive
from asrsim.errors import InputError, Problem
from asrsim.plugins import load_plugin_file
from asrsim.robot import ActuatorBlock, Joint, Robot, load_robot
from asrsim.robot.mounting import drive_of
from asrsim.robot.values import block_for
from asrsim.scenario import load_scenario
from asrsim.simulation.examine import examine

SHEET_MODE = 6
"""Operation mode in which sheets describe an actuator: controllers move the motors to equilibrium and preset."""
ROBOTS, SCENARIOS = (".urdf", ".xacro"), (".yaml", ".yml")


@dataclass(frozen=True, kw_only=True)
class Source:
    """One actuator that a data sheet describes, with its parameter values."""

    name: str
    """Name of the sheet, and of its files."""
    short: str
    """Name in comparisons of sheets: name of the actuator or of the joint."""
    drive: Drive
    """The actuator's drive in the mode `SHEET_MODE`."""
    origin: str
    stated: Mapping[str, float]
    """Parameter values that differ from the defaults, by name."""
    effort: float = math.inf
    """Effort limit of the joint, N m; infinite if the actuator is on no joint."""
    stops: tuple[float, float] = (-math.inf, math.inf)
    """Limits of the joint, rad."""
    prismatic: bool = False
    """Whether the joint slides, so that units are N and m instead of N m and rad."""
    resolution: float | None = None
    """Resolution of the encoders in rad, if a scenario states it; else None."""
    plugins: tuple[Path, ...] = ()


def sources_of(
    targets: Sequence[str],
    *,
    joints: Sequence[str] = (),
    arguments: Mapping[str, str] | None = None,
    packages: Mapping[str, Path] | None = None,
    plugins: Sequence[Path] = (),
) -> tuple[Source, ...]:
    """Actuators of all targets: names of actuators, plugin files (.py), robots (.urdf, .xacro), and scenarios (.yaml).

    joints: joints of robots; empty: all joints with actuators. arguments, packages: arguments and package folders of xacro
    files. plugins: plugin files that have already been loaded. Raises InputError for an unknown name, joint or file, and if
    joints are named but no robot or scenario.
    """
    found: list[Source] = []
    for target in targets:
        path = Path(target)
        if path.suffix == ".py":
            kinds = load_plugin_file(path)
            if not kinds:
                raise InputError("defines no actuator", file=path, code="no-actuator")
            found += [_by_name(kind.name, f"defaults of {path.name}", (path,)) for kind in kinds]
        elif path.suffix.lower() in ROBOTS:
            found += _of_robot(path, joints, arguments, packages, tuple(plugins))
        elif path.suffix.lower() in SCENARIOS:
            found += _of_scenario(path, joints, tuple(plugins))
        elif target in ACTUATORS:
            found.append(_by_name(target, "defaults of the toolbox" if target in _TOOLBOX else "defaults", tuple(plugins)))
        else:
            unknown = ACTUATORS.unknown(target)
            hint = "Or give a robot (.urdf, .xacro), a scenario (.yaml), or a plugin file (.py)"
            raise InputError(replace(unknown, hint=f"{unknown.hint}. {hint}"))
    if joints and not any(Path(target).suffix.lower() in (*ROBOTS, *SCENARIOS) for target in targets):
        raise InputError("requires a robot file or a scenario", key="--joint", value=joints[0], code="no-robot")
    names = [one.name for one in found]
    if doubles := [name for name in dict.fromkeys(names) if names.count(name) > 1]:
        raise InputError(f"{doubles[0]} is given twice", code="twice")
    return tuple(found)


_TOOLBOX = ("sea", "qbmove", "bavs", "awas_ii")
"""Actuators of the released toolbox."""


def _by_name(name: str, origin: str, plugins: tuple[Path, ...]) -> Source:
    block = block_for("joint_1", name, SHEET_MODE)
    return Source(name=name, short=name, drive=drive_of(block), origin=origin, stated={}, plugins=plugins)


def _of_robot(
    path: Path,
    joints: Sequence[str],
    arguments: Mapping[str, str] | None,
    packages: Mapping[str, Path] | None,
    plugins: tuple[Path, ...],
) -> list[Source]:
    return sources_in(load_robot(path, xacro_arguments=arguments, package_paths=packages), joints, plugins)


def _of_scenario(path: Path, joints: Sequence[str], plugins: tuple[Path, ...]) -> list[Source]:
    """Actuators of a scenario's first variant, with its parameter values and the resolution of its sensors."""
    first = load_scenario(path, plugins=plugins)[0]
    found = []
    for source in sources_in(examine(first).robot, joints, plugins):
        joint = source.drive.joint
        sensors = first.sensor_imperfections.get(joint) or first.sensor_imperfections.get("*")
        found.append(
            replace(
                source,
                name=_named(path, joint),
                origin=f"{path.name}, joint {joint}",
                resolution=(sensors.quantum if sensors else 0.0) or None,
            )
        )
    return found


def _named(path: Path, joint: str) -> str:
    return re.sub(r"[^A-Za-z0-9_-]", "_", f"{path.stem}_{joint}")


def sources_in(robot: Robot, joints: Sequence[str] = (), plugins: tuple[Path, ...] = ()) -> list[Source]:
    """Actuators of a robot with their values. joints: as for `sources_of`. Raises InputError for a joint without actuator."""
    path, blocks = robot.path, {block.joint: block for block in robot.actuators}
    if not blocks:
        hint = "Give the name of an actuator instead, or add an actuator with `asrsim init --actuator`"
        raise InputError("has no actuators", file=path, hint=hint, code="no-actuator")
    unknown = [
        Problem("has no actuator", file=path, key=name, choices=tuple(blocks), meant=name, code="no-actuator")
        for name in joints
        if name not in blocks
    ]
    if unknown:
        raise InputError(unknown)
    chosen = [blocks[name] for name in joints] or list(blocks.values())
    return [_of_block(path, block, robot.joint(block.joint), plugins) for block in chosen]


def _of_block(path: Path, block: ActuatorBlock, joint: Joint, plugins: tuple[Path, ...]) -> Source:
    usual = block_for(block.joint, block.actuator, SHEET_MODE).values()
    values = {name: value for name, value in block.values().items() if name in usual}
    drive = Drive(joint=block.joint, actuator=ACTUATORS.get(block.actuator), mode=MODES[SHEET_MODE], values={**usual, **values})
    return Source(
        name=_named(path, block.joint),
        short=block.joint,
        drive=drive,
        effort=joint.most_effort,
        stops=joint.stops,
        prismatic=joint.kind == "prismatic",
        origin=f"{path.name}, joint {block.joint}",
        plugins=plugins,
        stated={name: value for name, value in values.items() if value != usual[name] and math.isfinite(value)},
    )
