"""Description of a run for its log: joints, inputs, versions, frames of the links."""

from __future__ import annotations

from collections.abc import Sequence

from asrsim.robot.model import Robot
from asrsim.robot.poses import quaternion
from asrsim.samples import Frame, RunInfo
from asrsim.scenario.data import Scenario
from asrsim.simulation.drives import SteppedJoint
from asrsim.simulation.examine import Plan
from asrsim.simulation.substeps import Resolution
from asrsim.versions import version

WORLD, MAP = "world", "map"


def describe(scenario: Scenario, plan: Plan, drives: Sequence[SteppedJoint], resolution: Resolution, engine: str) -> RunInfo:
    """Description of the run for its log. engine: library and version of the engine."""
    from asrsim import __version__

    return RunInfo(
        robot=plan.robot.name,
        joints=plan.joints,
        step=scenario.step,
        log_every=scenario.log_every,
        variant=scenario.variant,
        urdf=plan.robot.text,
        urdf_path=str(plan.robot.path),
        scenario=scenario.text,
        scenario_path=str(scenario.path or ""),
        resolved={
            "scenario": dict(scenario.resolved),
            "parameters": {drive.name: dict(drive.values) for drive in drives if drive.values},
        },
        metadata={
            "asrsim": __version__,
            "numpy": version("numpy"),
            "engine": scenario.engine,
            "engine_version": engine,
            "stepping": plan.stepping.name,
            "order": str(plan.stepping.order),
            "step": repr(scenario.step),
            "substeps": str(resolution.substeps),
            "motor_substeps": str(resolution.motor_substeps),
            "omega_h": f"{resolution.omega_h:.4g}",
            "seed": str(scenario.seed),
            "gravity": repr(tuple(scenario.gravity)),
        },
        attachments={name: path.read_bytes() for name, path in scenario.attachments.items()},
        frames=link_frames(scenario, plan.robot),
        frame_rate=scenario.tf_rate,
    )


def link_frames(scenario: Scenario, robot: Robot) -> tuple[Frame, ...]:
    """Frame of each link relative to its parent link. The frame of a fixed root link is relative to the world. A floating root
    link is listed among the bodies instead.
    """
    frames = [
        Frame(
            parent=joint.parent,
            child=joint.child,
            position=joint.origin,
            rotation=quaternion(joint.rpy),
            joint=joint.name if joint.moves else "",
            axis=joint.axis,
            prismatic=joint.kind == "prismatic",
        )
        for joint in robot.joints
    ]
    if scenario.fixed_base:
        root, position, rpy = robot.root.name, scenario.base_position, scenario.base_rpy
        # Many robots name their root link 'world', which is also the name of the world frame in viewers. Then do not add a
        # world frame, unless the scenario moves the robot.
        if root != WORLD or any((*position, *rpy)):
            frames.append(
                Frame(parent=MAP if root == WORLD else WORLD, child=root, position=position, rotation=quaternion(rpy))
            )
    return tuple(frames)
