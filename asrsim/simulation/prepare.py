"""A scenario made ready to run: robot read, actuators built, engine set up, substeps found."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from asrsim.engines.base import Engine
from asrsim.errors import Problem, RobotError
from asrsim.robot.model import Robot
from asrsim.samples import Array, RunInfo
from asrsim.scenario.data import Scenario, for_joint
from asrsim.simulation.describe import describe
from asrsim.simulation.drives import Drive, make_drives
from asrsim.simulation.inputs import Inputs
from asrsim.simulation.loop import Hook
from asrsim.simulation.steppings import STEPPINGS, Stepping
from asrsim.simulation.substeps import Resolution, reachable_stiffness, resolve
from asrsim.simulation.wrenches import wrench_hook

SINGULAR = 1e-12
"""Smallest eigenvalue of the mass matrix, its diagonal scaled to 1, that double precision can tell from none."""
CONFIGURATIONS = 8
"""Random joint positions, beside the initial ones, in which the mass matrix is looked at."""


@dataclass(frozen=True, kw_only=True)
class Prepared:
    """A scenario made ready: everything but the running."""

    scenario: Scenario
    robot: Robot
    stepping: Stepping
    drives: tuple[Drive, ...]
    resolution: Resolution
    engine: Engine
    inputs: Inputs
    hooks: tuple[Hook, ...]
    info: RunInfo
    warnings: tuple[Problem, ...]

    @property
    def substep(self) -> float:
        """s."""
        return self.scenario.step / self.resolution.substeps


def prepare(scenario: Scenario, robot: Robot | None = None) -> Prepared:
    """Build the actuators and the engine; raises RobotError, ScenarioError or UnresolvedSpringError."""
    from asrsim.scenario import apply_to_robot, checked_robot

    robot, warnings = checked_robot(scenario, robot)
    robot = apply_to_robot(scenario, robot)
    stepping = STEPPINGS.get(scenario.stepping)
    drives = make_drives(robot, stepping, initial_positions=scenario.initial_positions, link_damping=scenario.link_damping)
    if scenario.task is not None:
        from asrsim.kinematics import plan_references

        scenario = plan_references(scenario, robot)
    engine, engine_warnings = make_engine(scenario, robot)
    try:
        resolution = _resolve(scenario, drives, engine)
        substep = scenario.step / resolution.substeps
        engine.set_step(substep)
        inputs = Inputs(scenario, drives, substep=substep, staggered=stepping.staggered)
        drives, hooks = _sensing(scenario, drives, substep)
        hooks += tuple(
            wrench_hook(wrench, engine, substep=substep, staggered=stepping.staggered) for wrench in scenario.wrenches
        )
        info = describe(scenario, robot, drives, stepping, resolution)
    except BaseException:
        engine.close()
        raise
    return Prepared(
        scenario=scenario,
        robot=robot,
        stepping=stepping,
        drives=drives,
        resolution=resolution,
        engine=engine,
        inputs=inputs,
        hooks=hooks,
        info=info,
        warnings=(*robot.warnings, *warnings, *engine_warnings),
    )


def make_engine(scenario: Scenario, robot: Robot) -> tuple[Engine, tuple[Problem, ...]]:
    """The scenario's engine, at its step."""
    from asrsim.engines import ENGINES

    built: tuple[Engine, tuple[Problem, ...]] = ENGINES.get(scenario.engine)(scenario, robot)
    return built


def _resolve(scenario: Scenario, drives: Sequence[Drive], engine: Engine) -> Resolution:
    points = np.linspace(0.0, scenario.duration, 2001)
    sampled = Inputs(scenario, drives, substep=scenario.step, staggered=False).sample(points)
    configurations = _configurations(drives)
    masses = [engine.mass_matrix(position) for position in configurations]
    _check_inertia(drives, masses[0])
    gravity = np.max([np.abs(engine.gravity_torques(position)) for position in configurations], axis=0)
    external = np.max(np.abs(sampled[2]), axis=0)
    stiffness = [
        reachable_stiffness(
            drive,
            sampled[0][:, j],
            sampled[1][:, j],
            interval=scenario.duration / 2000,
            load=float(gravity[j] + external[j]),
            inertia=max(float(mass[j, j]) for mass in masses),
        )
        for j, drive in enumerate(drives)
    ]
    if STEPPINGS.get(scenario.stepping).released:
        # The released code knows no substeps, and runs springs that it does not resolve.
        finite = np.minimum(stiffness, 1e12).tolist()
        found = resolve(drives, masses, finite, step=scenario.step, substeps=None, motor_substeps=1, cap=10**15)
        return replace(found, substeps=1, motor_substeps=1, omega_h=found.frequency * scenario.step, stiffness=tuple(stiffness))
    return resolve(
        drives,
        masses,
        stiffness,
        step=scenario.step,
        substeps=scenario.substeps,
        motor_substeps=scenario.motor_substeps,
        cap=scenario.substep_cap,
    )


def _check_inertia(drives: Sequence[Drive], mass: Array) -> None:
    """A joint that turns nothing (a point mass on its own axis), or two on one axis with no mass between them, have no
    equation of motion; raises RobotError.
    """
    problems = [
        Problem(
            message=f"what joint '{drive.name}' moves has no inertia about its axis, so its motion is not defined",
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
        share = np.abs(vectors[:, 0])
        names = ", ".join(f"'{drive.name}'" for drive, part in zip(drives, share, strict=True) if part > 0.1 * share.max())
        raise RobotError(
            Problem(
                message=f"joints {names} can move against each other without moving any mass: their motion is not defined",
                hint="Give the links between them inertias",
                code="massless-motion",
            )
        )


def _configurations(drives: Sequence[Drive]) -> list[list[float]]:
    """Joint positions at which the mass matrix counts: the initial ones and some within the limits."""
    # The standard library's generator: numpy.random takes longer to import than a short run.
    generator = random.Random(0)
    pairs = [
        (
            -math.pi if d.joint.lower is None else max(d.joint.lower, -math.pi),
            math.pi if d.joint.upper is None else min(d.joint.upper, math.pi),
        )
        for d in drives
    ]
    initial = [drive.initial_position for drive in drives]
    return [initial, *([generator.uniform(low, max(low, high)) for low, high in pairs] for _ in range(CONFIGURATIONS))]


def _sensing(scenario: Scenario, drives: Sequence[Drive], substep: float) -> tuple[tuple[Drive, ...], tuple[Hook, ...]]:
    from asrsim.simulation.sensors import sensed

    changed: list[Drive] = []
    hooks: list[Hook] = []
    for index, drive in enumerate(drives):
        effects = for_joint(scenario.sensor_effects, drive.name)
        if effects is not None and effects.active and drive.mode is not None and drive.mode.controller:
            seen, hook = sensed(drive, effects, substep=substep, index=index, seed=scenario.seed)
            hooks.append(hook)
            changed.append(seen)
        else:
            changed.append(drive)
    return tuple(changed), tuple(hooks)
