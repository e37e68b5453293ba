"""Inertia of links."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from asrsim.robot.model import Inertia, Link, Vector
from asrsim.robot.poses import roll_pitch_yaw, rotation_matrix


def inertia_tensor(link: Link) -> np.ndarray:
    """Inertia tensor (3, 3) about the centre of mass, along the axes of the link's frame, kg m^2."""
    turned = rotation_matrix(link.inertial_rpy)
    tensor: np.ndarray = turned @ tensor_of(link.inertia or (0.0,) * 6) @ turned.T
    return tensor


def principal_axes(link: Link) -> tuple[Vector, Vector]:
    """Principal moments in kg m^2, at least 0, and roll, pitch, yaw of their axes in the link's frame, rad.

    Engines diagonalise a full tensor with limited accuracy (PyBullet: relative errors of 1e-10 in the mass matrix of a robot
    with 50 links), but use a diagonal tensor unchanged.
    """
    tensor = tensor_of(link.inertia or (0.0,) * 6)
    if not (tensor - np.diag(np.diag(tensor))).any():
        return (float(tensor[0, 0]), float(tensor[1, 1]), float(tensor[2, 2])), link.inertial_rpy
    moments, axes = np.linalg.eigh(tensor)
    if np.linalg.det(axes) < 0.0:
        axes[:, 0] *= -1.0
    xx, yy, zz = (max(float(moment), 0.0) for moment in moments)
    return (xx, yy, zz), roll_pitch_yaw(rotation_matrix(link.inertial_rpy) @ axes)


def principal_moments(inertia: Sequence[float]) -> list[float]:
    """Principal moments in kg m^2 in rising order, from the six numbers in the order of `asrsim.robot.model.INERTIAS`."""
    xx, xy, xz, yy, yz, zz = inertia
    # Most tensors are diagonal, and every evaluation of a fit calls this function.
    found: list[float] = np.linalg.eigvalsh(tensor_of(inertia)).tolist() if xy or xz or yz else sorted((xx, yy, zz))
    return found


def tensor_of(inertia: Iterable[float]) -> np.ndarray:
    """Inertia tensor (3, 3) from its six numbers, in the order of `asrsim.robot.model.INERTIAS`."""
    xx, xy, xz, yy, yz, zz = inertia
    return np.array(((xx, xy, xz), (xy, yy, yz), (xz, yz, zz)))


def second_moments(inertia: Iterable[float]) -> np.ndarray:
    """Second moments of mass (3, 3), the integral of x x^T over the mass, kg m^2, from six numbers of an inertia. A body has
    this inertia only if no eigenvalue is negative: then no principal moment exceeds the sum of the other two.
    """
    tensor = tensor_of(inertia)
    moments: np.ndarray = 0.5 * np.trace(tensor) * np.eye(3) - tensor
    return moments


def nearest_possible(inertia: Inertia, least: float = 0.0) -> Inertia:
    """The physically possible inertia whose second moments are closest to the second moments of `inertia`.

    least: smallest eigenvalue of the second moments, as a fraction of their trace. Source: the condition is by Wensing, Kim and
    Slotine (2018), Linear matrix inequalities for physically consistent inertial parameter identification.
    """
    moments = second_moments(inertia)
    sizes, axes = np.linalg.eigh(moments)
    floor = least * max(float(np.trace(moments)), 0.0)
    if sizes[0] >= floor:
        return inertia
    nearest = (axes * np.maximum(sizes, floor)) @ axes.T
    return numbers_of(np.trace(nearest) * np.eye(3) - nearest)


def numbers_of(tensor: np.ndarray) -> Inertia:
    """Six numbers of an inertia tensor (3, 3)."""
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = tensor.tolist()
    return xx, xy, xz, yy, yz, zz
