"""Mass matrix and bias of the robot without its world, by PyBullet's routines on a separate physics client.

PyBullet reads only files, may crash on a mesh, and prints to the terminal. Its dynamics routines follow unusual conventions,
which this module converts. The routines order the degrees of freedom by Bullet's links. For a floating base, the routines use
the principal axes of the base's inertia, with angular before linear velocity, and ignore the base's orientation. Forces on the
base are returned with linear before angular components.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import BuiltinFunctionType
from typing import Any
from weakref import finalize

import numpy as np

from asrsim.engines.foreign import crashes, quiet
from asrsim.errors import RobotError
from asrsim.robot.engine_text import engine_urdf
from asrsim.robot.inertia import principal_axes
from asrsim.robot.merge import merge_fixed
from asrsim.robot.model import Robot
from asrsim.samples import Array
from asrsim.scenario.data import Scenario

BASE = 6
"""Degrees of freedom of a floating base."""


class Client:
    """PyBullet's functions on a physics client of their own (28 MB), and PyBullet's constants. No other class imports PyBullet.

    `close` ends the client; the client ends at the latest when this object is garbage-collected.
    """

    def __init__(self) -> None:
        with quiet():
            import pybullet

            self._module: Any = pybullet
            self._number = pybullet.connect(pybullet.DIRECT)
        self.close = finalize(self, _disconnect, pybullet, self._number)

    def __getattr__(self, name: str) -> Any:
        value = getattr(self._module, name)
        if isinstance(value, BuiltinFunctionType):
            value = partial(value, physicsClientId=self._number)
        setattr(self, name, value)
        return value


def _disconnect(p: Any, number: int) -> None:
    with suppress(p.error), quiet():
        p.disconnect(number)


class BulletDynamics:
    """Mass matrix and bias of a robot, computed by PyBullet. Raises RobotError for a robot that PyBullet cannot simulate."""

    def __init__(self, scenario: Scenario, robot: Robot) -> None:
        self.p = p = Client()
        self.close = p.close
        merged = merge_fixed(robot)
        bare = replace(merged.robot, links=tuple(replace(link, collisions=()) for link in merged.robot.links))
        text, _ = engine_urdf(bare)
        self._load = partial(load_body, p, text, scenario, bare)
        self._scenario, self._robot = scenario, bare
        self._body, index = self._load()
        self.indices = [index[joint.child] for joint in bare.moving_joints]
        self.root, self.joints = bare.root.name, tuple(joint.name for joint in bare.moving_joints)
        self.free = 0 if scenario.fixed_base else BASE
        # Bullet's dynamics routines order degrees of freedom by its links; the order in the file may differ.
        self._to_bullet = np.argsort(self.indices).tolist()
        joints = (self.free + np.argsort(self._to_bullet)).tolist()
        # The base: translation before rotation.
        rows = np.array([3, 4, 5, 0, 1, 2][: self.free] + joints, dtype=np.int64)
        self._forces: Any = np.array([*range(self.free), *joints], dtype=np.int64)
        self._block: Any = np.ix_(rows, rows)
        if not self.free and joints == list(range(len(joints))):
            # Bullet's order is ours: `...` is faster than indices.
            self._forces = self._block = ...
        self._zero = [0.0] * len(self.indices)
        dynamics = p.getDynamicsInfo(self._body, -1)
        self.centre, self.axes = np.array(dynamics[3]), matrix_of(p, dynamics[4])
        _, standing = p.getBasePositionAndOrientation(self._body)
        self._standing = matrix_of(p, standing)
        self._parts: list[tuple[float, int]] = []
        self._set_gravity(self._standing)
        self._set_up()

    def _set_up(self) -> None:
        """Make the first call of Bullet's dynamics, which prints warnings about axes that are inexact by rounding.

        Bullet rejects physically impossible inertias, as some published robots have. Mass matrix and bias are linear in the
        inertias: their values for I follow from two possible inertias as 2 f(I + s) - f(I + 2 s). The first of them becomes the
        robot.
        """
        if not self.joints:
            return
        with quiet():
            try:
                self.full_matrix(np.zeros(len(self.indices)))
                return
            except SystemError:
                moments = [sorted(principal_axes(link)[0]) for link in self._robot.links]
                lift = max(c - a - b + 1e-9 * c for a, b, c in moments)
                self._body = self._load(lift)[0]
                self._parts = [(1.0, self._body), (-1.0, self._load(2.0 * lift)[0])]
            try:
                self.full_matrix(np.zeros(len(self.indices)))
            except SystemError as error:
                message = "PyBullet cannot compute the dynamics of this robot: the inertia of a link is physically impossible"
                raise RobotError(message, file=self._robot.path, code="engine-load") from error

    def _ordered(self, values: Array) -> list[float]:
        """`values` of the moving joints in Bullet's order."""
        plain = values.tolist()
        return [plain[j] for j in self._to_bullet]

    def matrix_at(self, positions: Array, rotation: Array | None) -> Array:
        """Mass matrix (v, v) of all degrees of freedom, a floating base first: translation of its centre of mass along the axes
        of the world, rotation about the axes of the base link.

        rotation: (3, 3) rotation of a floating base; None for a fixed base.
        """
        matrix = self.full_matrix(positions)
        if rotation is not None:
            for axes, at in ((rotation @ self.axes, slice(0, 3)), (self.axes, slice(3, 6))):
                matrix[at] = axes @ matrix[at]
                matrix[:, at] = matrix[:, at] @ axes.T
        return matrix

    def bias_at(self, positions: Array, rotation: Array | None, velocity: Array) -> Array:
        """Gravity, Coriolis and centrifugal forces (v,) in N m, in the order of `matrix_at`. velocity: velocities (v,)."""
        q = self._ordered(positions)
        if rotation is None:
            return self._forces_at(self._standing, q, self._ordered(velocity), self._zero)
        turned = rotation @ self.axes
        spins, moves = (self.axes.T @ velocity[3:6]).tolist(), (turned.T @ velocity[:3]).tolist()
        bias = self._forces_at(turned, q, [*spins, *moves, *self._ordered(velocity[BASE:])], self._zero)
        bias[:3], bias[3:6] = turned @ bias[:3], self.axes @ bias[3:6]
        return bias

    def _sum(self, routine: Any, *arguments: list[float]) -> Array:
        """Result of one of Bullet's routines for the robot, corrected by the results for other bodies (see `_set_up`)."""
        total = np.array(routine(self._body, *arguments))
        for part, body in self._parts:
            total += part * np.array(routine(body, *arguments))
        return total

    def _forces_at(self, turned: Array, positions: list[float], velocities: list[float], accelerations: list[float]) -> Array:
        """Generalised forces (v,) in N m that give the accelerations, along Bullet's axes, in asrsim's order of degrees of
        freedom. turned: (3, 3) principal axes of the base in the world."""
        states = [positions, velocities, accelerations]
        if self.free:
            # The position of the base has no effect; its velocity must have six numbers.
            still = [0.0] * (BASE + len(self.indices) - len(velocities))
            states = [[0.0] * 6 + [1.0, *positions], still + velocities, [0.0] * 6 + accelerations]
            # Bullet ignores the orientation of the base: gravity is turned instead.
            self._set_gravity(turned)
        return np.asarray(self._sum(self.p.calculateInverseDynamics, *states)[self._forces])

    def _set_gravity(self, turned: Array) -> None:
        self.p.setGravity(*(turned.T @ self._scenario.gravity).tolist())

    def full_matrix(self, positions: Array) -> Array:
        """Mass matrix (v, v), a floating base first, along the principal axes of the base's inertia."""
        return np.asarray(self._sum(self.p.calculateMassMatrix, self._ordered(positions))[self._block])


def load_body(p: Client, urdf: str, scenario: Scenario, robot: Robot, lift: float = 0.0) -> tuple[int, dict[str, int]]:
    """Bullet's number of a robot that is loaded from the URDF text, on the scenario's base, and Bullet's number of each link,
    by name; -1 for the base. Raises RobotError.

    The principal moments of inertia are those of `robot` plus `lift` kg m^2: Bullet itself loads zeros where the largest moment
    exceeds the sum of the others, as in many published robots.
    """
    with tempfile.TemporaryDirectory(prefix="asrsim-") as folder:
        path = Path(folder) / "robot.urdf"
        path.write_text(urdf, encoding="utf-8")
        load = partial(
            p.loadURDF,
            str(path),
            basePosition=scenario.base_position,
            baseOrientation=p.getQuaternionFromEuler(scenario.base_rpy),
            useFixedBase=scenario.fixed_base,
            flags=p.URDF_USE_INERTIA_FROM_FILE | p.URDF_IGNORE_VISUAL_SHAPES,
        )
        try:
            with quiet():
                if "<mesh" in urdf and crashes(load):
                    message = "PyBullet crashes when it loads this robot; most likely a mesh is at fault"
                    raise RobotError(message, file=robot.path, code="engine-crash")
                body = int(load())
        except p.error as error:
            message = f"PyBullet cannot load this robot ({error})"
            raise RobotError(message, file=robot.path, code="engine-load") from error
    places = {p.getBodyInfo(body)[0].decode(): -1}
    places |= {p.getJointInfo(body, index)[12].decode(): index for index in range(p.getNumJoints(body))}
    for link in robot.links:
        moments = tuple(moment + lift for moment in principal_axes(link)[0])
        if p.getDynamicsInfo(body, places[link.name])[2] != moments:
            p.changeDynamics(body, places[link.name], localInertiaDiagonal=moments)
    return body, places


def inertial_frame(p: Client, body: int, index: int) -> tuple[Any, Array, Any]:
    """World position of a link's centre of mass, rotation (3, 3) of its URDF frame, centre of mass in that frame.

    The rotations are multiplied as matrices, since Bullet computes transforms and the poses of link frames in single precision.
    """
    dynamics = p.getDynamicsInfo(body, index)
    if index == -1:
        position, inertial = p.getBasePositionAndOrientation(body)
    else:
        position, inertial = p.getLinkState(body, index, 0, 1)[:2]
    return position, matrix_of(p, inertial) @ matrix_of(p, dynamics[4]).T, dynamics[3]


def matrix_of(p: Client, quaternion: Sequence[float]) -> Array:
    """Rotation matrix (3, 3) of a quaternion x, y, z, w."""
    return np.array(p.getMatrixFromQuaternion(quaternion), dtype=float).reshape(3, 3)
