"""The model behind PyBullet's engine: kinematics and dynamics of one robot, past the traps of Bullet's own routines.

Receives the `pybullet` module, which :mod:`asrsim.engines.bullet` imports.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from asrsim.engines.base import Model, Point
from asrsim.engines.foreign import quiet
from asrsim.robot.poses import Pose
from asrsim.samples import Array
from asrsim.scenario.data import Vector


class BulletModel:
    """See :class:`asrsim.engines.base.Model`. The robot is `body`, whose moving joints Bullet numbers `indices`.

    gravity: m/s^2, as the client has it; fixed: the base is held; links: link of the file -> Bullet's number of the body that
    it is part of, and its pose in that body's frame; other: a model of the same robot by another engine.
    """

    def __init__(
        self, p: Any, client: int, body: int, indices: Sequence[int], *, joints: tuple[str, ...], gravity: Vector, fixed: bool,
        links: Mapping[str, tuple[int, Pose]], other: Callable[[], Model],
    ) -> None:  # fmt: skip
        self._p, self._client, self._body = p, client, body
        self._indices = list(indices)
        self._gravity = gravity
        self._fixed = fixed
        self._places = links
        self.joints, self.links = joints, tuple(links)
        # Bullet's dynamics routines count degrees of freedom in the order of its links, which need not be the file's.
        self._to_bullet = sorted(range(len(self._indices)), key=self._indices.__getitem__)
        self._from_bullet = [self._to_bullet.index(j) for j in range(len(self._indices))]
        self._same_order = self._to_bullet == list(range(len(self._indices)))
        self._zero = [0.0] * len(self._indices)
        if indices:
            # Bullet sets its dynamics up when first asked, and prints what it thinks of axes that are off by rounding.
            with quiet():
                try:
                    self.mass_matrix(self._zero)
                except SystemError:
                    # Bullet steps links with inertias that no body has, but its dynamics decline them.
                    instead = other()
                    for name in ("mass_matrix", "bias", "inverse_dynamics", "link_point"):
                        setattr(self, name, getattr(instead, name))

    def index_of(self, link: str) -> int:
        """Bullet's number of the body that a link of the file is part of."""
        return self._places[link][0]

    def frame_now(self, link: str) -> tuple[Array, Array]:
        """Origin (3,) m and rotation (3, 3) of a link's frame in the world as it is now."""
        index, pose = self._places[link]
        centre, rotation, local = self.inertial_frame(index)
        origin = np.asarray(centre) - rotation @ np.asarray(local)
        return origin + rotation @ pose.position, rotation @ pose.rotation

    def inertial_frame(self, index: int) -> tuple[Any, Array, Any]:
        """World position of a link's centre of mass, rotation (3, 3) of its URDF frame, centre of mass in that frame.

        With matrices: Bullet's own transforms of vectors and quaternions work in single precision, and so do the poses of
        frames that it tells beside those of the inertias.
        """
        p, client, body = self._p, self._client, self._body
        dynamics = p.getDynamicsInfo(body, index, client)
        if index == -1:
            position, inertial = p.getBasePositionAndOrientation(body, client)
            return position, self._matrix(inertial) @ self._matrix(dynamics[4]).T, dynamics[3]
        state = p.getLinkState(body, index, 0, 1, client)
        return state[0], self._matrix(state[1]) @ self._matrix(dynamics[4]).T, dynamics[3]

    def base_pose(self) -> tuple[float, ...]:
        """World pose of the root link's URDF frame: x y z in m, quaternion x y z w."""
        centre, rotation, local = self.inertial_frame(-1)
        x, y, z, w = self._p.getDynamicsInfo(self._body, -1, self._client)[4]
        turned = self._p.getBasePositionAndOrientation(self._body, self._client)[1]
        return (*(centre - rotation @ np.asarray(local)).tolist(), *_product(turned, (-x, -y, -z, w)))

    def _states(self) -> Sequence[Any]:
        states: Sequence[Any] = self._p.getJointStates(self._body, self._indices, self._client)
        return states

    def _ordered(self, values: Sequence[float]) -> list[float]:
        """`values` of the moving joints in Bullet's order."""
        return list(values) if self._same_order else [values[j] for j in self._to_bullet]

    def mass_matrix(self, positions: Sequence[float] | Array) -> Array:
        """(n, n) kg m^2 (kg) mass matrix of the moving joints; that which torques meet while the base is free, if it floats."""
        values = self._ordered([float(value) for value in positions])
        matrix = np.array(self._p.calculateMassMatrix(self._body, values, physicsClientId=self._client), dtype=float)
        n = len(self._indices)
        if not self._fixed:
            # The base takes part in every motion: its six rows are eliminated.
            base, cross = matrix[:6, :6], matrix[:6, 6:]
            matrix = matrix[6:, 6:] - cross.T @ np.linalg.solve(base, cross)
        return matrix[-n:, -n:][np.ix_(self._from_bullet, self._from_bullet)]

    def bias(self, positions: Sequence[float] | Array, velocities: Sequence[float] | Array) -> Array:
        """(n,) N m that give no acceleration, on a base that is held."""
        return self.inverse_dynamics(positions, velocities, self._zero)

    def inverse_dynamics(
        self, positions: Sequence[float] | Array, velocities: Sequence[float] | Array, accelerations: Sequence[float] | Array
    ) -> Array:
        """(n,) N m that give `accelerations`, on a base that is held."""
        p, client = self._p, self._client
        states = [self._ordered([float(value) for value in values]) for values in (positions, velocities, accelerations)]
        # Bullet's routine ignores the orientation of the base (of its inertia's axes): gravity is turned in its place.
        turned = self._matrix(p.getBasePositionAndOrientation(self._body, client)[1]).T @ np.array(self._gravity)
        if not self._fixed:
            still = [0.0] * 6
            states = [[*still, 1.0, *states[0]], [*still, *states[1]], [*still, *states[2]]]
        p.setGravity(*turned.tolist(), physicsClientId=client)
        try:
            torques = np.array(p.calculateInverseDynamics(self._body, *states, physicsClientId=client), dtype=float)
            return torques[-len(self._indices) :][self._from_bullet]
        finally:
            p.setGravity(*self._gravity, physicsClientId=client)

    def mechanical_energy(self) -> float:
        """Kinetic and gravitational energy in J of the links that joints move; all that moves, on a base that is held."""
        p, client, body = self._p, self._client, self._body
        states = self._states()
        velocities = np.array([state[1] for state in states])
        energy = 0.5 * float(velocities @ self.mass_matrix([state[0] for state in states]) @ velocities)
        for index in range(p.getNumJoints(body, client)):
            mass = p.getDynamicsInfo(body, index, client)[0]
            if mass:
                position = p.getLinkState(body, index, 0, 1, client)[0]
                energy -= mass * sum(g * x for g, x in zip(self._gravity, position, strict=True))
        return energy

    def link_point(self, link: str, point: Point, positions: Sequence[float] | Array) -> tuple[Array, Array, Array]:
        """Forward kinematics of a point of a link: position (3,) m, rotation (3, 3), Jacobian (6, n), world frame.

        Moves the robot to `positions`: for models that are not being simulated.
        """
        p, client, body = self._p, self._client, self._body
        index, pose = self._places[link]
        values = [float(value) for value in positions]
        for joint, value in zip(self._indices, values, strict=True):
            p.resetJointState(body, joint, value, 0.0, physicsClientId=client)
        at = pose.position + pose.rotation @ np.asarray(point, dtype=float)
        if index == -1:
            centre, rotation, local = self.inertial_frame(index)
            position = np.asarray(centre) + rotation @ (at - np.asarray(local))
            return position, rotation @ pose.rotation, np.zeros((6, len(self._indices)))
        centre, rotation, local = self.inertial_frame(index)
        # Bullet takes the point along the inertia's axes, but from the link's own origin, and answers in the frame of the
        # base's inertia; its manual says otherwise. The tests hold this against differences of poses.
        turned = self._matrix(p.getDynamicsInfo(body, index, client)[4]).T @ at
        linear, angular = p.calculateJacobian(
            body, index, turned.tolist(), self._ordered(values), self._zero, self._zero, physicsClientId=client
        )
        base = self._matrix(p.getBasePositionAndOrientation(body, client)[1])
        jacobian = np.vstack([base @ np.array(linear, dtype=float), base @ np.array(angular, dtype=float)])
        jacobian = jacobian[:, -len(self._indices) :][:, self._from_bullet]
        return np.asarray(centre) + rotation @ (at - np.asarray(local)), rotation @ pose.rotation, jacobian

    def _matrix(self, quaternion: Sequence[float]) -> Array:
        return np.array(self._p.getMatrixFromQuaternion(quaternion), dtype=float).reshape(3, 3)


def _product(a: Sequence[float], b: Sequence[float]) -> tuple[float, float, float, float]:
    """Product of quaternions (x, y, z, w); Bullet's own works in single precision."""
    (ax, ay, az, aw), (bx, by, bz, bw) = a, b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )
