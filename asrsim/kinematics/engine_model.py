"""The kinematic model behind an engine: the robot alone on its base, with nothing around it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from asrsim.kinematics.model import Point
from asrsim.samples import Array

if TYPE_CHECKING:
    from asrsim.engines.bullet import BulletEngine
    from asrsim.robot.model import Robot
    from asrsim.scenario.data import Scenario


class EngineModel:
    """Kinematics, mass matrix and gravity of a robot, computed by PyBullet; arrays are in the order of `joints`."""

    def __init__(self, engine: BulletEngine, robot: Robot) -> None:
        self._engine = engine
        self.joints: tuple[str, ...] = engine.joints
        self.links: tuple[str, ...] = tuple(link.name for link in robot.links)
        stops = {joint.name: (joint.lower, joint.upper) for joint in robot.moving_joints}
        self.lower: Array = np.array([-np.inf if stops[name][0] is None else stops[name][0] for name in self.joints])
        self.upper: Array = np.array([np.inf if stops[name][1] is None else stops[name][1] for name in self.joints])
        self._last: tuple[tuple[bytes, str, Point], tuple[Array, Array, Array]] | None = None

    def _link_point(self, positions: Array, link: str, point: Point) -> tuple[Array, Array, Array]:
        """Pose and Jacobian come out of one look at the engine; the loop asks for both in turn."""
        key = (np.asarray(positions, dtype=float).tobytes(), link, point)
        if self._last is None or self._last[0] != key:
            self._last = (key, self._engine.link_point(link, point, [float(value) for value in positions]))
        return self._last[1]

    def pose(self, positions: Array, link: str, point: Point) -> tuple[Array, Array]:
        """Position (3,) in m of `point` (m, in the frame of `link`) and rotation (3, 3) of the link, in the world."""
        position, rotation, _ = self._link_point(positions, link, point)
        return position, rotation

    def jacobian(self, positions: Array, link: str, point: Point) -> Array:
        """(6, n): velocity of the point and angular velocity of the link per joint velocity."""
        return self._link_point(positions, link, point)[2]

    def gravity_torques(self, positions: Array) -> Array:
        """(n,) N m that hold the robot still against gravity."""
        return self._engine.gravity_torques([float(value) for value in positions])

    def mass_matrix(self, positions: Array) -> Array:
        """(n, n) kg m^2."""
        return self._engine.mass_matrix([float(value) for value in positions])

    def inverse_dynamics(self, positions: Array, velocities: Array, accelerations: Array) -> Array:
        """(k, n) N m that move the rigid robot so, undamped; all arguments (k, n), one posture a row."""
        torques = np.empty_like(positions)
        still = [0.0] * len(self.joints)
        for row, (q, v, a) in enumerate(zip(positions, velocities, accelerations, strict=True)):
            torques[row] = self.gravity_torques(q)
            if a.any():
                torques[row] += self.mass_matrix(q) @ a
            if v.any() and (bias := self._engine.bias_difference(q.tolist(), v.tolist(), still)) is not None:
                torques[row] += bias
        return torques


@contextmanager
def model_of(scenario: Scenario, robot: Robot) -> Iterator[EngineModel]:
    """The model of a scenario's robot on its base under its gravity; without the world's objects, released at the end."""
    from asrsim.engines import make_bullet
    from asrsim.scenario.data import World

    engine, _ = make_bullet(replace(scenario, world=World()), robot)
    with closing(engine):
        yield EngineModel(engine, robot)
