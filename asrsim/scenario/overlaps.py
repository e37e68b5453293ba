"""Bodies that begin one inside the other: an engine throws them apart with forces that nobody meant."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from asrsim.errors import Problem
from asrsim.robot import Robot
from asrsim.robot.chain import Chain
from asrsim.robot.poses import Array, Pose, rotation_matrix
from asrsim.scenario.data import Scenario, for_joint

CORE = 0.9
"""Share of a body's lengths within which it must not meet another: what touches, or stands in a shallow dent, is meant."""
TURNS = 100
"""Projections, each onto the other body; two cores that meet do within a few."""
MEET = 1e-6
"""m."""


@dataclass(frozen=True)
class Body:
    """The core of a convex shape at its place in the world."""

    name: str
    kind: str
    half: tuple[float, ...]
    """m: of a box half its edges; else radius and half the length of the axis (z), which a sphere has not."""
    pose: Pose
    moves: bool

    def nearest(self, point: Array) -> Array:
        """The point of the core that is nearest to another one, (3,) m."""
        own = self.pose.rotation.T @ (point - self.pose.position)
        if self.kind == "box":
            own = np.clip(own, -np.array(self.half), self.half)
        else:
            radius, along = self.half
            axis = np.array((0.0, 0.0, float(np.clip(own[2], -along, along))))
            # A cylinder is a disc at each height, a capsule a ball at each point of its axis.
            rest = own - axis if self.kind != "cylinder" else own * (1.0, 1.0, 0.0)
            own = axis + rest * min(1.0, radius / max(float(np.linalg.norm(rest)), 1e-300))
        return np.asarray(self.pose.position + self.pose.rotation @ own)


def overlap_doubts(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    """Warnings about objects that begin inside the robot or inside each other; meshes are left out."""
    objects = list(_objects(scenario))
    links = list(_links(scenario, robot)) if objects else []
    for one in objects:
        inside = sorted({f"link '{link.name}'" for link in links if _meet(one, link)})
        if inside:
            yield _doubt(one, f"{', '.join(inside)} of the robot")
    for other, one in combinations(objects, 2):
        if _meet(one, other):
            yield _doubt(one, f"'{other.name}'")


def _doubt(one: Body, where: str) -> Problem:
    message = f"begins inside {where}: both are thrown apart"
    shown = ", ".join(f"{number:g}" for number in one.pose.position)
    return Problem(message, key=f"world.objects.{one.name}.position", value=shown, code="overlap")


def _meet(one: Body, other: Body) -> bool:
    if not (one.moves or other.moves):
        return False
    here = other.pose.position
    for _ in range(TURNS):
        there = one.nearest(here)
        here = other.nearest(there)
        if np.linalg.norm(here - there) < MEET:
            return True
    return False


def _half(kind: str, size: tuple[float, ...]) -> tuple[float, ...]:
    if kind == "box":
        return tuple(0.5 * CORE * edge for edge in size)
    return CORE * size[0], 0.5 * CORE * size[1] if kind != "sphere" else 0.0


def _objects(scenario: Scenario) -> Iterator[Body]:
    for one in scenario.world.objects:
        if one.shape != "mesh":
            pose = Pose(position=np.array(one.position), rotation=rotation_matrix(one.rpy))
            yield Body(one.name, one.shape, _half(one.shape, one.size), pose, one.mass > 0.0)


def _links(scenario: Scenario, robot: Robot) -> Iterator[Body]:
    chain = Chain(robot=robot, base_position=scenario.base_position, base_rpy=scenario.base_rpy)
    start = {joint.name: for_joint(scenario.initial_positions, joint.name, 0.0) for joint in robot.moving_joints}
    poses = chain.poses({name: np.array([place]) for name, place in start.items()})
    moving = {joint.child for joint in robot.moving_joints}
    for joint in robot.outward_joints:
        moving |= {joint.child} if joint.parent in moving else set()
    for link in robot.links:
        rotation, position = (part[0] for part in poses[link.name])
        for shape in link.collisions:
            if shape.kind != "mesh":
                pose = Pose(position=position, rotation=rotation).then(shape.origin, shape.rpy)
                moves = link.name in moving or not scenario.fixed_base
                yield Body(link.name, shape.kind, _half(shape.kind, shape.size), pose, moves)
