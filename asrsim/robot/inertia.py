"""Mass matrix of a robot at the zero pose in plain numpy, for the checks of a file before anything is built."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, sin

import numpy as np

from asrsim.robot.model import Joint, Link, Robot, Vector


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
    links = {link.name: link for link in robot.links}
    frames: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    for name in links:
        _frame(name, parents, frames)
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


def _frame(
    name: str, parents: dict[str, Joint], frames: dict[str, tuple[np.ndarray, np.ndarray]]
) -> tuple[np.ndarray, np.ndarray]:
    """Rotation and position of a link in the root's frame; walks up without recursion, deep chains are legal."""
    chain = []
    while name not in frames and name in parents:
        joint = parents[name]
        chain.append((name, joint))
        name = joint.parent
    rotation, position = frames.setdefault(name, (np.eye(3), np.zeros(3)))
    for child, joint in reversed(chain):
        position = position + rotation @ np.array(joint.origin)
        rotation = rotation @ rotation_matrix(joint.rpy)
        frames[child] = (rotation, position)
    return rotation, position


def _inertia(link: Link) -> np.ndarray:
    xx, xy, xz, yy, yz, zz = link.inertia or (0.0,) * 6
    turned = rotation_matrix(link.inertial_rpy)
    tensor: np.ndarray = turned @ np.array(((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))) @ turned.T
    return tensor
