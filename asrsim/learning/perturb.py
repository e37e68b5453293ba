"""Plants that differ from the learned one: draws applied to robot and scenario, and run, on all processors if wanted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from asrsim.actuators import ACTUATORS
from asrsim.errors import Problem, ScenarioError
from asrsim.learning.plant import Plant
from asrsim.learning.transfer import Draw
from asrsim.robot.model import INERTIAS, ActuatorBlock
from asrsim.robot.vary import varied_robot
from asrsim.samples import Array
from asrsim.scenario.data import Effects, Scenario, for_joint
from asrsim.workers import Executor, in_order

if TYPE_CHECKING:
    from asrsim.robot.model import Robot


def perturbed(plant: Plant, draw: Draw) -> Plant:
    """The plant with a draw's changes: parameters, mass, damping and friction by a share, delay in s.

    A mass goes with its inertia, and that of the links that are fixed to it; friction is that of joint and motors; what is
    added to friction and damping is the joint's. Raises ScenarioError for factors that the plant does not have.
    """
    from asrsim.scenario import apply_to_robot

    applied = apply_to_robot(plant.scenario, plant.robot)
    blocks = {block.joint: block for block in applied.actuators}
    parameters = {joint: dict(values) for joint, values in plant.scenario.parameters.items()}
    robot, problems = plant.robot, []
    for factor, change in draw.items():
        what, *rest = factor.split(".")
        if what == "delay":
            continue
        joint = rest[0]
        own = parameters.setdefault(joint, {})
        if what == "parameters":
            fault = _scale(blocks[joint], own, rest[1], change)
            if fault is not None:
                problems.append(fault)
        elif what == "mass":
            robot = _heavier(robot, joint, 1.0 + change)
        elif what in ("added_friction", "added_damping"):
            name = what.removeprefix("added_")
            robot = varied_robot(robot, {joint: {name: getattr(robot.joint(joint), name) + change}})
        elif what in ("friction", "damping"):
            robot = varied_robot(robot, {joint: {what: getattr(robot.joint(joint), what) * (1.0 + change)}})
        if what == "friction":
            for index in range(1, ACTUATORS.get(blocks[joint].actuator).motors + 1):
                _scale(blocks[joint], own, f"motor_{index}_friction_torque", change)
    if problems:
        raise ScenarioError(list(dict.fromkeys(problems)))
    scenario = replace(plant.scenario, parameters=parameters)
    if draw.get("delay"):
        scenario = _delayed(scenario, plant.joints, draw["delay"])
    return replace(plant, scenario=scenario, robot=robot)


def outputs_of(plant: Plant, inputs: Array, draws: Sequence[Draw], workers: Executor) -> list[Array]:
    """Link positions (n, joints) in rad of each drawn plant with these inputs, in the order of the draws; NaN where a plant
    diverged. Raises ScenarioError for factors that the plant does not have."""
    return in_order(workers, partial(_one, plant, inputs), draws)


def _one(plant: Plant, inputs: Array, draw: Draw) -> Array:
    return perturbed(plant, draw).outputs(inputs)


def _scale(block: ActuatorBlock, own: dict[str, float], name: str, change: float) -> Problem | None:
    from asrsim.robot.tags import parameter_name

    known = parameter_name(ACTUATORS.get(block.actuator), name)
    if known is None:
        return Problem(
            f"the {block.actuator} has no such parameter",
            key=f"spread.parameters.{name}",
            choices=tuple(block.parameters),
            code="unknown-parameter",
        )
    own.pop(name, None)
    own[known] = block.parameters[known].value * (1.0 + change)
    return None


def _heavier(robot: Robot, joint: str, factor: float) -> Robot:
    """The robot with what the joint moves as one body heavier by a factor, mass and inertia alike."""
    body = rigid_body(robot, robot.joint(joint).child)
    changes = {
        link.name: {"mass": link.mass * factor} | dict(zip(INERTIAS, (factor * value for value in link.inertia), strict=True))
        for link in robot.links
        if link.name in body and link.mass is not None and link.inertia is not None
    }
    return varied_robot(robot, changes)


def rigid_body(robot: Robot, link: str) -> set[str]:
    """The link and all that are fixed to it, beyond it."""
    body, waiting = {link}, [link]
    while waiting:
        fixed = [joint.child for joint in robot.carried.get(waiting.pop(), ()) if joint.kind == "fixed"]
        body.update(fixed)
        waiting += fixed
    return body


def _delayed(scenario: Scenario, joints: Sequence[str], delay: float) -> Scenario:
    effects: dict[str, Effects] = dict(scenario.command_effects)
    for joint in joints:
        before = for_joint(scenario.command_effects, joint, Effects())
        effects[joint] = replace(before, delay=before.delay + delay)
    return replace(scenario, command_effects=effects)
