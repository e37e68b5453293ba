"""Inertia of links, and the mass matrix of a robot at the zero pose, for checks of its file."""

from __future__ import annotations

import numpy as np

from asrsim.robot.model import Link, Robot, Vector
from asrsim.robot.poses import link_poses, roll_pitch_yaw, rotation_matrix


def zero_pose_matrix(robot: Robot) -> np.ndarray:
    """Mass matrix (n, n) of the moving joints at the zero pose with a fixed base, kg m^2 (kg for prismatic joints).

    Links without inertia count as massless.
    """
    columns = {joint.name: i for i, joint in enumerate(robot.moving_joints)}
    parents = {joint.child: joint for joint in robot.joints}
    poses = link_poses(robot)
    matrix = np.zeros((len(columns), len(columns)))
    for link in robot.links:
        if not link.mass and link.inertia is None:
            continue
        pose = poses[link.name]
        centre = pose.position + pose.rotation @ link.centre_of_mass
        linear, angular = np.zeros((3, len(columns))), np.zeros((3, len(columns)))
        name = link.name
        while name in parents:
            joint = parents[name]
            if joint.moves:
                axis = poses[name].rotation @ joint.axis
                column = columns[joint.name]
                if joint.kind == "prismatic":
                    linear[:, column] = axis
                else:
                    linear[:, column] = np.cross(axis, centre - poses[name].position)
                    angular[:, column] = axis
            name = joint.parent
        tensor = pose.rotation @ inertia_tensor(link) @ pose.rotation.T
        matrix += (link.mass or 0.0) * linear.T @ linear + angular.T @ tensor @ angular
    return matrix


def inertia_tensor(link: Link) -> np.ndarray:
    """Inertia tensor (3, 3) about the centre of mass, along the axes of the link's frame, kg m^2."""
    turned = rotation_matrix(link.inertial_rpy)
    tensor: np.ndarray = turned @ _own_tensor(link) @ turned.T
    return tensor


def principal_axes(link: Link) -> tuple[Vector, Vector]:
    """Principal moments in kg m^2, at least 0, and roll, pitch, yaw of their axes in the link's frame, rad.

    Engines diagonalise a full tensor with their own tolerances (PyBullet: relative errors of 1e-10 in the mass matrix of a
    robot of 50 links), but use a diagonal tensor unchanged.
    """
    tensor = _own_tensor(link)
    if not (tensor - np.diag(np.diag(tensor))).any():
        return (float(tensor[0, 0]), float(tensor[1, 1]), float(tensor[2, 2])), link.inertial_rpy
    moments, axes = np.linalg.eigh(tensor)
    if np.linalg.det(axes) < 0.0:
        axes[:, 0] *= -1.0
    xx, yy, zz = (max(float(moment), 0.0) for moment in moments)
    return (xx, yy, zz), roll_pitch_yaw(rotation_matrix(link.inertial_rpy) @ axes)


def _own_tensor(link: Link) -> np.ndarray:
    """Inertia tensor (3, 3) along the axes of the inertial frame, kg m^2."""
    xx, xy, xz, yy, yz, zz = link.inertia or (0.0,) * 6
    return np.array(((xx, xy, xz), (xy, yy, yz), (xz, yz, zz)))
