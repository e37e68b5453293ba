"""Shapes of robot and world, and their frames for given joint positions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from asrsim.render.meshes import read_mesh, solid
from asrsim.robot import Robot
from asrsim.robot.model import Vector
from asrsim.robot.poses import frame, rotation_matrix
from asrsim.samples import Array
from asrsim.scenario import robot_model
from asrsim.scenario.data import Scenario

if TYPE_CHECKING:
    from trimesh import Trimesh

GREY = (0.55, 0.58, 0.63)
"""Colour of a shape without colour, distinct from the background and from white."""


@dataclass(frozen=True, kw_only=True)
class ScenePart:
    """Shape of a body, in the body's frame."""

    body: str
    """Link, or object of the world."""
    mesh: Trimesh
    colour: Array
    """Red, green and blue (3,), 0 to 1."""


class RenderScene:
    """Shapes of robot and world, and their frames at given positions.

    robot: from `asrsim.render.shapes.drawable`; base and world come from the scenario. `notes` name the meshes that could
    not be read.
    """

    def __init__(self, robot: Robot, scenario: Scenario) -> None:
        world = scenario.world
        self.notes: list[str] = []
        self._base = _rpy_frame(scenario.base_position, scenario.base_rpy)
        """Frame (4, 4) of the root link at the start."""
        self._model = robot_model(scenario, robot)
        self.parents = {joint.child: joint.parent for joint in robot.joints}
        """Parent of each link but the root."""
        self.ground = world.ground_height if world.ground else None
        """Height of the ground, m; None without ground."""
        self.objects = {item.name: _rpy_frame(item.position, item.rpy) for item in world.objects}
        self.parts: list[ScenePart] = []
        self._read = cache(read_mesh)
        for link in robot.links:
            for shape in link.visuals:
                origin = _rpy_frame(shape.origin, shape.rpy)
                if shape.kind == "mesh":
                    self._add_file(link.name, Path(shape.mesh), shape.scale, shape.colour, origin)
                else:
                    self._add(link.name, solid(shape.kind, shape.size), shape.colour, origin)
        for item in world.objects:
            if item.mesh is not None:
                self._add_file(item.name, item.mesh, item.size, item.colour, np.eye(4))
            else:
                self._add(item.name, solid(item.shape, item.size), item.colour, np.eye(4))

    def _add_file(self, body: str, file: Path, scale: Sequence[float], colour: Sequence[float] | None, origin: Array) -> None:
        """Add the parts of the mesh in a file, or a note if the file cannot be read."""
        try:
            parts = self._read(file)
        except (OSError, ValueError) as error:
            self.notes.append(f"a mesh of '{body}' is not drawn: {file.name} {error}")
            return
        for mesh, own in parts:
            self._add(body, mesh, own if colour is None else colour, origin @ np.diag([*scale, 1.0]))

    def _add(self, body: str, mesh: Trimesh, colour: Sequence[float] | Array | None, origin: Array) -> None:
        placed = mesh.copy().apply_transform(origin)
        shown = np.clip(GREY if colour is None else colour[:3], 0.0, 1.0)
        self.parts.append(ScenePart(body=body, mesh=placed, colour=shown))

    def frames(self, positions: Mapping[str, float], poses: Mapping[str, Array]) -> dict[str, Array]:
        """Frame (4, 4) of each body in the world.

        positions: position of each joint in rad or m, 0 if missing; poses: pose (x y z, quaternion x y z w) of each object and
        of a floating base.
        """
        name = self._model.robot.root.name
        root = _pose_frame(poses[name]) if name in poses else self._base
        frames = self._model.poses([positions.get(joint, 0.0) for joint in self._model.joints], root)
        for name, at_start in self.objects.items():
            frames[name] = _pose_frame(poses[name]) if name in poses else at_start
        return frames

    def axes(self, frames: Mapping[str, Array]) -> dict[str, Array]:
        """Axis (3,) of each revolute joint in the world."""
        turning = [joint for joint in self._model.robot.joints if joint.kind in ("revolute", "continuous")]
        return {joint.name: frames[joint.child][:3, :3] @ joint.axis for joint in turning}


def _rpy_frame(position: Vector, rpy: Vector) -> Array:
    """Frame (4, 4) of a URDF `<origin xyz rpy>`, m and rad."""
    return frame(np.array(position), rotation_matrix(rpy))


def _pose_frame(pose: Array) -> Array:
    """Frame (4, 4) of a logged pose: x y z (m), quaternion x y z w."""
    from scipy.spatial.transform import Rotation

    return frame(pose[:3], np.asarray(Rotation.from_quat(pose[3:7]).as_matrix()))
