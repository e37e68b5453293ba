"""What a scenario says of the world around the robot, and hardly means."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from asrsim.errors import Problem
from asrsim.robot import Robot
from asrsim.robot.poses import link_poses, rotation_matrix
from asrsim.samples import Array
from asrsim.scenario.data import Scenario
from asrsim.scenario.world_keys import WorldObject

SUNK = 0.1
"""Share of an object's height that may begin below the ground."""


def world_doubts(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    """Warnings about objects, ground and where the robot stands."""
    world = scenario.world
    start = rotation_matrix(scenario.base_rpy)
    heights = [(start @ pose.position)[2] + scenario.base_position[2] for pose in link_poses(robot).values()]
    if world.ground and world.ground_height > max(heights) and scenario.fixed_base and min(heights) < max(heights):
        message = f"is above the whole robot, whose highest link is at {max(heights):.4g} m at the zero pose"
        yield Problem(message, key="world.ground.height", value=f"{world.ground_height:g} m", code="high-ground")
    for one in world.objects:
        if world.ground and one.mass and one.shape != "mesh":
            height = 2.0 * _reach_down(one)
            below = world.ground_height - (one.position[2] - 0.5 * height)
            if below > SUNK * height:
                message = f"begins {below:.3g} m deep in the ground, which throws it out"
                yield Problem(message, key=f"world.objects.{one.name}.position", value=_shown(one.position), code="in-ground")


def _reach_down(one: WorldObject) -> float:
    """m from the centre to the lowest point."""
    down: Array = np.abs(rotation_matrix(one.rpy)[2])
    if one.shape == "sphere":
        return one.size[0]
    if one.shape == "cylinder":
        radius, length = one.size
        return float(radius * math.sqrt(max(1.0 - down[2] ** 2, 0.0)) + 0.5 * length * down[2])
    return float(0.5 * down @ np.array(one.size))


def _shown(numbers: tuple[float, ...]) -> str:
    return ", ".join(f"{number:g}" for number in numbers)
