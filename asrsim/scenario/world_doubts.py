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
from asrsim.scenario.overlaps import overlap_doubts
from asrsim.scenario.world_keys import WorldObject

MASSES, LENGTHS = (1e-6, 1e6), (1e-5, 1e3)
"""kg and m of objects beside a robot: a grain of sand, a ship; a hair, an airfield."""
DENSEST = 3e4
"""kg/m^3; osmium has 22,600."""
FAR = 1e4
"""m from the origin."""
ROUGH = 20.0
"""Coulomb coefficient; rubber on rubber has 2."""
GYRATION = (1e-3, 10.0)
"""Radius of gyration of an object, in its largest length."""
SUNK = 0.1
"""Share of an object's height that may begin below the ground."""


def world_doubts(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    """Warnings about objects, ground and where the robot stands."""
    world = scenario.world
    if world.ground and world.ground_friction > ROUGH:
        message = "is no coefficient of friction that materials have"
        yield Problem(message, key="world.ground.friction", value=world.ground_friction, code="large-friction")
    if math.hypot(*scenario.base_position) > FAR:
        yield Problem("is far off (in m)", key="base.position", value=_shown(scenario.base_position), code="far-off")
    start = rotation_matrix(scenario.base_rpy)
    heights = [(start @ pose.position)[2] + scenario.base_position[2] for pose in link_poses(robot).values()]
    if world.ground and world.ground_height > max(heights) and scenario.fixed_base and min(heights) < max(heights):
        message = f"is above the whole robot, whose highest link is at {max(heights):.4g} m at the zero pose"
        yield Problem(message, key="world.ground.height", value=f"{world.ground_height:g} m", code="high-ground")
    for one in world.objects:
        for key, message, value, code in _of_object(one):
            yield Problem(message, key=f"world.objects.{one.name}.{key}", value=value, code=code)
        if world.ground and one.mass and one.shape != "mesh":
            height = 2.0 * _reach_down(one)
            below = world.ground_height - (one.position[2] - 0.5 * height)
            if below > SUNK * height:
                message = f"begins {below:.3g} m deep in the ground, which throws it out"
                yield Problem(message, key=f"world.objects.{one.name}.position", value=_shown(one.position), code="in-ground")
    yield from overlap_doubts(scenario, robot)


def _of_object(one: WorldObject) -> Iterator[tuple[str, str, object, str]]:
    """Key, message, value and code of what is improbable of an object by itself."""
    density = one.mass / _volume(one)
    if one.mass and not MASSES[0] <= one.mass <= MASSES[1]:
        yield "mass", f"is no mass of a body beside a robot, {MASSES[0]:g} to {MASSES[1]:g} kg", one.mass, "odd-object"
    elif density > DENSEST:
        yield "mass", f"makes {density:.3g} kg/m^3, more than any material has", one.mass, "odd-object"
    if not all(LENGTHS[0] <= length <= LENGTHS[1] for length in one.size):
        unit = "of a mesh's scale" if one.shape == "mesh" else "m"
        message = f"is no size of a body beside a robot, {LENGTHS[0]:g} to {LENGTHS[1]:g} {unit}"
        yield "size", message, _shown(one.size), "odd-object"
    if one.friction > ROUGH:
        yield "friction", "is no coefficient of friction that materials have", one.friction, "large-friction"
    if math.hypot(*one.position) > FAR:
        yield "position", "is far off (in m)", _shown(one.position), "far-off"
    if one.inertia is None:
        return
    largest = max(one.inertia)
    if not one.mass:
        yield "inertia", "does nothing: without a mass the object does not move", _shown(one.inertia), "no-effect"
    elif largest > (1.0 + 1e-6) * (sum(one.inertia) - largest):
        yield "inertia", "belongs to no body: a moment is larger than the sum of the others", _shown(one.inertia), "odd-object"
    elif one.shape != "mesh" and not GYRATION[0] < math.sqrt(largest / one.mass) / max(one.size) < GYRATION[1]:
        yield "inertia", f"is that of a body of another size than {_shown(one.size)} m", _shown(one.inertia), "odd-object"


def _volume(one: WorldObject) -> float:
    """m^3; of a mesh nothing is known."""
    if one.shape == "mesh":
        return math.inf
    if one.shape == "sphere":
        return 4.0 / 3.0 * math.pi * one.size[0] ** 3
    if one.shape == "cylinder":
        return math.pi * one.size[0] ** 2 * one.size[1]
    return math.prod(one.size)


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
