"""A commented starter scenario for a robot: every actuated joint with its references and harmless signals."""

from __future__ import annotations

import json
import os
import re
import shlex
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from asrsim.actuators import ACTUATORS, MODES, Actuator
from asrsim.actuators.electric import electric_of
from asrsim.document.yaml_reader import parse_yaml, plain_scalar
from asrsim.errors import OutputError, Problem, RobotError, ScenarioError
from asrsim.outfile import check_output, make_folder, write_text
from asrsim.quantities import linear_unit
from asrsim.robot import ActuatorBlock, Joint, Robot, load_robot, with_actuators, with_overrides
from asrsim.scenario.data import Scenario
from asrsim.scenario.load import scenario_from_data
from asrsim.scenario.schema import schema_text

if TYPE_CHECKING:
    from asrsim.kinematics.sizing import Sizing

STEP = 0.3
"""rad, the step of the starter's references."""
PRISMATIC_STEP = 0.05
"""m."""
TORQUE = 0.1
"""N m, for references that are torques."""
STEP_TIME = 0.1
"""s."""

_ROOM = 0.4
"""Share of the way to a stop that a step takes at most."""


@dataclass(frozen=True, kw_only=True)
class StarterJoint:
    """One joint of the starter."""

    block: ActuatorBlock
    joint: Joint
    start: float
    """Initial link position, rad or m: 0, or the nearest that is away from the stops."""
    target: float
    """Link position after the step."""
    firmer: float = 1.0
    """Factor on the usual soft preset, if its springs are too soft to hold the arm."""

    @property
    def actuator(self) -> type[Actuator]:
        """Class of the actuator."""
        return ACTUATORS.get(self.block.actuator)

    def presets(self) -> tuple[float, float] | None:
        """A soft and a stiff second reference, or None where there is no choice."""
        soft = self.actuator.typical_preset
        if not soft or not MODES[self.block.mode].spring or MODES[self.block.mode].direct:
            return None
        values = self.block.values()
        highest = 0.6 * values["lever_length"] if "lever_length" in values else 0.75 * values.get("max_deflection", 4.0 * soft)
        stiff = min(3.0 * soft, highest)
        # Springs pull on their motors also at rest; half of the motors' torque is left to move with.
        while MODES[self.block.mode].motor and self._pull(stiff) > 0.5:
            stiff *= 0.9
        return float(f"{min(soft * self.firmer, (0.5 if self.firmer == 1.0 else 0.9) * stiff):.2g}"), float(f"{stiff:.2g}")

    def _pull(self, preset: float) -> float:
        """What the springs ask of the motors at rest, as a share of their largest torque."""
        values = self.block.values()
        law = self.actuator.law_values(values)
        torques = self.actuator.elastic_torques(0.0, *self.actuator.motor_references(0.0, preset), law)
        limits = (values[f"motor_{i}_max_torque"] for i in range(1, self.actuator.motors + 1))
        return max(abs(torque) / limit if limit > 0.0 else 0.0 for torque, limit in zip(torques, limits, strict=False))

    def levels(self, position: float, torque: float, preset: float) -> Iterator[tuple[str, str, float]]:
        """(reference, unit, value) that hold the joint at a position, or its motors at a torque.

        preset: a second reference in the sense of preset or adjuster.
        """
        mode = MODES[self.block.mode]
        second = self.actuator.motors > 1 or self.actuator.adjuster
        if not mode.spring:
            yield mode.references[0], mode.units[0], torque if mode.number == 0 else position
        elif mode.direct:
            gains = [electric_of(self.block.values(), i, mode).gain or 1.0 for i in range(1, self.actuator.motors + 1)]
            yield mode.references[0], mode.units[0], torque / gains[0]
            if self.actuator.adjuster:
                yield mode.references[1], self.actuator.reference_2_unit, preset
            elif second:
                yield mode.references[1], mode.units[1], torque / gains[1]
        elif mode.mapped or self.actuator.adjuster or not second:
            yield mode.references[0], "rad", position
            if second:
                yield mode.references[1], self.actuator.reference_2_unit, preset
        else:
            motors = self.actuator.motor_references(position, preset)
            yield from zip(mode.references, ("rad", "rad"), motors, strict=True)

    def references(self, preset: float) -> Iterator[tuple[str, str, str]]:
        """(reference, unit, signal as YAML) of the starter's step."""
        before, after = self.levels(self.start, 0.0, preset), self.levels(self.target, TORQUE, preset)
        for (name, unit, low), (_, _, high) in zip(before, after, strict=True):
            if self.joint.kind == "prismatic":
                unit = linear_unit(unit)
            yield name, unit, number(low) if low == high else _step(low, high)


def starter_joint(robot: Robot, block: ActuatorBlock) -> StarterJoint:
    """The starter's motion of an actuated joint: a small step from 0, or from the position nearest to 0 that is clear of the
    stops. A joint with `<mimic>` follows the motion of its leader.
    """
    joint = robot.joint(block.joint)
    leader = next((one for one in robot.actuators if joint.mimic is not None and one.joint == joint.mimic.joint), None)
    if joint.mimic is not None and leader is not None and robot.joint(leader.joint).mimic is None:
        led = starter_joint(robot, leader)
        start, target = (joint.mimic.multiplier * place + joint.mimic.offset for place in (led.start, led.target))
        return StarterJoint(block=block, joint=joint, start=start, target=target)
    size = PRISMATIC_STEP if joint.kind == "prismatic" else STEP
    bounded = joint.lower is not None and joint.upper is not None and joint.lower < joint.upper
    low, high = (joint.lower or 0.0, joint.upper or 0.0) if bounded else (-10.0, 10.0)
    start = _start(low, high, size)
    # A soft joint without damping swings to twice its step: that is no stop.
    up, down = high - start, start - low
    upward = up > 2.0 * size or up >= down
    step = min(size, _ROOM * max(up, down))
    target = float(f"{start + (step if upward else -step):.6g}")
    return StarterJoint(block=block, joint=joint, start=start, target=target)


def _start(low: float, high: float, size: float) -> float:
    """0, or the nearest that is a step away from both stops; of a short travel, a quarter of it."""
    margin = min(size, 0.25 * (high - low))
    start = min(max(0.0, low + margin), high - margin)
    rounded = float(f"{start:.3g}")
    return rounded if low < rounded < high else start


def _step(before: float, after: float) -> str:
    return f"{{step: {{at: {STEP_TIME:g}, from: {number(before)}, to: {number(after)}}}}}"


def number(value: float) -> str:
    """A number as YAML, to six digits."""
    return f"{value + 0.0:.6g}"


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
    """A mode given on the command line, to be written down; the robot has it already."""
    given: tuple[str, ...] = ()
    """Joints whose actuator the scenario gives."""
    sized: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Joint -> parameters of given actuators that the robot has already, so that they hold the arm's own weight."""
    proposal: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """The same for actuators of the robot file, to be written as a comment."""
    damped: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Joint -> keys of its link damping, with which swings end that last in the robot file's own; a comment where the file has
    actuators of its own."""
    firmer: Mapping[str, float] = field(default_factory=dict)
    """Joint -> times the usual soft preset."""
    hangs: bool = False
    """It starts where its springs hold its weight, which takes no fall."""
    arguments: Mapping[str, str] = field(default_factory=dict)
    """xacro arguments that the robot was read with."""
    packages: Mapping[str, str] = field(default_factory=dict)
    """Folders of ROS packages that it was read with."""


def starter_text(starter: Starter) -> str:
    """The starter's YAML."""
    robot, mode = starter.robot, starter.mode
    drives = tuple(
        replace(starter_joint(robot, block), firmer=starter.firmer.get(block.joint, 1.0)) for block in robot.actuators
    )
    lines = [f"# yaml-language-server: $schema={starter.schema}"] if starter.schema else []
    lines += [
        f"# Starter scenario for {robot.name}, written by `asrsim init`. Units are SI: rad, m, N m, s.",
        "# Every key is explained in docs/scenario.md, every parameter by `asrsim actuators`; `asrsim check` finds mistakes.",
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
    lines += ["", *_references(drives), *_variants(drives)]
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
        return
    yield ""
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


def word(text: str) -> str:
    """Text as YAML, quoted where it must be."""
    plain = _SIMPLE.fullmatch(text) and isinstance(plain_scalar(text), str)
    return text if plain else json.dumps(text, ensure_ascii=False)


MOUNTED_MODE = 6
"""Mode of actuators that the scenario gives, unless another is chosen."""
ROUNDS = 6
"""Largest number of repetitions of sizing and presets."""

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
    from asrsim.kinematics.sizing import calming, problems_of_weight, sizing, steadying

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
        firm, held = starter, found
        for _ in range(ROUNDS):
            firm = replace(
                firm, firmer={**firm.firmer, **{joint: 1.3 * firm.firmer.get(joint, 1.0) for joint in held.proposal}}
            )
            held = sizing(_first(firm, loaded, out.parent), firm.robot) if held.proposal else held
        starter, found = (starter, found) if held.proposal else (firm, held)
        starter = replace(starter, proposal=found.proposal)
    mount = shlex.join(["asrsim", "init", str(robot), "--actuator", "qbmove", "--out", str(out), "--overwrite"])
    idle = (
        replace(one, hint=f"Put some on: {mount}")
        for one in loaded.warnings
        if one.key == loaded.name and not (loaded.actuators or given)
    )
    if given:
        starter = _sized(starter, steadying(_first(starter, loaded, out.parent), starter.robot))
    lasts, damped = calming(_first(starter, loaded, out.parent), starter.robot)
    damped = {joint: keys for joint, keys in damped.items() if not given or joint in starter.given}
    starter = replace(starter, damped=damped, hangs=_hangs(starter, found))
    text = starter_text(starter)
    still = {joint.name for joint in loaded.joints if not joint.moves}
    locked = (one for one in loaded.warnings if one.key in still)
    notes = (*idle, *locked, *problems_of_weight(found, starter.robot), *_swinging(starter, robot, lasts))
    beside = schema_beside(out) if schema else None
    check_output(out, "schema", inputs=[robot], replace=True)
    write_new(out, text, force=force)
    if beside is None:
        return (out,), notes
    write_new(beside, schema_text(), force=True)
    return (out, beside), notes


def _swinging(starter: Starter, file: Path, lasts: float) -> Iterator[Problem]:
    """A warning that an arm swings on, with the damping that the scenario proposes; lasts: s."""
    if starter.damped:
        how_long = f"for {lasts:.2g} s" if lasts < 100.0 else "without end"
        message = f"its joints have too little damping, so that the arm would swing on {how_long} after a step"
        where = "in the scenario" if starter.given else "that stands in the scenario as a comment"
        yield Problem(message, file=file, hint=f"`link_damping` {where} ends that", code="swings-on")


def moving_robot(path: Path, arguments: Mapping[str, str] | None, packages: Mapping[str, Path] | None) -> Robot:
    """The robot in a file. Raises RobotError where it cannot be read, or no joint of it moves."""
    from asrsim.scenario.check import nothing_moves

    robot = load_robot(path, xacro_arguments=arguments or {}, package_paths=packages or {})
    if not robot.moving_joints:
        raise RobotError([nothing_moves(robot)])
    return robot


def _held(starter: Starter, found: Sizing, robot: Robot, folder: Path) -> tuple[Starter, Sizing]:
    """The starter with parameters that hold the arm, and the sizing with them. Presets depend on the parameters, so both are
    repeated until they agree.
    """
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
    """The scenario of a text for a file in `folder`, without its variants."""
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
