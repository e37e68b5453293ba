"""Description of a run for its log, sufficient to repeat the run."""

from __future__ import annotations

from collections.abc import Sequence

from asrsim.robot.model import Robot
from asrsim.robot.poses import quaternion
from asrsim.samples import Frame, JointInfo, RunInfo
from asrsim.scenario.data import Scenario
from asrsim.simulation.drives import SteppedJoint
from asrsim.simulation.quantities import recorded_quantities
from asrsim.simulation.steppings import Stepping
from asrsim.simulation.substeps import Resolution


def describe(
    scenario: Scenario, robot: Robot, drives: Sequence[SteppedJoint], stepping: Stepping, resolution: Resolution, engine: str
) -> RunInfo:
    """Description of the run for its log. engine: library and version of the engine."""
    from asrsim import __version__
    from asrsim.versions import version

    joints = tuple(
        JointInfo(
            name=drive.name,
            actuator=drive.actuator.name if drive.actuator else "rigid",
            mode=drive.mode.number if drive.mode else None,
            namespace=drive.block.namespace if drive.block else "",
            motors=drive.placed,
            prismatic=drive.joint.kind == "prismatic",
            quantities=recorded_quantities(drive),
        )
        for drive in drives
    )
    order = {name: index for index, name in enumerate(scenario.joint_order)}
    joints = tuple(sorted(joints, key=lambda joint: order.get(joint.name, len(order)))) if order else joints
    return RunInfo(
        robot=robot.name,
        joints=joints,
        step=scenario.step,
        log_every=scenario.log_every,
        variant=scenario.variant,
        urdf=robot.text,
        urdf_path=str(robot.path),
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
            "stepping": stepping.name,
            "order": str(stepping.order),
            "step": repr(scenario.step),
            "substeps": str(resolution.substeps),
            "motor_substeps": str(resolution.motor_substeps),
            "omega_h": f"{resolution.omega_h:.4g}",
            "seed": str(scenario.seed),
            "gravity": repr(tuple(scenario.gravity)),
        },
        attachments={name: path.read_bytes() for name, path in scenario.attachments.items()},
        frames=link_frames(scenario, robot),
        frame_rate=scenario.tf_rate,
    )


WORLD, MAP = "world", "map"


def link_frames(scenario: Scenario, robot: Robot) -> tuple[Frame, ...]:
    """Frame of each link relative to its parent link; for a fixed root link, relative to the world. A floating root link is
    listed among the bodies instead."""
    frames = [
        Frame(
            parent=joint.parent, child=joint.child, position=joint.origin, rotation=quaternion(joint.rpy),
            joint=joint.name if joint.moves else "", axis=joint.axis, prismatic=joint.kind == "prismatic",
        )
        for joint in robot.joints
    ]  # fmt: skip
    if scenario.fixed_base:
        root, position, rpy = robot.root.name, scenario.base_position, scenario.base_rpy
        # Many robots name their root link 'world', as viewers name the world frame: both frames are then equal, unless moved.
        if root != WORLD or any((*position, *rpy)):
            frames.append(
                Frame(parent=MAP if root == WORLD else WORLD, child=root, position=position, rotation=quaternion(rpy))
            )
    return tuple(frames)
