"""Robots: URDF and xacro files read as pure data, checked, and prepared for a physics engine."""

from __future__ import annotations

from asrsim.robot.model import ActuatorBlock, Joint, Link, ParameterValue, Robot
from asrsim.robot.reader import load_robot

__all__ = ["ActuatorBlock", "Joint", "Link", "ParameterValue", "Robot", "load_robot"]
