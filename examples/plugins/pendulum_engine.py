"""A plugin with a physics engine for a pendulum: one joint on a fixed base, in closed form.

asrsim run scenario.yaml --engine pendulum --plugin examples/plugins/pendulum_engine.py
"""

import numpy as np

from asrsim.engines import ENGINES, EngineEntry
from asrsim.engines.equations import EquationEngine
from asrsim.errors import RobotError
from asrsim.robot.inertia import inertia_tensor
from asrsim.robot.merge import merge_fixed
from asrsim.robot.poses import link_poses, rotation_matrix


class PendulumEngine(EquationEngine):
    """Engine for the pendulum. The base class computes the step with friction, stops and damping of the joint."""

    version = "pendulum 1"
    takes_weightless = True  # gravity does not act on `link.weightless`

    def __init__(self, scenario, robot):
        super().__init__(scenario, robot)
        if len(self.joints) != 1:
            raise RobotError("the engine 'pendulum' needs a robot with one joint")
        merged = merge_fixed(robot).robot  # links on fixed joints are parts of the link that carries them
        (joint,) = merged.moving_joints
        link = next(link for link in merged.links if link.name == joint.child)
        stand = rotation_matrix(scenario.base_rpy) @ link_poses(merged)[link.name].rotation
        axis, centre = np.array(joint.axis), np.array(link.centre_of_mass)
        arm = np.cross(axis, centre)
        self.inertia = axis @ inertia_tensor(link) @ axis + link.mass * arm @ arm
        # Gravity torques at 0 and at a right angle.
        supported, place = link.weightless
        moment = np.cross(axis, link.mass * centre - supported * np.array(place))
        gravity = stand.T @ np.array(scenario.gravity)
        self.torques = -gravity @ moment, -gravity @ np.cross(axis, moment)

    def mass_matrix(self, positions):
        return [[self.inertia]]

    def bias(self, positions, velocities):
        (q,) = positions
        return [np.cos(q) * self.torques[0] + np.sin(q) * self.torques[1]]


ENGINES.add("pendulum", EngineEntry(make=lambda scenario, robot: (PendulumEngine(scenario, robot), ()), doc="a pendulum"))
