"""Parameters that a user can tune on a page: parameters of actuators, and damping and friction of joints."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from asrsim.actuators import ACTUATORS
from asrsim.robot import Robot, load_robot
from asrsim.robot.edit import edited_urdf
from asrsim.scenario.data import for_joint
from asrsim.simulation.drives import SteppedJoint
from asrsim.simulation.examine import Plan, examine
from asrsim.simulation.prepared import Prepared
from asrsim.simulation.start import Numbers

OF_JOINTS = {"damping": "N m s/rad", "friction": "N m"}
"""Tunable numbers that every joint has in the robot's file, with their units."""


def tunable(prepared: Prepared) -> dict[str, dict[str, float]]:
    """Present values of the numbers that a user may tune, by joint and name; numbers without effect are left out."""
    return {drive.name: _own(drive) for drive in prepared.drives}


def _own(drive: SteppedJoint) -> dict[str, float]:
    found: dict[str, float] = {}
    if drive.actuator is not None:
        declared = {parameter.name: parameter for parameter in ACTUATORS.get(drive.actuator.name).all_parameters()}
        found = {
            name: value
            for name, value in drive.values.items()
            if math.isfinite(value) and name in declared and not declared[name].unused and not declared[name].optional
        }
    return {**found, "damping": drive.joint.damping, "friction": drive.joint.friction}


def unit_of_number(prepared: Prepared, joint: Any, name: Any) -> str:
    """SI unit of the tunable number `name` of a joint."""
    drive = next(drive for drive in prepared.drives if drive.name == joint)
    if name in OF_JOINTS:
        unit = OF_JOINTS[name]
        return unit.replace("N m s/rad", "N s/m").replace("N m", "N") if drive.joint.kind == "prismatic" else unit
    declared = ACTUATORS.get(drive.actuator.name).all_parameters() if drive.actuator else ()
    return next((parameter.unit for parameter in declared if parameter.name == name), "")


def tuned(plan: Plan, numbers: Numbers) -> Plan:
    """Plan in which these numbers, given by joint and name, have new values. The log of a run of this plan contains the new
    values.

    Parameters of actuators are set in the scenario; numbers of joints are changed in the text of the robot's file. Raises
    RobotError and ScenarioError.
    """
    if not numbers:
        return plan
    scenario = plan.scenario
    parameters, joints = dict(scenario.parameters), {}
    for joint, own in numbers.items():
        if given := {name: value for name, value in own.items() if name not in OF_JOINTS}:
            parameters[joint] = {**for_joint(scenario.parameters, joint, {}), **given}
        if edited := {name: value for name, value in own.items() if name in OF_JOINTS}:
            joints[joint] = edited
    robot = _edited(plan.source, joints) if joints else None
    return examine(replace(scenario, parameters=parameters), robot)


def _edited(robot: Robot, changes: Numbers) -> Robot:
    """Robot whose text contains new values of these numbers of joints."""
    with TemporaryDirectory(prefix="asrsim-view-") as folder:
        path = Path(folder) / "robot.urdf"
        path.write_bytes(edited_urdf(robot.text.encode(), robot, changes))
        return replace(load_robot(path), path=robot.path)


def differences(before: Mapping[str, Mapping[str, float]], after: Mapping[str, Mapping[str, float]]) -> list[str]:
    """A line for each number that differs between `before` and `after`, such as `joint_1.spring_k_1: 0.02 -> 0.05`."""
    return [
        f"{joint}.{name}: {before[joint][name]:.6g} -> {value:.6g}"
        for joint, own in after.items()
        for name, value in own.items()
        if name in before.get(joint, {}) and before[joint][name] != value
    ]
