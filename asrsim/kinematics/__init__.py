"""Cartesian tasks: closed-loop inverse kinematics on the model, and gravity compensation through the springs."""

from __future__ import annotations

from asrsim.kinematics.clik import follow
from asrsim.kinematics.compensation import equilibrium_for_load
from asrsim.kinematics.engine_model import model_of
from asrsim.kinematics.plan import plan
from asrsim.kinematics.references import plan_references, plan_task
from asrsim.kinematics.trajectory import PoseTrajectory

__all__ = [
    "PoseTrajectory",
    "equilibrium_for_load",
    "follow",
    "model_of",
    "plan",
    "plan_references",
    "plan_task",
]
