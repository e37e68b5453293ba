"""Preparation of a scenario: read the robot, build actuators and engine, determine the number of substeps, describe the run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from asrsim.errors import InputError, Problem, RobotError
from asrsim.robot.model import Robot
from asrsim.robot.poses import quaternion
from asrsim.samples import Array, Frame, JointInfo, RunInfo
from asrsim.scenario.data import Scenario
from asrsim.scenario.overrides import Overrides
from asrsim.simulation.drives import SteppedJoint, make_drives, with_sensors
from asrsim.simulation.equilibrium import at_equilibrium
from asrsim.simulation.prepared import Prepared, make_engine
from asrsim.simulation.quantities import recorded_quantities
from asrsim.simulation.ranges import ranges_of
from asrsim.simulation.steppings import STEPPINGS, Stepping
from asrsim.simulation.substeps import Resolution, resolution_of

SINGULAR = 1e-12
"""Smallest eigenvalue of the mass matrix, with its diagonal scaled to 1, that double precision can distinguish from 0."""
WORLD, MAP = "world", "map"


def one_scenario(scenario: str | Path | Scenario, *, variant: str | None = None, overrides: Overrides = ()) -> Scenario:
    """The scenario of a file, or the given scenario itself. Raises ScenarioError and InputError."""
    from asrsim.scenario import load_scenario, only_variant

    if not isinstance(scenario, Scenario):
        return only_variant(load_scenario(scenario, variant=variant, overrides=overrides))
    if variant not in (None, scenario.variant) or overrides:
        message = "variant and overrides are not allowed with a Scenario object"
        raise InputError(message, hint="Give them when the scenario is loaded", code="usage")
    return scenario


def prepare(
    scenario: str | Path | Scenario,
    robot: Robot | None = None,
    *,
    variant: str | None = None,
    overrides: Overrides = (),
    settable: bool = False,
) -> Prepared:
    """Build the actuators and the engine; raises RobotError, ScenarioError or UnresolvedSpringError.

    variant, overrides: of a scenario's file, as `asrsim.run` takes them. The number of substeps is chosen for the scenario's
    references, and for all values in its `reference_ranges`. settable: whether callers may set all references within the limits
    of the robot; the scenario then gets these limits as `reference_ranges`.
    """
    from asrsim.scenario import apply_to_robot, checked_robot

    scenario = one_scenario(scenario, variant=variant, overrides=overrides)
    robot, warnings = checked_robot(scenario, robot)
    robot = apply_to_robot(scenario, robot)
    stepping = STEPPINGS.get(scenario.stepping)
    drives = make_drives(robot, stepping, scenario)
    if settable:
        # Only torques of joints without limits have infinite ranges; the number of substeps does not depend on these torques.
        ranges = {
            joint: {name: pair for name, pair in own.items() if all(map(math.isfinite, pair))}
            for joint, own in ranges_of(scenario, drives).items()
        }
        scenario = replace(scenario, reference_ranges=ranges)
    if scenario.task is not None or any(scenario.inverse_dynamics.values()):
        # Imported only here, since most short runs do not need it.
        from asrsim.kinematics import plan_references

        scenario = plan_references(scenario, robot)
    engine, engine_warnings = make_engine(scenario, robot)
    try:
        if engine.model is not None:
            if scenario.initial_equilibrium:
                drives = at_equilibrium(scenario, drives, engine.model)
            check_inertia(drives, engine.model.mass_matrix([drive.initial_position for drive in drives]))
        resolution = resolution_of(scenario, drives, engine.model)
        substep = scenario.step / resolution.substeps
        drives = with_sensors(drives, scenario, substep)
        info = describe(scenario, robot, drives, stepping, resolution, engine.version)
    except BaseException:
        engine.close()
        raise
    return Prepared(
        scenario=scenario,
        robot=robot,
        stepping=stepping,
        drives=drives,
        resolution=resolution,
        info=info,
        warnings=(*robot.warnings, *warnings, *engine_warnings),
        _spare=[engine],
    )


def check_inertia(drives: Sequence[SteppedJoint], mass: Array) -> None:
    """Raise RobotError if a motion has no inertia: a joint with a point mass on its axis, or two joints on one axis with no
    mass between them.
    """
    problems = [
        Problem(
            f"what joint '{drive.name}' moves has no inertia about its axis, so its motion is not defined",
            line=drive.joint.line,
            key=drive.name,
            hint=f"Give link '{drive.joint.child}' an inertia",
            code="massless-joint",
        )
        for j, drive in enumerate(drives)
        if not mass[j, j] > 0.0
    ]
    if problems:
        raise RobotError(problems)
    scale = 1.0 / np.sqrt(np.diag(mass))
    values, vectors = np.linalg.eigh(mass * np.outer(scale, scale))
    if values[0] < SINGULAR:
        share = np.linalg.norm(vectors[:, values < SINGULAR], axis=1)
        names = ", ".join(f"'{drive.name}'" for drive, part in zip(drives, share, strict=True) if part > 0.1 * share.max())
        raise RobotError(
            f"joints {names} can move against each other without moving any mass: their motion is not defined",
            hint="Give the links between them inertias",
            code="massless-motion",
        )


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
