"""A plugin with a physics engine for a pendulum: one joint on a fixed base, in closed form.

Import this file, and write `engine: pendulum` in the scenario.
"""

import numpy as np

from asrsim.engines import ENGINES
from asrsim.engines.base import EngineEntry
from asrsim.engines.rigid import RigidEngine, make_room
from asrsim.errors import RobotError
from asrsim.robot.inertia import principal_axes
from asrsim.robot.merge import merge_fixed
from asrsim.robot.poses import link_poses, rotation_matrix


class PendulumModel:
    """Rigid-body model of the pendulum: see `asrsim.engines.base.Model`."""

    def __init__(self, scenario, robot):
        merged = merge_fixed(robot)
        (self.joint,) = merged.robot.moving_joints
        link = next(link for link in merged.robot.links if link.name == self.joint.child)
        self.joints, self.links = (self.joint.name,), tuple(link.name for link in robot.links)
        self.mass, self.centre, self.axis = link.mass, np.array(link.centre_of_mass), np.array(self.joint.axis)
        base = rotation_matrix(scenario.base_rpy)
        self.stand = base @ link_poses(merged.robot)[link.name].rotation
        self.origin = np.array(scenario.base_position) + base @ link_poses(merged.robot)[link.name].position
        self.gravity, self.places, self.body = np.array(scenario.gravity), merged.places, link.name
        moments, rpy = principal_axes(link)
        arm = np.cross(self.axis, self.centre)
        self.inertia = np.array(moments) @ (rotation_matrix(rpy).T @ self.axis) ** 2 + self.mass * arm @ arm

    def turn(self, q):
        x, y, z = self.axis
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        return self.stand @ (np.eye(3) + np.sin(q) * cross + (1.0 - np.cos(q)) * cross @ cross)

    def mass_matrix(self, positions):
        return np.array([[self.inertia]])

    def bias(self, positions, velocities):
        return np.array([-self.mass * self.gravity @ self.turn(positions[0]) @ np.cross(self.axis, self.centre)])

    def inverse_dynamics(self, positions, velocities, accelerations):
        return self.inertia * np.asarray(accelerations) + self.bias(positions, velocities)

    def energy(self, positions, velocities):
        height = self.origin + self.turn(positions[0]) @ self.centre
        return float(0.5 * self.inertia * velocities[0] ** 2 - self.mass * self.gravity @ height)

    def link_point(self, link, point, positions):
        place, turn = self.places[link], self.turn(positions[0]) if self.places[link].body == self.body else np.eye(3)
        arm = turn @ (place.pose.position + place.pose.rotation @ np.array(point))
        axis = self.stand @ self.axis * (place.body == self.body)
        jacobian = np.concatenate([np.cross(axis, arm), axis])[:, None]
        return self.origin * (place.body == self.body) + arm, turn @ place.pose.rotation, jacobian


class PendulumEngine(RigidEngine):
    """Engine for the pendulum. The base class computes the step with friction, stops and damping of the joint."""

    version = "pendulum 1"

    def __init__(self, scenario, robot):
        if len(robot.moving_joints) != 1 or not scenario.fixed_base or not scenario.world.empty:
            raise RobotError(
                "the engine 'pendulum' needs a robot with one joint on a fixed base, in a world without ground and objects"
            )
        self.model, self.robot, self.joints = PendulumModel(scenario, robot), robot, (robot.moving_joints[0].name,)
        places = {"qpos": np.zeros(1), "qvel": np.zeros(1), "joint_q": [0], "joint_v": [0]}
        super().__init__(make_room(robot, free=False, **places), np.zeros(1))

    def look(self, wrenches, forces):
        room = self._room
        room.matrix[:], room.bias[:] = self.model.mass_matrix(room.qpos), self.model.bias(room.qpos, room.qvel)


ENGINES.add("pendulum", EngineEntry(make=lambda scenario, robot: (PendulumEngine(scenario, robot), ()), doc="a pendulum"))
