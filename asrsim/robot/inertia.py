"""Mass matrix of a robot at the zero pose, for the checks of a file before anything is built; poses of links by yourdfpy."""

from __future__ import annotations

from dataclasses import dataclass
from io import BytesIO
from math import cos, sin

import numpy as np
from lxml import etree

from asrsim.robot.model import Link, Robot, Vector


@dataclass(frozen=True, kw_only=True)
class ZeroPoseInertia:
    """Inertia of the moving joints at the zero pose, base fixed."""

    names: tuple[str, ...]
    """Moving joints, in file order."""
    matrix: np.ndarray
    """(n, n) mass matrix, kg m^2 (kg for prismatic joints)."""

    @property
    def diagonal(self) -> dict[str, float]:
        """Inertia of everything behind each joint about its axis, the other joints locked."""
        return {name: float(self.matrix[i, i]) for i, name in enumerate(self.names)}

    @property
    def effective(self) -> dict[str, float]:
        """Inertia that a torque on one joint meets while all other joints are free: 1 / (M^-1)_ii, at most the diagonal.

        Joints whose row makes the matrix singular (massless ends of chains) have 0.
        """
        scale = np.sqrt(np.diag(self.matrix))
        result = dict.fromkeys(self.names, 0.0)
        alive = [i for i in range(len(self.names)) if scale[i] > 0.0]
        if not alive:
            return result
        normalised = self.matrix[np.ix_(alive, alive)] / np.outer(scale[alive], scale[alive])
        values, vectors = np.linalg.eigh(normalised)
        # 1e-12: below it a direction carries no mass to double precision.
        inverse = (vectors**2) @ (1.0 / np.maximum(values, 1e-12))
        result.update({self.names[i]: float(scale[i] ** 2 / inverse[k]) for k, i in enumerate(alive)})
        return result


def zero_pose_inertia(robot: Robot) -> ZeroPoseInertia:
    """Mass matrix at the zero pose with a fixed base; links without inertia count as massless."""
    moving = robot.moving_joints
    index = {joint.name: i for i, joint in enumerate(moving)}
    parents = {joint.child: joint for joint in robot.joints}
    frames = link_frames(robot)
    matrix = np.zeros((len(moving), len(moving)))
    for link in robot.links:
        if not link.mass and link.inertia is None:
            continue
        rotation, position = frames[link.name]
        centre = position + rotation @ np.array(link.centre_of_mass)
        linear = np.zeros((3, len(moving)))
        angular = np.zeros((3, len(moving)))
        name = link.name
        while name in parents:
            joint = parents[name]
            if joint.name in index:
                joint_rotation, joint_position = frames[name]
                axis = joint_rotation @ np.array(joint.axis)
                column = index[joint.name]
                if joint.kind == "prismatic":
                    linear[:, column] = axis
                else:
                    linear[:, column] = np.cross(axis, centre - joint_position)
                    angular[:, column] = axis
            name = joint.parent
        tensor = rotation @ _inertia(link) @ rotation.T
        matrix += (link.mass or 0.0) * linear.T @ linear + angular.T @ tensor @ angular
    return ZeroPoseInertia(names=tuple(joint.name for joint in moving), matrix=matrix)


def rotation_matrix(rpy: Vector) -> np.ndarray:
    """(3, 3) rotation of URDF's roll, pitch, yaw in rad (about fixed x, y, z)."""
    r, p, y = rpy
    return np.array(
        (
            (cos(y) * cos(p), cos(y) * sin(p) * sin(r) - sin(y) * cos(r), cos(y) * sin(p) * cos(r) + sin(y) * sin(r)),
            (sin(y) * cos(p), sin(y) * sin(p) * sin(r) + cos(y) * cos(r), sin(y) * sin(p) * cos(r) - cos(y) * sin(r)),
            (-sin(p), cos(p) * sin(r), cos(p) * cos(r)),
        )
    )


def link_frames(robot: Robot) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Rotation (3, 3) and position (3,) m of every link in the root's frame at the zero pose."""
    from yourdfpy import URDF

    model = URDF.load(BytesIO(_skeleton(robot)), build_scene_graph=True, load_meshes=False, load_collision_meshes=False)
    poses = {link.name: model.get_transform(link.name) for link in robot.links}
    return {name: (pose[:3, :3], pose[:3, 3]) for name, pose in poses.items()}


def _skeleton(robot: Robot) -> bytes:
    """The robot's tree as URDF: links and joints at the zero pose, without what a reader of shapes might stumble over."""
    root = etree.Element("robot", name=robot.name)
    for link in robot.links:
        etree.SubElement(root, "link", name=link.name)
    for joint in robot.joints:
        element = etree.SubElement(root, "joint", name=joint.name, type="fixed")
        etree.SubElement(element, "parent", link=joint.parent)
        etree.SubElement(element, "child", link=joint.child)
        etree.SubElement(element, "origin", xyz=_numbers(joint.origin), rpy=_numbers(joint.rpy))
    text: bytes = etree.tostring(root)
    return text


def _numbers(vector: Vector) -> str:
    return " ".join(map(repr, vector))


def _inertia(link: Link) -> np.ndarray:
    xx, xy, xz, yy, yz, zz = link.inertia or (0.0,) * 6
    turned = rotation_matrix(link.inertial_rpy)
    tensor: np.ndarray = turned @ np.array(((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))) @ turned.T
    return tensor
