"""What a scenario changes on its robot: actuators, modes, parameters, namespace."""

from __future__ import annotations

from dataclasses import replace

from asrsim.errors import InputError, ScenarioError
from asrsim.robot import Robot, with_actuators, with_overrides
from asrsim.scenario.data import Scenario
from asrsim.scenario.places import placed


def apply_to_robot(scenario: Scenario, robot: Robot) -> Robot:
    """The robot with the scenario's actuators, modes, parameters (origin `scenario`) and namespace in its actuator blocks.

    Raises ScenarioError with every unknown joint, mode or parameter and every value out of range.
    """
    given = scenario.actuators
    try:
        mounted = with_actuators(
            robot,
            {joint: (one.type, one.mode) for joint, one in given.items()},
            {joint: one.parameters for joint, one in given.items() if one.parameters},
        )
        changed = with_overrides(mounted, modes=scenario.modes, parameters=scenario.parameters)
    except InputError as error:
        raise ScenarioError([placed(scenario, problem) for problem in error.problems]) from None
    if scenario.namespace is None:
        return changed
    blocks = tuple(replace(block, namespace=scenario.namespace) for block in changed.actuators)
    return replace(changed, actuators=blocks)
