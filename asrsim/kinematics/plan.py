"""References of the joints, computed before the run from a Cartesian task or from desired motions of the links."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from asrsim.actuators import MODES
from asrsim.actuators.drive import Drive
from asrsim.actuators.vectorised import over_arrays
from asrsim.errors import Problem, ScenarioError
from asrsim.kinematics.drive_inverse import equilibria_for_loads
from asrsim.kinematics.inverse import INVERTED_MODES, SoftArm
from asrsim.kinematics.path import JointPath, PoseTrajectory, follow
from asrsim.robot import drive_of
from asrsim.robot.dynamics import RobotModel, robot_model
from asrsim.samples import Array
from asrsim.scenario.data import CartesianTask, for_joint
from asrsim.scenario.starts import start_positions
from asrsim.signals.base import Signal
from asrsim.signals.sampled import Sampled

if TYPE_CHECKING:
    from asrsim.robot.model import Robot
    from asrsim.scenario.data import Scenario

PLAN_STEP = 2e-3
"""Time step of the inverse kinematics, s; references are interpolated linearly between the results of the steps."""
ORIENTATION_TOLERANCE = 0.01
"""Orientation error above which a pose counts as unreachable, rad."""
BENDS = (0.0, 0.3, -0.3)
"""Offsets of all moving joints from initial positions that are not on the path, rad or m. From each of these positions, initial
positions on the path are sought. A stretched arm needs the offsets, since its point cannot move along the arm.
"""


def plan(
    task: CartesianTask,
    model: RobotModel,
    drives: Sequence[Drive],
    initial: Mapping[str, float],
    duration: float,
    *,
    presets: Mapping[str, Signal] | None = None,
) -> tuple[JointPath, dict[str, dict[str, Array]]]:
    """Path of the links that moves the task's point along its poses, and values (n,) of the references at the times of this
    path, by joint and name of the reference.

    drives: drives of the actuated joints. A joint that the task does not move stays at its initial position; with gravity
    compensation, the references of this joint account for the weight. initial: initial link positions by joint, 0 by default.
    duration: length of the run, s. presets: second references by joint; default: the preset of the task, or the typical preset
    of the actuator if the task has none.
    Raises ScenarioError for paths that the robot cannot follow (the error names the time), and for loads
    that a spring or motor cannot hold.
    """
    start = np.array([initial.get(joint, 0.0) for joint in model.joints])
    driven = task.joints or tuple(drive.joint for drive in drives)
    free = model.couplings.free
    moving = [joint in driven and j in free for j, joint in enumerate(model.joints)]
    trajectory = PoseTrajectory.through(task.poses, task.interpolation, model.pose(start, task.link, task.point))
    count = max(round(duration / PLAN_STEP), 1)
    time = np.linspace(0.0, duration, count + 1)
    path = follow(model, task.link, task.point, trajectory, start, time, moving=moving, gain=task.gain, damping=task.damping)
    _check_path(task, model, trajectory, path, moving)
    loads = model.gravity_torques(path.positions) if task.gravity_compensation else None
    references = {}
    for drive in drives:
        index = model.joints.index(drive.joint)
        preset = np.full(len(time), for_joint(task.preset, drive.joint, drive.actuator.typical_preset))
        if presets and drive.joint in presets:
            preset = presets[drive.joint].values(time)
        equilibria = path.positions[:, index].copy()
        if loads is not None and drive.mode.spring:
            equilibria = equilibria_for_loads(drive, equilibria, loads[:, index], preset, droop=task.motor_droop, time=time)
        references[drive.joint] = _references(drive, equilibria, preset)
    return path, references


def _check_path(
    task: CartesianTask, model: RobotModel, trajectory: PoseTrajectory, path: JointPath, moving: Sequence[bool]
) -> None:
    """Raise ScenarioError if the initial pose of the point is not on the path, or if the robot cannot follow the path."""
    if trajectory.times[0] == 0.0 and path.position_error[0] > max(task.tolerance, 0.01):
        position, _ = model.pose(path.positions[0], task.link, task.point)
        first = replace(trajectory, times=trajectory.times[:1], positions=trajectory.positions[:1])
        starts = [np.clip(path.positions[0] + bend * np.array(moving), model.lower, model.upper) for bend in BENDS]
        times = np.arange(200.0)
        reached = [follow(model, task.link, task.point, first, start, times, moving=moving) for start in starts]
        still = min(reached, key=lambda one: float(one.position_error[-1]))
        wanted = ", ".join(f"{joint}: {value:.4g}" for joint, value in zip(model.joints, still.positions[-1], strict=True))
        close = still.position_error[-1] <= task.tolerance
        raise ScenarioError(
            f"the robot starts with the point at {_text(position)} m, but the first pose, at 0 s, is "
            f"{_text(trajectory.positions[0])} m",
            key="task.poses",
            hint=f"start at {f'initial positions {{{wanted}}}' if close else 'the first pose'}, or give the pose a later time",
            code="start-off-path",
        )
    turn = max(ORIENTATION_TOLERANCE, task.tolerance)
    settled = path.time >= (5.0 / task.gain if path.position_error[0] > task.tolerance else 0.0)
    missed = settled & ((path.position_error > task.tolerance) | (path.orientation_error > turn))
    if not missed.any():
        return
    time = path.time[[np.argmax(missed)]]
    raise ScenarioError(
        f"the robot cannot follow the path beyond {time[0]:.3g} s, {_text(trajectory.at(time)[0][0])} m: "
        f"it deviates by more than {task.tolerance:g} m or {turn:g} rad",
        key="task.poses",
        hint="The path may be out of reach, or a joint stop or a stretched posture prevents it: begin in another posture, add "
        "a pose on the way, go slower, raise the gain or allow more tolerance",
        code="unreachable",
    )


def _references(drive: Drive, equilibria: Array, preset: Array) -> dict[str, Array]:
    """Values of each reference of the mode, by name, for the given equilibrium positions."""
    mode = drive.mode
    if len(mode.references) == 1:
        return {mode.references[0]: equilibria}
    if mode.mapped:
        return {mode.references[0]: equilibria, mode.references[1]: preset}
    names = mode.references_of(drive.actuator.motors)
    return dict(zip(names, over_arrays(drive.actuator.motor_references)(equilibria, preset), strict=False))


def _text(point: Array) -> str:
    return "(" + ", ".join(f"{value:.4g}" for value in point) + ")"


def plan_references(scenario: Scenario, robot: Robot, model: RobotModel | None = None) -> Scenario:
    """Scenario in which references replace the task or the desired motions; the unchanged scenario if it has neither a task nor
    desired motions.

    robot: the robot with the scenario's modes and parameters. model: model of the robot; None: a model with the masses of the
    robot file. Presets in the scenario's references are kept, and gravity compensation accounts for them. Raises ScenarioError
    for poses that cannot be reached and loads that cannot be held.
    """
    if scenario.task is None:
        planned = inputs_for_motions(scenario, robot, model) if any(scenario.inverse_dynamics.values()) else {}
        desired: dict[str, Signal] = {
            joint: scenario.references_of(joint)[name] for joint, signals in planned.items() for name in signals
        }
    else:
        try:
            path, references = plan_task(scenario, robot, model)
        except ScenarioError as error:
            raise ScenarioError([scenario.placed(problem) for problem in error.problems]) from None
        planned = {joint: _signals(path.time, values) for joint, values in references.items()}
        joints = [joint.name for joint in robot.moving_joints]
        desired = _signals(path.time, dict(zip(joints, path.positions.T, strict=True)))
    if not planned:
        return scenario
    # Replace the task by its references, so that the task is not planned again if the scenario is prepared again.
    changed = {joint: {**scenario.references_of(joint), **signals} for joint, signals in planned.items()}
    return replace(
        scenario, references={**scenario.references, **changed}, inverse_dynamics={}, desired={**desired, **scenario.desired}
    )


def _signals(time: Array, values: Mapping[str, Array]) -> dict[str, Signal]:
    """Signals of values (n,) at `time` (n,), by name."""
    return {name: Sampled(times=time, samples=np.ascontiguousarray(column)) for name, column in values.items()}


def inputs_for_motions(scenario: Scenario, robot: Robot, model: RobotModel | None = None) -> dict[str, dict[str, Signal]]:
    """First references, by joint, that move the links as the scenario's `inverse_dynamics` requires.

    Raises ScenarioError for modes whose first reference is not a position, and for torques that a spring cannot give.
    """
    chosen = [block for block in robot.actuators if for_joint(scenario.inverse_dynamics, block.joint, False)]
    problems = [
        Problem(
            f"mode {block.mode} has no position as its first reference",
            key=f"inverse_dynamics.{block.joint}",
            choices=tuple(f"{mode} {MODES[mode].name}" for mode in INVERTED_MODES),
            code="mode-not-inverted",
        )
        for block in chosen
        if block.mode not in INVERTED_MODES
    ]
    names = {block.joint: MODES[block.mode].references[0] for block in chosen}
    problems += [
        Problem(f"needs the desired motion of the link under {name}", key=f"references.{joint}", code="no-motion")
        for joint, name in names.items()
        if name not in scenario.references_of(joint)
    ]
    if problems:
        raise ScenarioError([scenario.placed(problem) for problem in problems])
    joints = tuple(names)
    time = scenario.step_times()
    wanted = np.column_stack([scenario.references_of(joint)[name].values(time) for joint, name in names.items()])
    arm = SoftArm(scenario=scenario, robot=robot, own_model=model)
    inverse = arm.inverse(time, joints, wanted)
    unheld = [demand for demand in inverse.demands if demand.score > 1.0 and demand.what == "spring torque"]
    if unheld:
        raise ScenarioError(
            [
                Problem(
                    f"the motion is out of reach: {demand}",
                    key=f"references.{demand.joint}",
                    code="spring-too-weak",
                    hint="Take a stiffer spring or preset, or a slower motion",
                )
                for demand in unheld
            ]
        )
    inputs = inverse.inputs_at(time, [arm.delay(joint) for joint in joints])
    return {joint: _signals(time, {names[joint]: column}) for joint, column in zip(joints, inputs.T, strict=True)}


def plan_task(
    scenario: Scenario, robot: Robot, model: RobotModel | None = None
) -> tuple[JointPath, dict[str, dict[str, Array]]]:
    """Joint path and references for the task of a scenario. Raises ScenarioError as `plan_references` does."""
    if scenario.task is None:
        raise ScenarioError("the scenario has no Cartesian task", key="task", code="no-task")
    drives = [drive_of(block) for block in robot.actuators]
    presets: dict[str, Signal] = {}
    for drive in drives:
        names = drive.mode.references
        given = scenario.references_of(drive.joint)
        if drive.mode.mapped and names[1] in given:
            presets[drive.joint] = given[names[1]]
    initial = start_positions(scenario, robot)
    return plan(scenario.task, model or robot_model(scenario, robot), drives, initial, scenario.duration, presets=presets)
