"""Applies a scenario to its robot: actuators, modes, parameters, namespace."""

from __future__ import annotations

from dataclasses import replace

from asrsim.errors import Problem, ScenarioError
from asrsim.robot import Robot
from asrsim.robot.model import UNREAD
from asrsim.robot.mounting import block_faults, mounted, overridden
from asrsim.scenario.data import Scenario


def apply_to_robot(scenario: Scenario, robot: Robot) -> Robot:
    """Robot with the scenario's actuators, modes, parameters (origin `scenario`) and namespace in its actuator blocks.

    Raises ScenarioError with every unknown joint, mode or parameter and every value out of range.
    """
    changed, problems = laid_on(scenario, robot)
    if problems:
        raise ScenarioError(problems)
    return changed


def laid_on(scenario: Scenario, robot: Robot) -> tuple[Robot, list[Problem]]:
    """Robot with the valid changes of the scenario, and the problems of the other changes."""
    given = scenario.actuators
    own = {joint: one.parameters for joint, one in given.items() if one.parameters}
    changed, problems = mounted(robot, {joint: (one.type, one.mode) for joint, one in given.items()}, own)
    unread = set(changed.unread)
    parameters = {joint: dict(values) for joint, values in scenario.parameters.items()}
    for section, *rest in scenario.unread:
        if section == "parameters" and len(rest) == 2:
            parameters.setdefault(rest[0], {})[rest[1]] = UNREAD
        elif section in ("actuators", "modes", "parameters"):
            joint = rest[0] if rest else "*"
            unread |= {one.name for one in robot.moving_joints} if joint == "*" else {joint}
    changed, faults = overridden(replace(changed, unread=frozenset(unread)), scenario.modes, parameters)
    problems += faults
    for fault in block_faults(changed, robot):
        section, _, joint = (fault.key or "").partition(".")
        table = {"modes": scenario.modes, "parameters": parameters}.get(section, {})
        set_there = fault.file is not None or joint in table or "*" in table
        problems.append(fault if set_there else replace(fault, key=f"actuators.{joint}"))
    if scenario.namespace is not None:
        blocks = tuple(replace(block, namespace=scenario.namespace) for block in changed.actuators)
        changed = replace(changed, actuators=blocks)
    return changed, [scenario.placed(problem) for problem in problems]
