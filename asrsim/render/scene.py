"""Shapes of robot and world, and their frames for given joint positions."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from asrsim.render.mesh_files import read_mesh
from asrsim.render.solids import Mesh, box, capsule, cylinder, flat, sphere
from asrsim.robot import Robot
from asrsim.robot.model import Vector
from asrsim.robot.poses import frame, rotation_matrix
from asrsim.samples import Array
from asrsim.scenario import robot_model
from asrsim.scenario.data import Scenario, World

GREY = (0.55, 0.58, 0.63)
"""Colour of a shape without colour, distinct from the background and from white."""


@dataclass(frozen=True, kw_only=True)
class ScenePart:
    """Shape of a body, in the body's frame."""

    body: str
    """Link, or object of the world."""
    mesh: Mesh
    colours: Array
    """Red, green and blue of each triangle (m, 3), 0 to 1."""


class RenderScene:
    """Shapes of robot and world, and their frames at given positions.

    robot: from `asrsim.render.shapes.drawable`; base and world come from the scenario. `notes` name the meshes that could
    not be read.
    """

    def __init__(self, robot: Robot, scenario: Scenario) -> None:
        world = scenario.world
        self.notes: list[str] = []
        self.base = _rpy_frame(scenario.base_position, scenario.base_rpy)
        """Frame (4, 4) of the root link at the start."""
        self._model = robot_model(scenario, robot)
        self.joints = robot.outward_joints
        """Joints sorted so that a parent's joint precedes its children's."""
        self.origins = {joint.name: _rpy_frame(joint.origin, joint.rpy) for joint in self.joints}
        """Frame (4, 4) of each joint in the frame of its parent link."""
        self.root = robot.root.name
        self.ground = world.ground_height if world.ground else None
        """Height of the ground, m; None without ground."""
        self.objects = {item.name: _rpy_frame(item.position, item.rpy) for item in world.objects}
        self._read = cache(read_mesh)
        self.parts = self._parts(robot, world)

    def frames(self, positions: Mapping[str, float], poses: Mapping[str, Array]) -> dict[str, Array]:
        """Frame (4, 4) of each body in the world.

        positions: position of each joint in rad or m, 0 if missing; poses: pose (x y z, quaternion x y z w) of each object and
        of a floating base.
        """
        root = _pose_frame(poses[self.root]) if self.root in poses else self.base
        frames = self._model.poses([positions.get(joint, 0.0) for joint in self._model.joints], root)
        for name, at_start in self.objects.items():
            frames[name] = _pose_frame(poses[name]) if name in poses else at_start
        return frames

    def axes(self, frames: Mapping[str, Array]) -> dict[str, Array]:
        """Axis (3,) of each revolute joint in the world."""
        return {j.name: frames[j.child][:3, :3] @ j.axis for j in self.joints if j.kind in ("revolute", "continuous")}

    def _parts(self, robot: Robot, world: World) -> list[ScenePart]:
        shapes: list[tuple[str, str, str, Sequence[float], Path | None, Array, Sequence[float] | None]] = [
            (link.name, f"the mesh of link '{link.name}'", shape.kind, shape.scale if shape.kind == "mesh" else shape.size,
             Path(shape.mesh) if shape.kind == "mesh" else None, _rpy_frame(shape.origin, shape.rpy), shape.colour)
            for link in robot.links for shape in link.visuals
        ]  # fmt: skip
        shapes += [
            (item.name, f"object '{item.name}'", item.shape, item.size, item.mesh, np.eye(4), item.colour)
            for item in world.objects
        ]
        parts = []
        for body, what, kind, size, file, origin, colour in shapes:
            mesh = self._mesh(kind, size, file, what)
            if mesh is not None:
                placed = _placed(mesh, origin)
                parts.append(ScenePart(body=body, mesh=placed, colours=_coloured(placed, colour)))
        return parts

    def _mesh(self, kind: str, size: Sequence[float], file: Path | None, what: str) -> Mesh | None:
        """Solid of the given size in m, or the mesh in a file times `size`; None and a note if the file cannot be read."""
        if file is None:
            return box(np.array(size)) if kind == "box" else _ROUND[kind](*size)
        try:
            mesh = self._read(file)
        except (OSError, ValueError) as error:
            self.notes.append(f"{what} is not drawn: {error}")
            return None
        return mesh if set(size) == {1.0} else flat(mesh.points * np.array(size), mesh.triangles, mesh.colours)


_ROUND: dict[str, Callable[..., Mesh]] = {"sphere": sphere, "cylinder": cylinder, "capsule": capsule}


def _rpy_frame(position: Vector, rpy: Vector) -> Array:
    """Frame (4, 4) of a URDF `<origin xyz rpy>`, m and rad."""
    return frame(np.array(position), rotation_matrix(rpy))


def _pose_frame(pose: Array) -> Array:
    """Frame (4, 4) of a logged pose: x y z (m), quaternion x y z w."""
    from scipy.spatial.transform import Rotation

    return frame(pose[:3], np.asarray(Rotation.from_quat(pose[3:7]).as_matrix()))


def _placed(mesh: Mesh, origin: Array) -> Mesh:
    rotation = origin[:3, :3]
    points = mesh.points @ rotation.T + origin[:3, 3]
    return Mesh(points=points, triangles=mesh.triangles, normals=mesh.normals @ rotation.T, colours=mesh.colours)


def _coloured(mesh: Mesh, colour: Sequence[float] | None) -> Array:
    """Colours of the triangles (m, 3): from the URDF, else from the mesh file, else grey."""
    given = np.full((len(mesh.triangles), 3), np.nan) if mesh.colours is None or colour is not None else mesh.colours
    return np.clip(np.where(np.isnan(given), GREY if colour is None else colour[:3], given), 0.0, 1.0)
