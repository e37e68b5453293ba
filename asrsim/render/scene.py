"""The scene that pictures show: shapes of robot and world, and the frames of the bodies for given joint positions."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from asrsim.render.meshes import main_colour, simplified, smooth
from asrsim.render.urdf import origin_frame, urdf_of
from asrsim.robot import Robot
from asrsim.robot.dynamics import robot_model
from asrsim.robot.meshes import mesh_fault
from asrsim.robot.model import Vector
from asrsim.robot.poses import frame
from asrsim.samples import Array
from asrsim.scenario.data import Scenario

if TYPE_CHECKING:
    from trimesh import Trimesh

GREY = (0.55, 0.58, 0.63)
"""Colour for a shape that has no colour of its own, distinct from the background and from white."""


@dataclass(frozen=True, kw_only=True)
class ScenePart:
    """One shape of a body, in the frame of the body."""

    body: str
    """Name of the body: a link, or an object of the world."""
    mesh: Trimesh
    colour: Array
    """Red, green and blue (3,), 0 to 1."""


class RenderScene:
    """Shapes of robot and world, and the frames of the bodies for given joint positions.

    robot: robot from `asrsim.render.shapes.drawable`; base and world come from the scenario. `notes` name the meshes that could
    not be read.
    """

    def __init__(self, robot: Robot, scenario: Scenario) -> None:
        world, self._scenario = scenario.world, scenario
        self.notes: list[str] = []
        self._base = origin_frame(scenario.base_position, scenario.base_rpy)
        """Frame (4, 4) of the root link in the initial state."""
        self.model = robot_model(scenario, robot)
        self.parents = {joint.child: joint.parent for joint in robot.joints}
        """Parent link of each link except the root link."""
        self.ground = world.ground_height if world.ground else None
        """Height of the ground, m; None without ground."""
        self.objects = {item.name: origin_frame(item.position, item.rpy) for item in world.objects}
        shapes = {item.name: replace(item.solid, colour=item.colour) for item in world.objects}
        for name, shape in list(shapes.items()):
            fault = mesh_fault(Path(shape.mesh)) if shape.kind == "mesh" else None
            if fault is not None:
                self.notes.append(f"the mesh of '{name}' is not drawn: {Path(shape.mesh).name} {fault}")
                del shapes[name]
        self.urdf = urdf_of(robot, shapes)
        """Robot and objects as one robot of yourdfpy."""
        self.parts = tuple(_parts(self.urdf.scene))

    def frames(self, positions: Mapping[str, float], poses: Mapping[str, Array]) -> dict[str, Array]:
        """Frame (4, 4) of each body in the world.

        positions: position of each joint in rad or m, 0 if missing; poses: pose (x y z, quaternion x y z w) of each object and
        of a floating base.
        """
        name = self.model.robot.root.name
        root = _pose_frame(poses[name]) if name in poses else self._base
        frames = self.model.poses([positions.get(joint, 0.0) for joint in self.model.joints], root)
        for name, at_start in self.objects.items():
            frames[name] = _pose_frame(poses[name]) if name in poses else at_start
        return frames

    def of_collisions(self) -> RenderScene:
        """Scene of the same robot and world in which the robot has its collision shapes instead of its visuals."""
        links = tuple(replace(link, visuals=link.collisions) for link in self.model.robot.links)
        return RenderScene(replace(self.model.robot, links=links), self._scenario)

    def tip(self) -> tuple[str, Vector]:
        """Last link that a joint moves, and its far end in the frame of the link, m. The middle of the link's shapes is taken
        as half the way to this end.
        """
        moved = [joint.child for joint in self.model.robot.outward_joints if joint.moves]
        name = moved[-1] if moved else self.model.robot.root.name
        points = [part.mesh.vertices for part in self.parts if part.body == name]
        x, y, z = (2.0 * np.concatenate(points).mean(axis=0) if points else np.zeros(3)).tolist()
        return name, (x, y, z)

    def axes(self, frames: Mapping[str, Array]) -> dict[str, Array]:
        """Axis (3,) of each revolute joint in the world."""
        turning = [joint for joint in self.model.robot.joints if joint.kind in ("revolute", "continuous")]
        return {joint.name: frames[joint.child][:3, :3] @ joint.axis for joint in turning}


def _parts(scene: Any) -> Iterator[ScenePart]:
    """Shapes of each body in a trimesh scene. scene: scene that yourdfpy has made, so that the parent of a shape's frame is the
    shape's body."""
    from trimesh import Trimesh

    graph, found = scene.graph, defaultdict[str, list[Any]](list)
    for node in graph.nodes_geometry:
        body = graph.transforms.parents[node]
        place, name = graph.get(node, body)
        mesh = scene.geometry[name]
        # Leave textures out, since they would be copied with each mesh.
        found[body].append((Trimesh(mesh.vertices, mesh.faces).apply_transform(place), main_colour(mesh)))
    for body, shapes in found.items():
        meshes, colours = zip(*shapes, strict=True)
        for mesh, colour in zip(simplified(meshes), colours, strict=True):
            yield ScenePart(body=body, mesh=smooth(mesh), colour=np.array(GREY) if colour is None else colour)


def _pose_frame(pose: Array) -> Array:
    """Frame (4, 4) of a logged pose: x y z (m), quaternion x y z w."""
    from scipy.spatial.transform import Rotation

    return frame(pose[:3], np.asarray(Rotation.from_quat(pose[3:7]).as_matrix()))
