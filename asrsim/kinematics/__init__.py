"""Cartesian tasks: closed-loop inverse kinematics on the model, and gravity compensation through the springs."""

from __future__ import annotations

from asrsim.kinematics.clik import ClikSettings, JointPath, follow
from asrsim.kinematics.compensation import equilibrium_for_load
from asrsim.kinematics.engine_model import EngineModel, model_of
from asrsim.kinematics.model import KinematicModel
from asrsim.kinematics.plan import PlannedReferences, plan
from asrsim.kinematics.reach import Reach, closest
from asrsim.kinematics.references import plan_references, plan_task
from asrsim.kinematics.trajectory import INTERPOLATIONS, PoseTrajectory

__all__ = [
    "INTERPOLATIONS",
    "ClikSettings",
    "EngineModel",
    "JointPath",
    "KinematicModel",
    "PlannedReferences",
    "PoseTrajectory",
    "Reach",
    "closest",
    "equilibrium_for_load",
    "follow",
    "model_of",
    "plan",
    "plan_references",
    "plan_task",
]
