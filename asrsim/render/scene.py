"""What there is to see: the robot's and the world's shapes, and where its joints put them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree

from asrsim.render.frames import about, frame, pose_frame, rpy_frame
from asrsim.render.mesh_files import read_mesh
from asrsim.render.solids import Mesh, box, capsule, cylinder, scaled, sphere
from asrsim.samples import Array
from asrsim.scenario.data import World, WorldObject

GREY = (0.55, 0.58, 0.63)
"""Of a shape without colour: told from the background and from white."""


@dataclass(frozen=True, kw_only=True)
class Part:
    """One shape of a body, in the body's frame."""

    body: str
    """Link, or object of the world."""
    mesh: Mesh
    colours: Array
    """(m, 3) red, green, blue from 0 to 1 of each triangle."""


@dataclass(frozen=True, kw_only=True)
class TreeJoint:
    """A joint of the robot's tree as kinematics needs it."""

    name: str
    kind: str
    parent: str
    child: str
    origin: Array
    """(4, 4), in the parent's frame."""
    axis: Array
    """(3,)"""


class Scene:
    """Shapes of robot and world, and their frames at given positions.

    urdf: text with a `<visual>` for every link that is to be seen (:func:`asrsim.render.shapes.drawable`), meshes as absolute
    names; base: (4, 4) frame of the root link. `notes` say which meshes could not be read.
    """

    def __init__(self, urdf: str, base: Array, world: World) -> None:
        root = etree.fromstring(urdf.encode(), etree.XMLParser(resolve_entities=False, no_network=True, huge_tree=True))
        self.notes: list[str] = []
        self.base = base
        self.joints = _ordered([_joint(element) for element in root.findall("joint")])
        """A parent's joint comes before its children's."""
        children = {joint.child for joint in self.joints}
        self.root = next((link.get("name", "") for link in root.findall("link") if link.get("name") not in children), "")
        self.ground = world.ground_height if world.ground else None
        """m, height of the ground, None without one."""
        self.objects = {item.name: rpy_frame(np.array(item.position), np.array(item.rpy)) for item in world.objects}
        self.parts = self._robot_parts(root) + self._object_parts(world)

    def frames(self, positions: Mapping[str, float], poses: Mapping[str, Array]) -> dict[str, Array]:
        """Body -> (4, 4) frame in the world.

        positions: joint -> rad or m, 0 where it is missing; poses: body -> x y z, quaternion x y z w, of objects and of a
        floating base.
        """
        frames = {self.root: pose_frame(poses[self.root]) if self.root in poses else self.base}
        for joint in self.joints:
            frames[joint.child] = frames[joint.parent] @ joint.origin @ motion(joint, positions.get(joint.name, 0.0))
        for name, at_start in self.objects.items():
            frames[name] = pose_frame(poses[name]) if name in poses else at_start
        return frames

    def axes(self, frames: Mapping[str, Array]) -> dict[str, Array]:
        """Joint that turns -> (3,) its axis in the world."""
        return {j.name: frames[j.child][:3, :3] @ j.axis for j in self.joints if j.kind in ("revolute", "continuous")}

    def _robot_parts(self, root: Any) -> list[Part]:
        palette = {m.get("name"): _rgb(m.find("color")) for m in root.findall("material") if m.find("color") is not None}
        meshes: dict[str, Mesh] = {}
        parts = []
        for link in root.findall("link"):
            for visual in link.findall("visual"):
                mesh = self._mesh(visual.find("geometry"), meshes, link.get("name", ""))
                if mesh is None:
                    continue
                material = visual.find("material")
                colour = None
                if material is not None:
                    own = material.find("color")
                    colour = _rgb(own) if own is not None else palette.get(material.get("name"))
                origin = visual.find("origin")
                placed = _placed(mesh, rpy_frame(vector(origin, "xyz"), vector(origin, "rpy")))
                parts.append(Part(body=link.get("name", ""), mesh=placed, colours=_coloured(placed, colour)))
        return parts

    def _mesh(self, geometry: Any, meshes: dict[str, Mesh], link: str) -> Mesh | None:
        shape = None if geometry is None else next((child for child in geometry if isinstance(child.tag, str)), None)
        if shape is None:
            return None
        if shape.tag == "mesh":
            name = shape.get("filename", "")
            try:
                mesh = meshes[name] = meshes.get(name) or read_mesh(Path(name))
            except (OSError, ValueError) as error:
                self.notes.append(f"the mesh of link '{link}' is not drawn: {error}")
                return None
            scale = vector(shape, "scale", 1.0)
            return mesh if (scale == 1.0).all() else scaled(mesh, scale)
        if shape.tag == "box":
            return box(vector(shape, "size"))
        radius, length = float(shape.get("radius", "0")), float(shape.get("length", "0"))
        makers = {"sphere": lambda: sphere(radius), "cylinder": lambda: cylinder(radius, length),
                  "capsule": lambda: capsule(radius, length)}  # fmt: skip
        return makers[shape.tag]() if shape.tag in makers else None

    def _object_parts(self, world: World) -> list[Part]:
        parts = []
        for item in world.objects:
            try:
                mesh = _object_mesh(item)
            except (OSError, ValueError) as error:
                self.notes.append(f"object '{item.name}' is not drawn: {error}")
                continue
            parts.append(Part(body=item.name, mesh=mesh, colours=_coloured(mesh, np.array(item.colour[:3]))))
        return parts


def motion(joint: TreeJoint, position: float) -> Array:
    """(4, 4) what a joint's position (rad, m) does to its child."""
    if joint.kind in ("revolute", "continuous"):
        return frame(np.zeros(3), about(joint.axis, position))
    if joint.kind == "prismatic":
        return frame(position * joint.axis, np.eye(3))
    return np.eye(4)


def vector(element: Any, key: str, default: float = 0.0) -> Array:
    """(3,) numbers of an attribute; one number stands for three."""
    text = element.get(key) if element is not None else None
    values = np.array([float(part) for part in (text or "").split()], dtype=np.float64)
    return values if len(values) == 3 else np.full(3, values[0] if len(values) == 1 else default)


def _joint(element: Any) -> TreeJoint:
    origin, axis = element.find("origin"), element.find("axis")
    direction = vector(axis, "xyz") if axis is not None else np.array([1.0, 0.0, 0.0])
    length = float(np.linalg.norm(direction))
    return TreeJoint(
        name=element.get("name", ""), kind=element.get("type", "fixed"), parent=element.find("parent").get("link", ""),
        child=element.find("child").get("link", ""), origin=rpy_frame(vector(origin, "xyz"), vector(origin, "rpy")),
        axis=direction / length if length > 0 else direction,
    )  # fmt: skip


def _ordered(joints: list[TreeJoint]) -> tuple[TreeJoint, ...]:
    by_parent: dict[str, list[TreeJoint]] = {}
    for joint in joints:
        by_parent.setdefault(joint.parent, []).append(joint)
    children = {joint.child for joint in joints}
    queue = [joint for joint in joints if joint.parent not in children]
    for joint in queue:
        queue += by_parent.get(joint.child, [])
    return tuple(queue)


def _object_mesh(item: WorldObject) -> Mesh:
    size = np.array(item.size, dtype=np.float64)
    if item.shape == "mesh" and item.mesh is not None:
        mesh = read_mesh(item.mesh)
        return scaled(mesh, size) if len(size) == 3 else mesh
    if item.shape == "sphere":
        return sphere(float(size[0]))
    if item.shape == "cylinder":
        return cylinder(float(size[0]), float(size[1]))
    return box(size)


def _placed(mesh: Mesh, origin: Array) -> Mesh:
    rotation = origin[:3, :3]
    points = mesh.points @ rotation.T + origin[:3, 3]
    return Mesh(points=points, triangles=mesh.triangles, normals=mesh.normals @ rotation.T, colours=mesh.colours)


def _coloured(mesh: Mesh, colour: Array | None) -> Array:
    """(m, 3): the URDF's colour, else the file's own, else grey."""
    given = np.full((len(mesh.triangles), 3), np.nan) if mesh.colours is None or colour is not None else mesh.colours
    return np.clip(np.where(np.isnan(given), GREY if colour is None else colour, given), 0.0, 1.0)


def _rgb(element: Any) -> Array | None:
    values = [float(part) for part in (element.get("rgba") or "").split()] if element is not None else []
    return np.array(values[:3]) if len(values) >= 3 else None
