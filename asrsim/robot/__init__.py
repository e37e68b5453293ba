"""Robots: URDF and xacro files read as pure data, checked, and prepared for a physics engine."""

from __future__ import annotations

from asrsim.robot.merge import merge_fixed
from asrsim.robot.model import ActuatorBlock, Joint, Link, ParameterValue, Robot
from asrsim.robot.mounting import drive_of, with_actuators
from asrsim.robot.reader import load_robot, read_robot
from asrsim.robot.values import with_overrides

__all__ = [
    "ActuatorBlock",
    "Joint",
    "Link",
    "ParameterValue",
    "Robot",
    "drive_of",
    "load_robot",
    "merge_fixed",
    "read_robot",
    "with_actuators",
    "with_overrides",
]
