"""What a scenario may say and hardly means: warnings, each with the value that looks wrong."""

from __future__ import annotations

import math
from collections.abc import Iterator

from asrsim.actuators import ACTUATORS
from asrsim.errors import Problem
from asrsim.robot import Robot
from asrsim.robot.doubts import block_doubts
from asrsim.robot.findings import beyond_a_turn
from asrsim.scenario.choices import released_order
from asrsim.scenario.data import Scenario
from asrsim.scenario.shadowed import shadowed_entries
from asrsim.scenario.world_doubts import world_doubts

STRONGEST = 30.0
"""m/s^2; Jupiter's gravity is 24.8."""
LATEST = 1.0
"""s of delay."""
STEPS = (1e-6, 0.05)
"""s: of a motor's electronics, and what no controller of a robot takes."""


def doubts(scenario: Scenario, robot: Robot, changed: Robot) -> Iterator[Problem]:
    """Warnings about a scenario on its robot, as the file has it and as the scenario changes it."""
    yield from _gravity(scenario)
    yield from _orientations(scenario)
    yield from _effects(scenario)
    yield from _step(scenario)
    yield from _without_effect(scenario, changed)
    yield from world_doubts(scenario, changed)
    earlier = {
        (block.joint, doubt.message) for block in robot.actuators for doubt in block_doubts(block, robot.joint(block.joint))
    }
    for block in changed.actuators:
        for doubt in block_doubts(block, changed.joint(block.joint)):
            if (block.joint, doubt.message) not in earlier:
                names = ", ".join(parameter.name for parameter in doubt.parameters)
                key = f"parameters.{block.joint}{'.' if names else ''}{names}"
                yield Problem(doubt.message, key=key, value=doubt.value, hint=doubt.hint, code=doubt.code)
    yield from _not_released(scenario, changed)


def _gravity(scenario: Scenario) -> Iterator[Problem]:
    if math.hypot(*scenario.gravity) > STRONGEST:
        yield Problem("is stronger than on any planet (in m/s^2)", key="gravity", value=scenario.gravity[2], code="gravity")
    elif scenario.gravity[2] > 0.0:
        message = "points upwards: z points up, so weight is negative in z"
        yield Problem(message, key="gravity", value=f"{scenario.gravity[2]:g}", code="gravity")


def _orientations(scenario: Scenario) -> Iterator[Problem]:
    poses = scenario.task.poses if scenario.task is not None else ()
    given = [
        ("base.rpy", scenario.base_rpy),
        *((f"world.objects.{one.name}.rpy", one.rpy) for one in scenario.world.objects),
    ]
    given += [(f"task.poses.{index}.rpy", pose.rpy) for index, pose in enumerate(poses) if pose.rpy is not None]
    for key, angles in given:
        if beyond_a_turn(angles):
            shown = ", ".join(f"{angle:g}" for angle in angles)
            message = "turns by more than once round; angles are in rad"
            yield Problem(message, key=key, value=shown, hint="90 degrees are 1.5708 rad", code="rpy-in-degrees")


def _effects(scenario: Scenario) -> Iterator[Problem]:
    """Delays in ms that stand where s are meant."""
    for section, table in (("commands", scenario.command_effects), ("sensors", scenario.sensor_effects)):
        for joint, effects in table.items():
            if effects.delay > LATEST or effects.delay >= scenario.duration:
                late = "as long as the run" if effects.delay >= scenario.duration else f"longer than {LATEST:g} s"
                key = f"effects.{section}.{joint}.delay"
                yield Problem(f"is {late} (in s)", key=key, value=effects.delay, code="long-delay")


def _without_effect(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    """Keys that change nothing."""
    for key in shadowed_entries(scenario, robot):
        yield Problem("does nothing: every joint that it could be for has an entry of its own", key=key, code="unused-entry")
    for name, damping in scenario.link_damping.items():
        if damping.ratio and not damping.inertia:
            message = "a ratio without 'inertia' does nothing: damping is 2 ratio sqrt(inertia stiffness)"
            yield Problem(message, key=f"link_damping.{name}", value=damping.ratio, code="ratio-without-inertia")
    for index, claim in enumerate(scenario.expect):
        if claim.tolerance and claim.comparison != "==":
            message = f"does nothing beside {claim.comparison}: it belongs to =="
            yield Problem(message, key=f"expect.{index}.tolerance", value=claim.tolerance, code="unused-tolerance")
    for one in scenario.world.objects:
        if one.inertia is not None and not one.mass:
            message = "does nothing: without a mass the object does not move"
            yield Problem(message, key=f"world.objects.{one.name}.inertia", code="no-effect")


def _step(scenario: Scenario) -> Iterator[Problem]:
    """Steps in ms, and others that are no steps of a robot's controllers."""
    if not STEPS[0] <= scenario.step <= STEPS[1]:
        message = f"is no step of a simulated robot, {STEPS[0]:g} to {STEPS[1]:g} s"
        yield Problem(message, key="step", value=f"{scenario.step:g} s", code="odd-step")


def _not_released(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    """Optional models, which the toolbox's own order of a step does not have."""
    for block in robot.actuators if released_order(scenario.stepping) else ():
        given = [
            one.name
            for one in ACTUATORS.get(block.actuator).all_parameters()
            if one.optional and block.parameters[one.name].value != one.default
        ]
        if given:
            message = f"the toolbox's order of a step does not know {', '.join(given)} of '{block.joint}'"
            yield Problem(message, key="stepping", value=scenario.stepping, code="released-model")
