"""What becomes of a varied key: numbers that a prepared scenario takes as it stands, or keys for which it is read again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Any

from asrsim.actuators import ACTUATORS, MODES
from asrsim.errors import InputError, Problem, did_you_mean
from asrsim.robot.model import Robot
from asrsim.robot.tags import parameter_name
from asrsim.robot.vary import names_of
from asrsim.scenario.data import Scenario, for_joint
from asrsim.scenario.keys import SCENARIO
from asrsim.scenario.overrides import split_path
from asrsim.scenario.shadowed import shadowed

OWN_RESOLUTION = ("step", "substeps", "motor_substeps", "substep_cap", "stepping", "engine")
"""Keys of the scenario under which every run finds its own substeps, by its own numbers."""


@dataclass(frozen=True)
class Plan:
    """The keys of one variant, by what they need."""

    parameters: Mapping[str, tuple[tuple[str, str], ...]]
    """Key -> (joint or link, name) pairs that :meth:`asrsim.simulation.prepare.Prepared.vary` takes."""
    references: Mapping[str, tuple[tuple[str, str], ...]]
    """Key -> (joint, reference) pairs that are constant in every run."""
    signals: frozenset[str]
    """Keys of numbers inside references and external torques."""
    inertials: Mapping[str, tuple[tuple[str, str], ...]]
    """Key -> (joint or link, name) of the robot itself, which no key of a scenario sets."""
    texts: Mapping[str, str]
    """Key -> the key that `--set` takes; keys of a robot are not here."""
    own_resolution: bool
    """Whether every run finds its own substeps."""
    still: bool
    """Whether nothing that is prepared follows from the numbers: no start at equilibrium, planned references or substeps."""

    @property
    def in_place(self) -> frozenset[str]:
        """Keys that a prepared scenario takes as it stands."""
        return frozenset((*self.parameters, *self.references, *self.signals, *self.inertials))

    @property
    def reads_robot(self) -> bool:
        """Whether another robot's file is read."""
        return any(text.partition(".")[0] == "robot" for text in self.texts.values())

    @property
    def varies_in_place(self) -> bool:
        """Whether a prepared scenario takes some of the numbers as it stands."""
        return bool(self.in_place) and self.still and not self.reads_robot

    def changes(self, values: Mapping[str, Any]) -> dict[str, dict[str, float]]:
        """What `vary` takes for a point; a joint's own entry wins over one for all."""
        return _table({**self.parameters, **self.inertials}, values)

    def robot_changes(self, values: Mapping[str, Any]) -> dict[str, dict[str, float]]:
        """The same, of keys of the robot only."""
        return _table(self.inertials, values)

    def read_again(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """`--set` key -> value of those for which the scenario is read again."""
        return {text: values[key] for key, text in self.texts.items() if key not in self.in_place}

    def settings(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """`--set` key -> value of all."""
        return {text: values[key] for key, text in self.texts.items()}


def _table(pairs: Mapping[str, Sequence[tuple[str, str]]], values: Mapping[str, Any]) -> dict[str, dict[str, float]]:
    found: dict[str, dict[str, float]] = {}
    for key in sorted(pairs, key=lambda key: "*" not in key):
        for owner, name in pairs[key]:
            found.setdefault(owner, {})[name] = float(values[key])
    return found


def plan_keys(keys: Sequence[str], numeric: Mapping[str, bool], scenario: Scenario, robot: Robot) -> Plan:
    """How each key is varied. `robot`: the scenario's, with its actuators on it. Raises InputError naming unknown keys.

    numeric: whether all of a key's values are numbers.
    """
    problems: list[Problem] = []
    texts: dict[str, str] = {}
    inertials: dict[str, tuple[tuple[str, str], ...]] = {}
    for key in keys:
        try:
            pairs, text = _robot_key(key, robot)
        except InputError as error:
            problems += error.problems
            continue
        if text is not None:
            texts[key] = text
        elif not numeric[key]:
            problems.append(Problem("takes numbers only", key=key, code="sweep-values"))
        else:
            inertials[key] = pairs
    if problems:
        raise InputError(problems)
    parameters: dict[str, tuple[tuple[str, str], ...]] = {}
    references: dict[str, tuple[tuple[str, str], ...]] = {}
    signals: set[str] = set()
    planned = scenario.task is not None or any(scenario.inverse_dynamics.values())
    own_resolution = any(text.partition(".")[0] in OWN_RESOLUTION for text in texts.values())
    # A start at equilibrium, planned references and substeps follow from all numbers: the scenario is prepared anew.
    still = not (scenario.initial_equilibrium or planned or own_resolution)
    for key, text in texts.items():
        parts = split_path(text)
        if "*" in parts[:-1] and shadowed(parts, scenario, robot):
            problems.append(_moves_nothing(key, "*"))
            continue
        if not (still and numeric[key]):
            continue
        if (parts[0] == "references" and len(parts) > 3) or (parts[0] == "external_torques" and len(parts) > 1):
            signals.add(key)
        if len(parts) != 3:
            continue
        if parts[0] == "parameters" and _known_parameter(parts[2], robot):
            parameters[key] = tuple(_parameter_places(parts[1], parts[2], scenario, robot))
        elif parts[0] == "references":
            found = _reference_places(parts[1], parts[2], scenario, robot)
            if found is not None:
                references[key] = tuple(found)
        if not parameters.get(key, True) or not references.get(key, True):
            problems.append(_moves_nothing(key, parts[1]))
    if problems:
        raise InputError(problems)
    return Plan(parameters, references, frozenset(signals), inertials, texts, own_resolution, still)


def _robot_key(key: str, robot: Robot) -> tuple[tuple[tuple[str, str], ...], str | None]:
    """(joint or link, name) pairs of a key of the robot, or the key that `--set` takes."""
    parts = split_path(key)
    blocks = {block.joint: block for block in robot.actuators}
    joints = {joint.name: joint for joint in robot.joints}
    links = {link.name: link for link in robot.links}
    owners = [name for name in dict.fromkeys((*joints, *links)) if fnmatchcase(name, parts[0])]
    if len(parts) == 2 and owners:
        if parts[0] in blocks and parameter_name(ACTUATORS.get(blocks[parts[0]].actuator), parts[1]) is not None:
            return (), f'parameters."{parts[0]}".{parts[1]}' if "." in parts[0] else f"parameters.{parts[0]}.{parts[1]}"
        pairs = tuple((owner, parts[1]) for owner in owners if parts[1] in names_of(owner, {}, joints, links))
        if pairs:
            return pairs, None
    if parts[0] in {known.name for known in SCENARIO.keys}:
        return (), key
    if owners:
        known, name = names_of(owners[0], blocks, joints, links), ".".join(parts[1:])
        problem = Problem("has no such number", key=key, choices=known, meant=name, code="key")
        raise InputError(problem)
    names = (*(known.name for known in SCENARIO.keys), *joints, *links)
    message = f"there is no key, joint or link '{parts[0]}'"
    raise InputError(message, key=key, hint=did_you_mean(parts[0], names), code="unknown-key")


def _moves_nothing(key: str, joint: str) -> Problem:
    message = "changes nothing: no joint has it, or each has an entry of its own, which wins over '*'"
    if joint != "*":
        message = "changes nothing: the joint has no such number in its mode"
    return Problem(message, key=key, hint="Name the joint", code="sweep-nothing")


def _known_parameter(key: str, robot: Robot) -> bool:
    """Others are told by the scenario's own check, with the choices."""
    return any(parameter_name(ACTUATORS.get(block.actuator), key) is not None for block in robot.actuators)


def _parameter_places(joint: str, key: str, scenario: Scenario, robot: Robot) -> list[tuple[str, str]]:
    places = []
    for block in robot.actuators:
        actuator = ACTUATORS.get(block.actuator)
        name = parameter_name(actuator, key)
        if name is None or joint not in ("*", block.joint):
            continue
        own = {parameter_name(actuator, given) for given in scenario.parameters.get(block.joint, {})}
        if joint == block.joint or name not in own:
            places.append((block.joint, name))
    return places


def _reference_places(joint: str, name: str, scenario: Scenario, robot: Robot) -> list[tuple[str, str]] | None:
    """Joints whose reference the key sets; None where effects stand between the key and the joint."""
    places = []
    for block in robot.actuators:
        if joint not in ("*", block.joint) or name not in MODES[block.mode].references:
            continue
        if joint == "*" and name in scenario.references.get(block.joint, {}):
            continue
        if for_joint(scenario.command_effects, block.joint) is not None:
            return None
        places.append((block.joint, name))
    return places
