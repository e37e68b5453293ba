"""Robots: URDF and xacro files read as pure data, checked, and prepared for a physics engine."""

from __future__ import annotations

from asrsim.robot.engine_text import engine_urdf
from asrsim.robot.merge import MergedRobot, Place, merge_fixed
from asrsim.robot.model import ActuatorBlock, Joint, Link, ParameterValue, Robot, Shape
from asrsim.robot.mounting import block_for, drive_of, with_actuators
from asrsim.robot.overrides import with_overrides
from asrsim.robot.reader import load_robot
from asrsim.robot.step_checks import StepFigures, step_figures, step_findings

__all__ = [
    "ActuatorBlock",
    "Joint",
    "Link",
    "MergedRobot",
    "ParameterValue",
    "Place",
    "Robot",
    "Shape",
    "StepFigures",
    "block_for",
    "drive_of",
    "engine_urdf",
    "load_robot",
    "merge_fixed",
    "step_figures",
    "step_findings",
    "with_actuators",
    "with_overrides",
]
