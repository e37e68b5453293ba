"""PyBullet behind the engine interface.

Without contacts, asrsim computes the step from Bullet's mass matrix and bias (`BulletEngine`). With contacts, Bullet computes
the step (`asrsim.engines.bullet_contacts`). The MuJoCo engine and the PyBullet engine share only `asrsim.engines.rigid` and
`asrsim.engines.exact_friction`, which contain no data of the robot.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from asrsim.engines.base import Scene
from asrsim.engines.bullet_contacts import BulletContacts
from asrsim.engines.bullet_model import BulletModel, matrix_of
from asrsim.engines.rigid import RigidEngine, make_room
from asrsim.errors import Problem
from asrsim.robot.engine_text import usable_shapes
from asrsim.robot.merge import merge_fixed
from asrsim.robot.model import Robot
from asrsim.robot.poses import quaternion, rotation_matrix
from asrsim.samples import Array
from asrsim.scenario.data import Scenario
from asrsim.versions import version


class BulletEngine(RigidEngine):
    """A robot in a world without contacts."""

    def __init__(self, scenario: Scenario, robot: Robot) -> None:
        self.version = f"pybullet {version('pybullet')}"
        self.robot, self._scenario = robot, scenario
        self.model = model = BulletModel(scenario, robot)
        self.joints = model.joints
        count, base = len(self.joints), model.free
        self._start = base + 1 if base else 0
        home = np.zeros(self._start + count)
        room = make_room(
            robot, qpos=np.zeros(len(home)), qvel=np.zeros(base + count), joint_q=range(self._start, len(home)),
            joint_v=range(base, base + count), free=bool(base),
        )  # fmt: skip
        if base:
            x, y, z, w = quaternion(scenario.base_rpy)
            home[:3] = scenario.base_position + rotation_matrix(scenario.base_rpy) @ model.centre
            home[3:7] = w, x, y, z
        super().__init__(room, home)

    def _turned(self, configuration: Array) -> Array:
        """Rotation matrix (3, 3) of the base link."""
        w, *vector = configuration[3:7].tolist()
        return matrix_of(self.model._p, (*vector, w))

    def look(self, wrenches: Array, forces: Array) -> None:
        """Fill in mass matrix, bias and generalised forces of the wrenches, computed by Bullet."""
        room, model = self._room, self.model
        rotation = self._turned(room.qpos) if room.free else None
        positions = room.qpos[self._start :]
        room.matrix[:] = model.matrix_at(positions, rotation)
        room.bias[:] = model.bias_at(positions, rotation, room.qvel)
        for piece, values in enumerate(wrenches if wrenches.size else ()):
            forces[piece, :, 0] = model.push(self._scenario.wrenches, values, positions, rotation)

    def scene(self) -> Scene:
        """Pose of the base link, if it floats."""
        if not self._room.free:
            return Scene({}, {})
        w, *vector = self._state[3:7].tolist()
        origin = self._state[:3] - self._turned(self._state) @ self.model.centre
        return Scene({self.model.root: (*origin.tolist(), *vector, w)}, {})

    def vary(self, robot: Robot) -> bool:
        """Bullet cannot change the inertials of a loaded robot."""
        return robot.links == self.robot.links

    def close(self) -> None:
        """Disconnect the physics client."""
        self.model.close()


def make_bullet(scenario: Scenario, robot: Robot) -> tuple[BulletEngine | BulletContacts, tuple[Problem, ...]]:
    """The scenario's world in PyBullet, and warnings about ignored parts of the robot. Raises RobotError, SimulationError."""
    _, warnings = usable_shapes(merge_fixed(robot).robot, package_paths=scenario.package_paths)
    engine: Any = BulletEngine if scenario.world.empty else BulletContacts
    return engine(scenario, robot), warnings
