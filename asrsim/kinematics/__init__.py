"""Cartesian tasks: closed-loop inverse kinematics on the model, and gravity compensation through the springs."""

from __future__ import annotations

from asrsim.kinematics.drive_inverse import equilibria_for_loads
from asrsim.kinematics.path import PoseTrajectory, follow
from asrsim.kinematics.plan import plan, plan_references, plan_task

__all__ = [
    "PoseTrajectory",
    "equilibria_for_loads",
    "follow",
    "plan",
    "plan_references",
    "plan_task",
]
