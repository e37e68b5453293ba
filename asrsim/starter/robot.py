"""A commented starter scenario for a robot: every actuated joint with its references and harmless signals."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.actuators import ACTUATORS, MODES, Actuator
from asrsim.actuators.vectorised import over_arrays
from asrsim.document.yaml_reader import plain_scalar
from asrsim.errors import OutputError, Problem, RobotError, ScenarioError, UnresolvedSpringError, listed
from asrsim.outfile import check_output, make_folder, written
from asrsim.quantities import linear_unit
from asrsim.robot import ActuatorBlock, Joint, Robot, load_robot, with_actuators, with_overrides
from asrsim.robot.doubts import warnings_of
from asrsim.robot.massless import springable_joints
from asrsim.robot.mounting import reference_names, with_rotors
from asrsim.scenario.check import nothing_moves
from asrsim.scenario.data import Scenario
from asrsim.scenario.load import scenario_from_data
from asrsim.scenario.relocate import robot_key
from asrsim.scenario.schema import schema_text
from asrsim.simulation.prepare import prepare
from asrsim.statics.sizing import calming, problems_of_weight, sizing, strengthened

STEP = 0.3
"""Step of the starter's position references, rad."""
PRISMATIC_STEP = 0.05
"""Step of the position references of prismatic joints, m."""
TORQUE = 0.1
"""Step of torque references, N m, and of voltages and currents, V and A."""
SOFT = 1.5
"""Preset of the soft variant, as a multiple of the typical preset. Softer springs would let most arms sag."""
STEP_TIME = 0.1
"""Time of the step, s."""
LARGEST_SHARE = 0.4
"""Largest step of a joint, as a fraction of the distance to the joint's stop."""
MOUNTED_MODE = 6
"""Mode of actuators that the scenario puts on joints, unless another mode is chosen."""
ROUNDS = 6
"""Number of rounds in which presets and parameters are found that hold the arm."""
FASTEST = (2000.0, 700.0, 250.0, 90.0, 30.0)
"""Highest natural frequencies of joints, rad/s, that are tried in turn until a run resolves the springs. The springs of light
fingers are softened: a stiffer spring would need more substeps than a run allows, and its motion could not be seen."""
VISIBLE = 1e-3
"""Smallest sag of a joint, rad or m, for which the scenario starts at equilibrium."""
SCHEMA_FILE = "asrsim.schema.json"

Comments = dict[tuple[str, ...], str]
"""Comments at the ends of lines, by path of the key."""


class Lines(dict[str, Any]):
    """Mapping of plain values that is written with a line for each key, as comments and editing need it."""


def yaml_text(data: Mapping[str, Any], comments: Mapping[tuple[str, ...], str], heading: Collection[str]) -> str:
    """YAML of plain data, with lines of comments above and comments at the ends of lines. Innermost mappings fill one line."""
    import yaml

    class Dumper(yaml.SafeDumper):
        def ignore_aliases(self, data: object) -> bool:
            return True

    tag = "tag:yaml.org,2002:"
    Dumper.add_representer(Lines, lambda dumper, items: dumper.represent_mapping(f"{tag}map", items.items(), flow_style=False))
    # Write quotes around text that our reader (YAML 1.2) would interpret as a number.
    Dumper.add_representer(
        str, lambda dumper, text: dumper.represent_scalar(f"{tag}str", text, style=None if plain_scalar(text) == text else '"')
    )
    text = yaml.dump(data, Dumper=Dumper, sort_keys=False, default_flow_style=None, allow_unicode=True, width=120)
    lines, root = text.splitlines(), yaml.compose(text)
    for path, comment in comments.items():
        node: Any = root
        for part in path:
            key, node = next(item for item in node.value if item[0].value == part)
        lines[key.start_mark.line] += f"  # {comment}"
    for number in range(len(lines) - 1, 0, -1):
        if lines[number].partition("#")[0].rstrip().endswith(":") and not lines[number].startswith((" ", "-")):
            lines.insert(number, "")
    return "\n".join([*(f"# {line}" for line in heading), "", *lines]) + "\n"


@dataclass(frozen=True, kw_only=True)
class StarterJoint:
    """Motion of a joint in the starter scenario."""

    block: ActuatorBlock
    joint: Joint
    start: float
    """Initial link position, rad or m: 0, or the nearest position that is away from the stops."""
    target: float
    """Link position after the step."""

    @property
    def actuator(self) -> type[Actuator]:
        """Class of the actuator."""
        return ACTUATORS.get(self.block.actuator)

    @property
    def presets(self) -> tuple[float, ...]:
        """A soft and a stiff second reference, or only the typical second reference if the mode has no choice of stiffness."""
        soft, mode = self.actuator.typical_preset, MODES[self.block.mode]
        if not soft or not mode.spring or mode.direct:
            return (soft,)
        values = self.block.values()
        highest = 0.6 * values["lever_length"] if "lever_length" in values else 0.75 * values.get("max_deflection", 4.0 * soft)
        stiff = min(3.0 * soft, highest)
        # Antagonistic springs also load their motors at rest. Choose the stiffness so that half of the motors' torque remains
        # for motion.
        while mode.motor and self._load(stiff) > 0.5:
            stiff *= 0.9
        return _rounded(min(SOFT * soft, 0.7 * stiff), 2), _rounded(stiff, 2)

    def _load(self, preset: float) -> float:
        """Torque of the springs on the motors at rest, as a fraction of the largest motor torque."""
        values, actuator = self.block.values(), self.actuator
        positions = np.array([0.0, *actuator.motor_references(0.0, preset)])[:, None]
        torques = over_arrays(actuator.elastic_torques)(*positions, actuator.law_values(values))[:, 0].tolist()
        limits = (values[f"motor_{i}_max_torque"] for i in range(1, actuator.motors + 1))
        return max(abs(torque) / limit if limit > 0.0 else 0.0 for torque, limit in zip(torques, limits, strict=False))

    def levels(self, position: float, torque: float, preset: float) -> list[tuple[str, str, float]]:
        """Tuples (reference, unit, value) that hold the joint at a position, or give its motors a torque.

        preset: value of a second reference that is a preset or the position of an adjuster.
        """
        mode, actuator = MODES[self.block.mode], self.actuator
        tuned = (actuator.reference_2_unit, preset)
        if not mode.spring:
            levels = [(mode.units[0], torque if mode.number == 0 else position)]
        elif mode.direct:
            levels = [*[(mode.units[0], torque)] * actuator.motors, *[tuned] * actuator.adjuster]
        elif mode.mapped or actuator.adjuster:
            levels = [("rad", position), tuned]
        else:
            levels = [("rad", motor) for motor in actuator.motor_references(position, preset)]
        return [(name, *level) for name, level in zip(reference_names(self.block), levels, strict=False)]

    def references(self, preset: float) -> dict[str, Any]:
        """Signals of the starter's step by reference, as plain data."""
        levels = zip(self.levels(self.start, 0.0, preset), self.levels(self.target, TORQUE, preset), strict=True)
        pairs = {name: (_rounded(low), _rounded(high)) for (name, _, low), (_, _, high) in levels}
        return {
            name: low if low == high else {"step": {"at": STEP_TIME, "from": low, "to": high}}
            for name, (low, high) in pairs.items()
        }

    def comments(self) -> Comments:
        """Comments on the joint's references: actuator and mode, and units."""
        mode = MODES[self.block.mode]
        path, unit_of = ("references", self.block.joint), linear_unit if self.joint.kind == "prismatic" else str
        units: Comments = {(*path, name): unit_of(unit) for name, unit, _ in self.levels(0.0, 0.0, 0.0)}
        return {path: f"{self.actuator.title}, mode {mode.number} ({mode.name}: {mode.doc})", **units}


def starter_joint(robot: Robot, block: ActuatorBlock) -> StarterJoint:
    """Motion of an actuated joint in the starter: a small step from 0, or from the position nearest to 0 that is clear of the
    stops.
    """
    joint = robot.joint(block.joint)
    size = PRISMATIC_STEP if joint.kind == "prismatic" else STEP
    lower, upper = joint.stops
    low, high = max(lower, min(-10.0, upper - 20.0)), min(upper, max(10.0, lower + 20.0))
    margin = min(size, 0.25 * (high - low))
    start = min(max(0.0, low + margin), high - margin)
    start = _rounded(start, 3) if low < _rounded(start, 3) < high else start
    # A soft joint without damping moves up to twice its step, and must not reach a stop.
    up, down = high - start, start - low
    step = min(size, LARGEST_SHARE * max(up, down))
    target = min(max(_rounded(start + (step if up > 2.0 * size or up >= down else -step)), low), high)
    return StarterJoint(block=block, joint=joint, start=start, target=target)


def _rounded(value: float, digits: int = 6) -> float:
    return float(f"{value + 0.0:.{digits}g}")


@dataclass(frozen=True, kw_only=True)
class Starter:
    """Content of a starter scenario."""

    robot: Robot
    """Robot with the modes and actuators of the scenario."""
    file: Any
    """Value of the key `robot`."""
    mode: int | None = None
    """Mode that the scenario gives all joints."""
    given: tuple[str, ...] = ()
    """Joints whose actuator the scenario gives."""
    sized: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Parameters with which the given actuators hold the arm's weight, by joint."""
    damped: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Keys of the link damping, by joint."""
    at_rest: bool = False
    """Whether the scenario starts at equilibrium."""

    def data(self) -> tuple[dict[str, Any], Comments]:
        """Scenario as plain data, and its comments."""
        data: dict[str, Any] = {"robot": self.file, "duration": 3, "step": 0.001}
        comments: Comments = {("duration",): "s", ("step",): "s; joints with stiff springs get substeps automatically"}
        if self.mode is not None:
            data["modes"] = {"*": self.mode}
            comments["modes",] = f"{MODES[self.mode].name}, instead of the modes in the robot's file"
        if self.given:
            data["actuators"] = mounted(self.robot, self.given, self.sized)
            comments["actuators",] = "on joints of the robot's file; parameters that hold the arm replace the defaults"
        if self.damped:
            data["link_damping"] = self.damped
            comments["link_damping",] = "without it, the arm oscillates for a long time after a step"
        joints = [starter_joint(self.robot, block) for block in self.robot.actuators]
        moved = Lines({one.joint.name: one.start for one in joints if one.start})
        if self.at_rest:
            data["initial"] = "equilibrium"
            comments["initial",] = "at rest under the arm's weight; without this line, the arm first sags"
        elif moved:
            data["initial"] = moved
            comments["initial",] = "rad, m; 0 is at or near the stops of these joints"
        data["references"] = {one.joint.name: Lines(one.references(one.presets[0])) for one in joints}
        for one in joints:
            comments |= one.comments()
        stiff = {one.joint.name: _changed(one) for one in joints if len(one.presets) > 1}
        if stiff:
            data["variants"] = {"soft": {}, "stiff": {"references": stiff}}
            comments["variants",] = (
                "each has all keys above, and changes the keys that it names; `asrsim run` runs all variants"
            )
        return data, comments

    def text(self) -> str:
        """YAML of the scenario."""
        heading = [
            f"yaml-language-server: $schema={SCHEMA_FILE}",
            f"Starter scenario for {self.robot.name}, written by `asrsim init`. Units are SI: rad, m, N m, s.",
            (
                "docs/scenario.md explains every key, and `asrsim actuators` explains every parameter; "
                "`asrsim check` finds mistakes."
            ),
        ]
        if not self.robot.actuators:
            heading.append(
                "The robot has no actuators. `actuators: qbmove` puts a qbMove on every joint; `asrsim actuators` lists all "
                "types."
            )
        return yaml_text(*self.data(), heading)

    def scenarios(self, folder: Path) -> Iterator[Scenario]:
        """Variants of the scenario, for a file in `folder`."""
        data, _ = self.data()
        for variant in data.get("variants", {"default": {}}).values():
            changes = variant.get("references", {})
            references = {joint: {**own, **changes.get(joint, {})} for joint, own in data["references"].items()}
            yield scenario_of({**data, "references": references}, self.robot, folder)

    def scenario(self, folder: Path) -> Scenario:
        """Scenario without its variants, for a file in `folder`."""
        return scenario_of(self.data()[0], self.robot, folder)


def _changed(one: StarterJoint) -> dict[str, Any]:
    """References of the stiff variant that differ from the references of the soft variant."""
    soft, stiff = (one.references(preset) for preset in one.presets)
    return {name: signal for name, signal in stiff.items() if signal != soft[name]}


def mounted(robot: Robot, joints: Collection[str], parameters: Mapping[str, Mapping[str, float]]) -> dict[str, Any]:
    """Value of the key `actuators` for these joints, with parameters that replace defaults."""
    return {
        block.joint: {"type": block.actuator, "mode": block.mode}
        | ({"parameters": dict(parameters[block.joint])} if parameters.get(block.joint) else {})
        for block in robot.actuators
        if block.joint in joints
    }


def write_starter(
    robot: Path,
    out: Path,
    *,
    mode: int | None = None,
    actuators: Mapping[str, str] | None = None,
    force: bool = False,
    arguments: Mapping[str, str] | None = None,
    packages: Mapping[str, Path] | None = None,
) -> tuple[tuple[Path, ...], tuple[Problem, ...]]:
    """Write a starter scenario for the robot to `out`, and the JSON Schema beside it.

    mode: mode that replaces the modes in the robot file. actuators: joint or `"*"` -> actuator that the scenario puts there,
    with parameters that hold the arm's own weight. arguments, packages: xacro arguments and folders of ROS packages.

    Returns the written files, and warnings about joints that sag, fall, oscillate or have no actuator.
    Raises RobotError for a robot that cannot be read, ScenarioError for an unknown actuator or joint, OutputError if a file
    exists or cannot be written.
    """
    loaded = moving_robot(robot, arguments, packages)
    chosen = {joint: (name, MOUNTED_MODE if mode is None else mode) for joint, name in (actuators or {}).items()}
    given = {joint: chosen["*"] for joint in springable_joints(loaded) if "*" in chosen}
    given |= {joint: entry for joint, entry in chosen.items() if joint != "*"}
    changed = with_actuators(loaded, given, {})
    bare = Starter(
        robot=with_rotors(with_overrides(changed, modes={} if mode is None else {"*": mode}), {}),
        file=robot_key(robot, out.parent, arguments, packages),
        mode=mode if loaded.actuators else None,
        given=tuple(joint.name for joint in loaded.moving_joints if joint.name in given),
    )
    bare = _sized(bare, _rotors(bare))
    for fastest in FASTEST if given else FASTEST[:1]:
        try:
            starter, notes = _finished(bare, loaded, out.parent, fastest)
            break
        except UnresolvedSpringError:
            # Try again with softer springs of the given actuators, which need fewer substeps.
            if not given or fastest == FASTEST[-1]:
                raise
    schema = out.parent / SCHEMA_FILE
    check_output(out, "schema", inputs=[robot], replace=True)
    check_output(schema, "schema")
    write_new({out: starter.text()}, schema, force=force)
    return (out, schema), tuple(notes)


def _rotors(starter: Starter) -> dict[str, dict[str, float]]:
    """Inertias of the motors of actuators that the scenario gives, from the rotors in the robot's file."""
    found = {}
    for block in starter.robot.actuators:
        rotor, motors = starter.robot.joint(block.joint).rotor_inertia, ACTUATORS.get(block.actuator).motors
        if rotor and MODES[block.mode].motor and block.joint in starter.given:
            found[block.joint] = {f"motor_{i}_inertia": _rounded(rotor / motors) for i in range(1, motors + 1)}
    return found


def _finished(starter: Starter, loaded: Robot, folder: Path, fastest: float) -> tuple[Starter, list[Problem]]:
    """Starter with parameters, damping and initial state, and its warnings. Raises the errors of a run.

    loaded: the robot of the file. fastest: highest natural frequency of joints that springs carry, rad/s.
    """
    for _ in range(ROUNDS if starter.given else 0):
        # Presets depend on the parameters, and parameters depend on presets, so compute the two repeatedly until they are
        # consistent.
        starter = _sized(starter, strengthened(starter.scenario(folder), starter.robot, fastest=fastest))
    found = sizing(starter.scenario(folder), starter.robot)
    notes = [*warnings_of(loaded), *problems_of_weight(found, starter.robot)]
    if starter.given:
        notes = [problem for problem in notes if problem.key != loaded.name]
    lasts, damped = calming(starter.scenario(folder), starter.robot)
    if damped:
        message = f"its joints have too little damping, so the arm would oscillate {_lasting(lasts)} after a step"
        hint = "`link_damping` in the scenario damps it" if starter.given else f"`link_damping: {damped}` would damp it"
        notes.append(Problem(message, file=loaded.path, hint=hint, code="swings-on"))
    leading = {joint.name for joint in starter.robot.moving_joints} - starter.robot.followers
    held = {one.joint for one in found.joints} == leading
    starter = replace(
        starter,
        damped={joint: keys for joint, keys in damped.items() if joint in starter.given},
        at_rest=bool(starter.given) and held and not found.weak and any(one.sag > VISIBLE for one in found.joints),
    )
    return _runnable(starter, loaded, folder), notes


def _runnable(starter: Starter, loaded: Robot, folder: Path) -> Starter:
    """Starter that a run accepts; it starts at equilibrium only if the arm has an equilibrium. Raises the errors of a run."""
    try:
        for scenario in starter.scenarios(folder):
            prepare(scenario, loaded)
    except ScenarioError:
        if not starter.at_rest:
            raise
        return _runnable(replace(starter, at_rest=False), loaded, folder)
    return starter


def _lasting(seconds: float) -> str:
    """Duration of an oscillation as text."""
    if seconds < 100.0:
        return f"for {seconds:.2g} s"
    return "for minutes" if seconds < 3600.0 else "for hours" if math.isfinite(seconds) else "without end"


def _sized(starter: Starter, proposal: Mapping[str, Mapping[str, float]]) -> Starter:
    """Starter with additional parameters of the actuators that it gives."""
    own = {name: values for name, values in proposal.items() if name in starter.given}
    sized = {name: {**starter.sized.get(name, {}), **values} for name, values in own.items()}
    return replace(starter, robot=with_overrides(starter.robot, parameters=own), sized={**starter.sized, **sized})


def moving_robot(path: Path, arguments: Mapping[str, str] | None, packages: Mapping[str, Path] | None) -> Robot:
    """Robot in a file. Raises RobotError if the robot cannot be read, or has no moving joint."""
    robot = load_robot(path, xacro_arguments=arguments or {}, package_paths=packages or {})
    if not robot.moving_joints:
        raise RobotError([nothing_moves(robot)])
    return robot


def scenario_of(data: Mapping[str, Any], robot: Robot, folder: Path, files: Mapping[str, Path] | None = None) -> Scenario:
    """Scenario from the data of a file in `folder`, without its variants. files: paths of files that are not in the folder."""
    return scenario_from_data(
        {key: value for key, value in data.items() if key != "variants"}, base_dir=folder, robot=robot.path, files=files
    )


def write_new(files: Mapping[Path, str], schema: Path | None = None, *, force: bool) -> None:
    """Write all text files, and the JSON Schema of scenarios, or none of them. Missing folders are created.

    Raises OutputError if a file exists (unless `force`) or cannot be written.
    """
    present = [path for path in files if path.exists() and not force]
    if present:
        verb, them = ("exists", "it") if len(present) == 1 else ("exist", "them")
        raise OutputError(f"{listed(present, 3)} {verb}: use --overwrite to replace {them}, or --out to choose another file")
    with ExitStack() as stack:
        # The files replace older files when the block ends, so that no file is replaced if one of them cannot be written.
        for path, text in files.items():
            make_folder(path.parent)
            stack.enter_context(written(path, "schema", replace=force)).write(text.encode())
        if schema is not None:
            stack.enter_context(written(schema, "schema")).write(schema_text().encode())
