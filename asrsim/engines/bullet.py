"""PyBullet behind the engine interface.

Without contacts the step is ours (:mod:`asrsim.engines.rigid`), from PyBullet's mass matrix and bias; friction of joints and
their stops are exact. With contacts the step is Bullet's (:mod:`asrsim.engines.bullet_contacts`).
"""

from __future__ import annotations

import numpy as np

from asrsim.engines.base import Engine, Scene
from asrsim.engines.bullet_model import BulletModel
from asrsim.engines.rigid import RigidEngine, make_room
from asrsim.errors import Problem
from asrsim.robot.model import Robot
from asrsim.robot.poses import quaternion, rotation_matrix
from asrsim.samples import Array
from asrsim.scenario.data import Scenario
from asrsim.versions import version


class BulletEngine(RigidEngine):
    """One robot that touches nothing."""

    def __init__(self, scenario: Scenario, robot: Robot) -> None:
        self.model = model = BulletModel(scenario, robot)
        self.robot, self.joints = robot, model.joints
        self.version = f"pybullet {version('pybullet')}"
        self._wrenches = scenario.wrenches
        self._free = not scenario.fixed_base
        places, speeds = (7, 6) if self._free else (0, 0)
        count = len(self.joints)
        home = np.zeros(places + count)
        if self._free:
            x, y, z, w = quaternion(scenario.base_rpy)
            home[:3] = scenario.base_position + rotation_matrix(scenario.base_rpy) @ model.centre
            home[3:7] = w, x, y, z
        room = make_room(
            robot, np.zeros(4), qpos=home.copy(), qvel=np.zeros(speeds + count), joint_q=range(places, places + count),
            joint_v=range(speeds, speeds + count), free=self._free,
        )  # fmt: skip
        super().__init__(room, home)

    def look(self, wrenches: Array) -> None:
        """Mass matrix, bias and forces by PyBullet."""
        room = self._room
        rotation = rotation_of(room.qpos) if self._free else None
        positions = room.qpos[7:] if self._free else room.qpos
        room.matrix[:], room.bias[:] = self.model.look(positions, rotation, room.qvel)
        if len(wrenches):
            room.force[:] = 0.0
        for wrench, values in zip(self._wrenches, wrenches, strict=True):
            room.force[:] += self.model.push(
                wrench.link, wrench.point, values[:3], values[3:], local=wrench.frame != "world", positions=positions, base=rotation
            )

    def scene(self) -> Scene:
        """The pose of the base link if it floats."""
        if not self._free:
            return Scene({}, {})
        rotation = rotation_of(self._state)
        w, x, y, z = self._state[3:7].tolist()
        return Scene({self.model.links[0]: (*(self._state[:3] - rotation @ self.model.centre).tolist(), x, y, z, w)}, {})

    def vary(self, robot: Robot) -> bool:
        """True where links are the same: Bullet takes over no changed bodies exactly."""
        if robot.links != self.robot.links:
            return False
        self.robot = robot
        return True

    def close(self) -> None:
        """Disconnect the client."""
        self.model.close()


def rotation_of(configuration: Array) -> Array:
    """(3, 3) of a floating base."""
    w, x, y, z = configuration[3:7].tolist()
    return np.array((
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
        (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
    ))  # fmt: skip


def make_bullet(scenario: Scenario, robot: Robot) -> tuple[Engine, tuple[Problem, ...]]:
    """The scenario's world in PyBullet, and warnings of what the engine does not take. Raises RobotError, SimulationError."""
    if scenario.world.empty:
        return BulletEngine(scenario, robot), ()
    from asrsim.engines.bullet_contacts import BulletContacts

    engine = BulletContacts(scenario, robot)
    return engine, engine.warnings
