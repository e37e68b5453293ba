"""Initial positions of the joints. They come from the scenario's `initial` or from the start of a prescribed motion, else from
the robot's file, else they are 0.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from asrsim.robot.model import Joint, Robot
from asrsim.scenario.data import Scenario, for_joint


def stated_start(scenario: Scenario, joint: Joint) -> float:
    """Initial position that scenario or file state for a joint that follows no other joint, rad or m."""
    motion = for_joint(scenario.motion, joint.name)
    start = joint.start or 0.0 if motion is None else float(motion.values(np.zeros(1))[0])
    return float(for_joint(scenario.initial_positions, joint.name, start))


def start_positions(scenario: Scenario, robot: Robot) -> dict[str, float]:
    """Initial position of each moving joint; coupled joints follow their masters, rad or m."""
    moving = robot.moving_joints
    stated = robot.couplings.expand([stated_start(scenario, joint) for joint in moving])
    return dict(zip((joint.name for joint in moving), stated.tolist(), strict=True))


def start_velocities(scenario: Scenario, robot: Robot, positions: Mapping[str, float]) -> dict[str, float]:
    """Initial velocity of each moving joint, rad/s or m/s. positions: result of `start_positions`."""
    names, places = list(positions), np.array([*positions.values()])
    rates = robot.couplings.expand_rates([float(for_joint(scenario.initial_velocities, name, 0.0)) for name in names], places)
    return dict(zip(names, rates.tolist(), strict=True))
