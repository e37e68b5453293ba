"""Plans how each varied key of a study is applied, by setting a number in a prepared scenario, or by reading the scenario
again."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Any

from asrsim.errors import InputError, Problem, did_you_mean
from asrsim.robot.model import Robot
from asrsim.robot.mounting import reference_names
from asrsim.robot.vary import names_of
from asrsim.scenario.data import SCENARIO, Scenario, for_joint
from asrsim.scenario.names import shadowed
from asrsim.scenario.overrides import split_path

OWN_RESOLUTION = ("step", "substeps", "motor_substeps", "max_substeps", "stepping", "engine")
"""Scenario keys. If one of these keys varies, each run determines its own numbers of substeps."""
_OF_ACTUATORS = ("references", "reference_ranges", "parameters", "modes", "imperfections")
"""Scenario keys whose entries belong to joints with an actuator."""
Places = tuple[tuple[str, str], ...]
"""Numbers or references, each as (joint or link, name of its number or reference)."""


@dataclass(frozen=True)
class KeyPlan:
    """Varied keys of one variant, grouped by how their values are set."""

    numbers: Mapping[str, Places]
    """Numbers of the robot that each key sets, by key. `asrsim.Start` accepts these numbers as `parameters`."""
    references: Mapping[str, Places]
    """References that each key sets, by key. They are constant during a run."""
    signals: frozenset[str]
    """Keys inside the signals of references and external torques."""
    texts: Mapping[str, tuple[str, ...]]
    """Keys for `--set` that have the same effect as each varied key, by varied key. A varied key is missing if it sets numbers
    that stand only in the robot's file.
    """
    own_resolution: bool
    """Whether each run determines its own numbers of substeps."""
    still: bool
    """Whether numbers of a prepared scenario may be changed. They may not be changed if an initial state at equilibrium,
    planned references or substeps would have to be computed again.
    """

    @property
    def in_place(self) -> frozenset[str]:
        """Keys that can be set in a prepared scenario."""
        return frozenset((*self.numbers, *self.references, *self.signals))

    @property
    def reads_robot(self) -> bool:
        """Whether a varied key belongs to the scenario's `robot`, so that each run reads a separate robot file."""
        return any(text.partition(".")[0] == "robot" for texts in self.texts.values() for text in texts)

    @property
    def varies_in_place(self) -> bool:
        """Whether the values of some varied keys can be set in a prepared scenario, without reading the scenario again."""
        return bool(self.in_place) and self.still and not self.reads_robot

    def changes(self, values: Mapping[str, Any], *, robot_only: bool = False) -> dict[str, dict[str, float]]:
        """Robot's numbers for a run, by joint or link and by the number's name. A key of one joint takes precedence over a key
        of all joints (`*`).

        values: values of a run, by varied key; robot_only: whether the keys that `--set` accepts are omitted.
        """
        found: dict[str, dict[str, float]] = {}
        for key in _in_order(self.numbers):
            for owner, name in self.numbers[key] if not (robot_only and key in self.texts) else ():
                found.setdefault(owner, {})[name] = float(values[key])
        return found

    def read_again(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Values by `--set` key, for the keys that require reading the scenario again."""
        return {text: values[key] for key in _in_order(self.texts) for text in self.texts[key] if key not in self.in_place}

    def settings(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Values by `--set` key, for all keys that `--set` accepts."""
        return {text: values[key] for key in _in_order(self.texts) for text in self.texts[key]}


def _in_order(keys: Iterable[str]) -> list[str]:
    """Keys in the order in which they are applied: first keys of all joints (`*`), then keys with patterns, then keys of single
    joints. A later key replaces the values that an earlier key has set.
    """

    def rank(key: str) -> int:
        parts = split_path(key)
        return 0 if "*" in parts else 2 - any(map(_is_pattern, parts))

    return sorted(keys, key=rank)


def _is_pattern(part: str) -> bool:
    """Whether a part of a key is a pattern of joint names, such as `arm_*`. The part `*` is not a pattern, since scenarios have
    keys with this part."""
    return part != "*" and ("*" in part or "?" in part)


def plan_keys(keys: Sequence[str], numeric: Mapping[str, bool], scenario: Scenario, robot: Robot) -> KeyPlan:
    """Plan of how each varied key is applied. Raises InputError with every unknown key and every key without effect.

    numeric: whether all values of a key are numbers; robot: the scenario's robot with its actuators.
    """
    problems: list[Problem] = []
    texts: dict[str, tuple[str, ...]] = {}
    numbers: dict[str, Places] = {}
    for key in keys:
        try:
            places, own_texts = _robot_key(key, robot)
        except InputError as error:
            problems += error.problems
            continue
        if own_texts:
            texts[key] = own_texts
        elif numeric[key]:
            numbers[key] = places
        else:
            problems.append(Problem("accepts only numbers", key=key, code="sweep-values"))
    own_resolution = any(text.partition(".")[0] in OWN_RESOLUTION for own in texts.values() for text in own)
    # Equilibrium, planned references and substeps depend on all numbers of the robot, so each run prepares such a scenario
    # again.
    planned = scenario.task is not None or any(scenario.inverse_dynamics.values())
    still = not (scenario.initial_equilibrium or planned or own_resolution)
    references: dict[str, Places] = {}
    signals: set[str] = set()
    for key, parts in ((key, split_path(text)) for key, own_texts in texts.items() for text in own_texts):
        if "*" in parts[:-1] and shadowed(parts, scenario, robot):
            problems.append(_no_effect(key, "*"))
        elif still and numeric[key]:
            table, found = numbers, None
            if len(parts) == 3 and parts[0] == "parameters":
                found = _parameter_places(parts[1], parts[2], scenario, robot)
            elif parts[0] in ("references", "external_torques") and len(parts) > 1:
                if parts[0] == "references" and len(parts) == 3:
                    table, found = references, _reference_places(parts[1], parts[2], scenario, robot)
                signals |= {key} if found is None else set()
            if found:
                table[key] = (*table.get(key, ()), *found)
            elif found is not None:
                problems.append(_no_effect(key, parts[1]))
    if problems:
        raise InputError(problems)
    settable = {key: references[key] for key in _in_order(references) if key not in signals}
    return KeyPlan(numbers, settable, frozenset(signals), texts, own_resolution, still)


def _robot_key(key: str, robot: Robot) -> tuple[Places, tuple[str, ...]]:
    """Numbers of the robot that a key sets, and the keys for `--set` with the same effect."""
    parts = split_path(key)
    blocks = {block.joint: block for block in robot.actuators}
    joints = {joint.name: joint for joint in robot.joints}
    links = {link.name: link for link in robot.links}
    owners = [name for name in dict.fromkeys((*joints, *links)) if fnmatchcase(name, parts[0])]
    if len(parts) == 2 and owners:
        driven = [name for name in owners if name in blocks]
        having = [name for name in driven if parts[1] in blocks[name].names]
        if having:
            return (), tuple(
                f'parameters."{name}".{parts[1]}' if "." in name else f"parameters.{name}.{parts[1]}" for name in having
            )
        if parts[1] == "armature":  # a key of the scenario, which replaces the value in the robot file
            moving = [name for name in owners if name in joints and joints[name].moves]
            if moving:
                return (), tuple(f'armature."{name}"' if "." in name else f"armature.{name}" for name in moving)
        places = tuple((owner, parts[1]) for owner in owners if parts[1] in names_of(owner, {}, joints, links))
        if places:
            return places, ()
    scenario_keys = tuple(known.name for known in SCENARIO.keys)
    if parts[0] in scenario_keys:
        return (), _matched_keys(key, parts, robot) if any(map(_is_pattern, parts)) else (key,)
    if owners:
        known, name = names_of(owners[0], blocks, joints, links), ".".join(parts[1:])
        raise InputError(Problem("has no number of this name", key=key, choices=known, meant=name, code="key"))
    message = f"there is no key, joint or link '{parts[0]}'"
    raise InputError(message, key=key, hint=did_you_mean(parts[0], (*scenario_keys, *joints, *links)), code="unknown-key")


def _matched_keys(key: str, parts: tuple[str, ...], robot: Robot) -> tuple[str, ...]:
    """Keys for `--set`, one for each joint whose name matches the pattern in `key`. Raises InputError if no joint matches."""
    place = next(i for i, part in enumerate(parts) if _is_pattern(part))
    blocks, driven = {block.joint: block for block in robot.actuators}, parts[0] in _OF_ACTUATORS
    names = tuple(blocks) if driven else tuple(joint.name for joint in robot.moving_joints)
    found = [name for name in names if fnmatchcase(name, parts[place])]
    if parts[0] == "references" and len(parts) > 2:
        found = [name for name in found if parts[2] in reference_names(blocks[name])]
    elif parts[0] == "parameters" and len(parts) > 2:
        found = [name for name in found if parts[2] in blocks[name].names]
    if not found:
        message = "matches no joint that has this reference or parameter" if driven else "matches no joint"
        raise InputError(message, key=key, choices=names, code="sweep-nothing")
    texts = (".".join(f'"{part}"' if "." in part else part for part in (*parts[:place], n, *parts[place + 1 :])) for n in found)
    return tuple(texts)


def _no_effect(key: str, joint: str) -> Problem:
    if joint == "*":
        message = "changes nothing: no joint has it, or each joint has a separate entry, which replaces the entry '*'"
        return Problem(message, key=key, hint="Name the joint", code="sweep-nothing")
    return Problem("changes nothing: the joint does not have it in its operation mode", key=key, code="sweep-nothing")


def _parameter_places(joint: str, key: str, scenario: Scenario, robot: Robot) -> Places | None:
    """Parameters of actuators that a key sets. Returns None for an unknown name, which the check of the scenario reports."""
    names = {block.joint: block.names.get(key) for block in robot.actuators}
    if not any(names.values()):
        return None
    places = []
    for block in robot.actuators:
        own = {block.names.get(given) for given in scenario.parameters.get(block.joint, {})}
        name = names[block.joint]
        if name is not None and (joint == block.joint or (joint == "*" and name not in own)):
            places.append((block.joint, name))
    return tuple(places)


def _reference_places(joint: str, name: str, scenario: Scenario, robot: Robot) -> Places | None:
    """References that a key sets. Returns None if delays or other imperfections of the commands change the references."""
    places = tuple(
        (block.joint, name)
        for block in robot.actuators
        if name in reference_names(block)
        and (joint == block.joint or (joint == "*" and name not in scenario.references.get(block.joint, {})))
    )
    return None if any(for_joint(scenario.command_imperfections, owner) is not None for owner, _ in places) else places
