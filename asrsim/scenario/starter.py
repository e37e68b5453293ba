"""A commented starter scenario for a robot: every actuated joint with its references and harmless signals."""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field

from asrsim.actuators import MODES
from asrsim.document.yaml_reader import plain_scalar
from asrsim.robot import Robot
from asrsim.scenario.starter_motion import PRISMATIC_STEP, STEP, StarterJoint, number, starter_joint

HOLDING = "Parameters that stand here hold the arm: under their defaults it sags, falls, or is thrown about by its own steps."
_SIMPLE = re.compile(r"[A-Za-z_./][\w./-]*")


@dataclass(frozen=True, kw_only=True)
class Starter:
    """What a starter scenario is written from."""

    robot: Robot
    """With its modes and actuators as the scenario shall have them."""
    file: str
    """Path of the robot as the scenario shall name it."""
    schema: str | None = None
    """Path of the JSON Schema for editors, if any."""
    mode: int | None = None
    """A mode that was asked for, to be written down; the robot has it already."""
    given: tuple[str, ...] = ()
    """Joints whose actuator the scenario gives."""
    sized: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Joint -> parameters of given actuators that the robot has already, so that they hold the arm's own weight."""
    proposal: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """The same for actuators of the robot file, to be written as a comment."""
    damped: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Joint -> keys of its link damping, with which swings end that last in the robot file's own; a comment where the file has
    actuators of its own."""
    hangs: bool = False
    """It starts where its springs hold its weight, which takes no fall."""
    arguments: Mapping[str, str] = field(default_factory=dict)
    """xacro arguments that the robot was read with."""
    packages: Mapping[str, str] = field(default_factory=dict)
    """Folders of ROS packages that it was read with."""


def starter_text(starter: Starter) -> str:
    """The starter's YAML."""
    robot, mode = starter.robot, starter.mode
    drives = tuple(starter_joint(robot, block) for block in robot.actuators)
    lines = [f"# yaml-language-server: $schema={starter.schema}"] if starter.schema else []
    lines += [
        f"# Starter scenario for {robot.name}, written by `asrsim init`. Units are SI: rad, m, N m, s.",
        f"# Editors explain every key by {starter.schema}; `asrsim actuators` explains parameters."
        if starter.schema
        else "# `asrsim check` explains what is wrong with a key, `asrsim actuators` what parameters there are.",
        "",
        *robot_lines(starter.file, starter.arguments, starter.packages),
        "duration: 3          # s",
        "step: 0.001          # s; springs that are too stiff for it get substeps by themselves",
        "# log_rate: 500      # Hz; without it every step is logged",
        "# gravity: [0, 0, 0] # m/s^2; default [0, 0, -9.81]",
    ]
    if mode is not None:
        lines.append(f'modes: {{"*": {mode}}}       # {MODES[mode].name}, in the place of the modes in the robot\'s file')
    lines += _actuators(starter)
    moved = [drive for drive in drives if drive.start]
    if starter.hangs:
        lines += ["", "initial: equilibrium # at rest under its own weight; without this line it falls into its springs"]
    elif moved:
        lines += ["", "initial:             # rad, m; 0 lies on or near the stops of these joints"]
        lines += [f"  {word(drive.joint.name)}: {drive.start!r}" for drive in moved]  # rounded, a limit may be passed
    lines += ["", *_references(drives), "", *_variants(drives), "", *_further(drives)]
    return "\n".join(lines) + "\n"


def _actuators(starter: Starter) -> Iterator[str]:
    """The key `actuators`, or a comment on parameters that would hold the arm."""
    if starter.given:
        yield ""
        yield from mounted_lines(starter.robot, starter.given, starter.sized, why=HOLDING)
    if starter.proposal:
        yield ""
        yield "# As they are, springs or motors do not hold the arm's own weight: joints sag or fall. These hold it:"
        yield "# parameters:"
        yield from (f"#   {word(joint)}: {_table(given)}" for joint, given in starter.proposal.items())

    if starter.damped:
        mark = "" if starter.given else "# "
        yield ""
        yield "# Damping of the links beside the robot file's, which has too little: without it the arm swings on after a step."
        yield f"{mark}link_damping:"
        yield from (f"{mark}  {word(joint)}: {_table(keys)}" for joint, keys in starter.damped.items())


def mounted_lines(
    robot: Robot, given: Collection[str], parameters_of: Mapping[str, Mapping[str, float]], *, why: str
) -> Iterator[str]:
    """The key `actuators` with those of the joints `given`, their parameters that are no defaults, and why these are not."""
    yield "actuators:           # instead of plugin blocks in the robot's file"
    if any(parameters_of.values()):
        yield f"  # {why}"
    for block in robot.actuators:
        if block.joint in given:
            own = parameters_of.get(block.joint)
            parameters = f", parameters: {_table(own)}" if own else ""
            yield f"  {word(block.joint)}: {{type: {block.actuator}, mode: {block.mode}{parameters}}}"


def _table(values: Mapping[str, float]) -> str:
    return f"{{{', '.join(f'{name}: {number(value)}' for name, value in values.items())}}}"


def robot_lines(file: str, arguments: Mapping[str, str], packages: Mapping[str, str]) -> Iterator[str]:
    """The key `robot`."""
    if not arguments and not packages:
        yield f"robot: {word(file)}"
        return
    yield "robot:"
    yield f"  file: {word(file)}"
    for key, items in (("arguments", arguments), ("packages", packages)):
        if items:
            yield f"  {key}: {{{', '.join(f'{word(name)}: {word(text)}' for name, text in items.items())}}}"


def _references(drives: tuple[StarterJoint, ...]) -> Iterator[str]:
    if not drives:
        yield "# The robot has no actuators: it moves freely under gravity. This key puts one on every joint:"
        yield "# actuators: qbmove  # `asrsim actuators` lists them; `asrsim init ROBOT --actuator qbmove` sizes them, too"
        return
    yield "references:"
    for drive in drives:
        mode = MODES[drive.block.mode]
        yield f"  {word(drive.joint.name)}:  # {drive.actuator.title}, mode {mode.number} ({mode.name}: {mode.doc})"
        presets = drive.presets()
        for name, unit, signal in drive.references(presets[0] if presets else drive.actuator.typical_preset):
            yield f"    {name}: {signal}  # {unit}"


def _variants(drives: tuple[StarterJoint, ...]) -> Iterator[str]:
    soft_and_stiff = [(drive, presets) for drive in drives if (presets := drive.presets()) is not None]
    if not soft_and_stiff:
        yield "# Variants share everything above and change what they name; `asrsim run` runs them all:"
        yield "# variants:"
        yield "#   slow: {step: 0.002}"
        yield "#   fine: {step: 0.0005}"
        return
    yield "# Variants share everything above and change what they name; `asrsim run` runs them all."
    yield "variants:"
    for index, name in enumerate(("soft", "stiff")):
        yield f"  {name}:"
        yield "    references:"
        for drive, presets in soft_and_stiff:
            changed = drive.references(presets[index])
            items = ", ".join(f"{key}: {signal}" for key, _, signal in changed if _differs(drive, key))
            yield f"      {word(drive.joint.name)}: {{{items}}}"


def _differs(drive: StarterJoint, reference: str) -> bool:
    """Whether a reference changes with the preset."""
    first = MODES[drive.block.mode].references[0]
    return reference != first or not (MODES[drive.block.mode].mapped or drive.actuator.adjuster)


def _further(drives: tuple[StarterJoint, ...]) -> Iterator[str]:
    joint = word(drives[0].joint.name) if drives else "joint"
    force, there = ("N", PRISMATIC_STEP) if drives and drives[0].joint.kind == "prismatic" else ("N m", STEP)
    parameter = drives[0].actuator.parameters[0].name if drives else None
    yield "# More that a scenario can say:"
    if parameter is not None:
        value = number(drives[0].block.values()[parameter])
        yield f"# parameters: {{{joint}: {{{parameter}: {value}}}}}  # replaces the robot file's value"
    yield f"# external_torques: {{{joint}: {{pulse_train: {{high: 0.1, period: 1, width: 0.05, start: 1}}}}}}  # {force}"
    yield '# effects: {commands: {"*": {delay: 0.005, rate: 200}}}  # s, Hz'
    yield "# expect:"
    claim = f"measure: steady_state, value: {there:g}, tolerance: {there / 6:.1g}"
    yield f"#   - {{joint: {joint}, quantity: link_position, {claim}}}"


def word(text: str) -> str:
    """Text as YAML, quoted where it must be."""
    plain = _SIMPLE.fullmatch(text) and isinstance(plain_scalar(text), str)
    return text if plain else json.dumps(text, ensure_ascii=False)
