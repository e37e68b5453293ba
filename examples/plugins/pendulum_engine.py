"""A plugin with a physics engine for a pendulum: one joint on a fixed base, in closed form.

The base class maps the scenario's wrenches to the joint, since it is given the scenario.

Import this file, and write `engine: pendulum` in the scenario.
"""

import numpy as np

from asrsim.engines import ENGINES, EngineEntry
from asrsim.engines.rigid import RigidEngine, make_room
from asrsim.errors import RobotError
from asrsim.robot.inertia import inertia_tensor
from asrsim.robot.merge import merge_fixed
from asrsim.robot.poses import link_poses, rotation_matrix


class PendulumEngine(RigidEngine):
    """Engine for the pendulum. The base class computes the step with friction, stops and damping of the joint."""

    version = "pendulum 1"

    def __init__(self, scenario, robot):
        if len(robot.moving_joints) != 1 or not scenario.fixed_base or not scenario.world.empty:
            raise RobotError(
                "the engine 'pendulum' needs a robot with one joint on a fixed base, in a world without ground and objects"
            )
        self.robot, self.joints = robot, (robot.moving_joints[0].name,)
        merged = merge_fixed(robot).robot
        (joint,) = merged.moving_joints
        link = next(link for link in merged.links if link.name == joint.child)
        stand = rotation_matrix(scenario.base_rpy) @ link_poses(merged)[link.name].rotation
        axis, centre = np.array(joint.axis), np.array(link.centre_of_mass)
        arm = np.cross(axis, centre)
        self.inertia = axis @ inertia_tensor(link) @ axis + link.mass * arm @ arm
        # Gravity torques at 0 and at a right angle.
        weight = link.mass * stand.T @ np.array(scenario.gravity)
        self.torques = -weight @ arm, -weight @ np.cross(axis, arm)
        places = {"qpos": np.zeros(1), "qvel": np.zeros(1), "joint_q": [0], "joint_v": [0]}
        super().__init__(make_room(robot, free=False, **places), np.zeros(1), scenario=scenario)

    def look(self, wrenches, forces):
        room, (q,) = self._room, self._room.qpos
        room.full_matrix[:] = self.inertia
        room.full_bias[:] = np.cos(q) * self.torques[0] + np.sin(q) * self.torques[1]


ENGINES.add("pendulum", EngineEntry(make=lambda scenario, robot: (PendulumEngine(scenario, robot), ()), doc="a pendulum"))
