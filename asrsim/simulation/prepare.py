"""Preparation of a scenario: read the robot, build actuators and engine, determine the number of substeps."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from asrsim.errors import InputError, Problem, RobotError
from asrsim.robot.model import Robot
from asrsim.samples import Array
from asrsim.scenario.data import Scenario
from asrsim.scenario.overrides import Overrides
from asrsim.simulation.describe import describe
from asrsim.simulation.drives import SteppedJoint, make_drives, with_sensors
from asrsim.simulation.equilibrium import at_equilibrium
from asrsim.simulation.prepared import Prepared, make_engine
from asrsim.simulation.ranges import ranges_of
from asrsim.simulation.steppings import STEPPINGS
from asrsim.simulation.substeps import resolution_of

SINGULAR = 1e-12
"""Smallest eigenvalue of the mass matrix, with its diagonal scaled to 1, that double precision can distinguish from 0."""


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
        if scenario.initial_equilibrium and engine.model is not None:
            drives = at_equilibrium(scenario, drives, engine.model)
        if engine.model is not None:
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
        warnings=(*map(scenario.placed, robot.warnings), *warnings, *engine_warnings),
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
