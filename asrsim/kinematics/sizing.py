"""Checks that springs and motors hold the arm's own weight, and proposed parameters with which the arm holds and comes to rest.

Responses to steps and oscillations are estimated joint by joint, with the mass matrix of the zero pose.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from asrsim.actuators import ACTUATORS, MODES, Actuator
from asrsim.errors import Problem
from asrsim.kinematics.holding import Holding, goals_of, holdings
from asrsim.robot import ActuatorBlock, Robot
from asrsim.robot.inertia import zero_pose_matrix
from asrsim.robot.mounting import drive_of
from asrsim.scenario.data import for_joint
from asrsim.scenario.doubts import made_elsewhere

if TYPE_CHECKING:
    from asrsim.scenario.data import Scenario

SAG = 0.3
"""Sag above which a joint gets a warning, rad; every soft arm sags a little. For a prismatic joint, or a travel below 1 rad:
fraction of the joint's scale (see `Holding.scale`)."""
ENOUGH = 0.15
"""Sag with proposed parameters, rad or fraction of the scale. This value is below `SAG` as a margin for neglected effects."""
RESERVE = 0.5
"""Largest fraction of a motor's torque that holds an arm with proposed parameters. The rest moves the arm.
(Measured on 35 random arms without damping. At 0.8, two arms were at their motors' limits for two thirds of a run, with mean
errors of 0.06 and 0.07 m at sliders. At 0.5, one arm was at its limits for a third of the run, with a mean error of 0.02 m.)"""
TRIES = 40
"""Largest number of attempts to find parameters."""
SLOW = 5.0
"""Lowest natural frequency of a joint with proposed parameters, rad/s. A slower joint does not reach its reference in a run of
a few seconds, even with good damping."""
STEP_SHARE = 0.6
"""Fraction of a motor's largest torque that a step of its reference needs with proposed parameters."""
LONGEST_DECAY = 8.0
"""Settling time (to 5 %) with the damping of the robot file above which a warning is given, s."""
RATIO = 0.3
"""Proposed damping ratio of a joint. In an overdamped arm, the effect of the springs would not be visible."""


@dataclass(frozen=True, kw_only=True)
class Sizing:
    """Sag of the joints, and parameters that would hold the arm."""

    joints: tuple[Holding, ...]
    """Sag of each joint that has a spring."""
    proposal: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Values of parameters, by joint and parameter, with which no joint sags too much. Empty if no joint sags too much, or if
    no such values were found."""

    @property
    def weak(self) -> tuple[Holding, ...]:
        """Joints that sag too much or fall."""
        return _beyond(self.joints, SAG)


def sizing(scenario: Scenario, robot: Robot, *, propose: bool = True, sag: float = SAG) -> Sizing:
    """Sag of the joints at the references of a scenario, and parameters that would hold them.

    robot: the robot with the scenario's modes and parameters. The function ignores floating bases, modes without springs,
    torque, voltage and current references, and references that already account for the weight (of a task, of learning, or of
    a joint with a `desired` motion). sag: sag above which parameters are proposed for a joint; see `SAG`.
    """
    blocks = [
        block
        for block in _sprung(robot)
        if not made_elsewhere(scenario, block.joint) and for_joint(scenario.desired, block.joint) is None
    ]
    if not scenario.fixed_base or not any(scenario.gravity) or not blocks:
        return Sizing(joints=())
    joints = holdings(scenario, robot, blocks)
    if not propose or not _beyond(joints, sag):
        return Sizing(joints=joints)
    # No parameter changes an effort limit: a joint with too low a limit gets its own warning.
    robot = replace(robot, joints=tuple(replace(joint, effort=None) for joint in robot.joints))
    changed = {block.joint: block for block in blocks}
    weak = _beyond(holdings(scenario, robot, blocks), sag)
    proposal: dict[str, dict[str, float]] = {}
    for _ in range(TRIES):
        for one in weak:
            given = _stronger(changed[one.joint], one)
            if not given:
                return Sizing(joints=joints)
            proposal[one.joint] = proposal.get(one.joint, {}) | given
            changed[one.joint] = _with_values(changed[one.joint], given)
        weak = _beyond(holdings(scenario, robot, [_in_reserve(block) for block in changed.values()]), ENOUGH)
        if not weak:
            return Sizing(joints=joints, proposal=proposal)
    return Sizing(joints=joints)


def holding_findings(scenario: Scenario, robot: Robot, *, propose: bool) -> tuple[Problem, ...]:
    """Warnings for joints that sag or fall under the arm's own weight. propose: whether to search for parameters that hold the
    arm, which takes about ten times as long."""
    cure = "Choose stiffer actuators or a lighter arm" if propose else "`asrsim check` proposes parameters that hold the arm"
    return problems_of_weight(sizing(scenario, robot, propose=propose), robot, scenario.path, cure=cure)


def problems_of_weight(
    found: Sizing, robot: Robot, file: Path | None = None, *, cure: str = "Choose stiffer actuators or a lighter arm"
) -> tuple[Problem, ...]:
    """Warnings, one for each joint that sags or falls. cure: hint of the warnings if no parameters are proposed."""
    values = ", ".join(
        f"{joint}: {{{', '.join(f'{name}: {value:g}' for name, value in given.items())}}}"
        for joint, given in found.proposal.items()
    )
    hint: str | None = f"with parameters: {{{values}}} springs and motors hold the arm" if values else cure
    problems = []
    for one in found.weak:
        force, length = ("N", "m") if robot.joint(one.joint).kind == "prismatic" else ("N m", "rad")
        what = "falls onto its stop" if one.on_stop else "falls" if one.falls else f"sags by {one.sag:.2g} {length}"
        soft = "the controllers of its motors" if one.droop > 0.5 * one.sag else "its springs"
        limit = f"its effort limit of {robot.joint(one.joint).effort or 0.0:g} {force} is too low"
        why = limit if one.overloaded else "its motors are too weak" if one.limited else f"{soft} are too soft"
        message = f"{what} under the arm's own weight, {abs(one.load):.3g} {force} at {one.time:g} s: {why}"
        code = "falls" if one.falls else "sags"
        if one.overloaded:
            message_hint: str | None = "Raise `effort` in the <limit> of the robot's file"
        else:
            message_hint, hint = hint, None
        problems.append(Problem(message, file=file, key=one.joint, hint=message_hint, code=code))
    return tuple(problems)


def steadying(scenario: Scenario, robot: Robot) -> dict[str, dict[str, float]]:
    """Values of parameters, by joint and parameter, with which no joint is slow and the motors can follow reference steps."""
    inertia, blocks = _carried(robot), _sprung(robot)
    loads = {one.joint: abs(one.load) for one in holdings(scenario, robot, blocks)} if any(scenario.gravity) else {}
    found: dict[str, dict[str, float]] = {}
    for block in blocks:
        spring, step = _stiffness_and_step(scenario, block)
        factor = max(SLOW**2 * inertia[block.joint] / max(spring, 1e-9), 1.0)
        changes = dict.fromkeys(linear_parameters(ACTUATORS.get(block.actuator), block.values()), factor)
        if 2.0 * factor * spring > sum(drive_of(block).proportional):
            changes |= {name: factor for name in block.values() if name.endswith("_proportional")}
        needed = factor * spring * step + loads.get(block.joint, 0.0)
        lacking = needed / (STEP_SHARE * min(drive_of(block).max_torque, default=math.inf))
        changes |= dict.fromkeys(motor_limits(block.values()), lacking)
        values = {name: _rounded(part * block.values()[name]) for name, part in changes.items() if part > 1.0}
        found |= {block.joint: values} if values else {}
    return found


def calming(scenario: Scenario, robot: Robot) -> tuple[float, Mapping[str, Mapping[str, float]]]:
    """Settling time of the arm with the damping of the robot file in s, and proposed keys of `link_damping` by joint. The
    proposal is empty if the arm settles soon, or if its masses are unknown."""
    inertia = _carried(robot)
    lasts, keys = 0.0, {}
    for block in _sprung(robot):
        own, damping = inertia[block.joint], robot.joint(block.joint).damping
        critical = 2.0 * math.sqrt(own * max(_stiffness_and_step(scenario, block)[0], 0.0))
        if damping < RATIO * critical:
            lasts = max(lasts, 6.0 * own / max(damping, 1e-9))
            keys[block.joint] = {"ratio": RATIO, "inertia": _rounded(own)}
    return (lasts, keys) if lasts > LONGEST_DECAY else (0.0, {})


def _sprung(robot: Robot) -> list[ActuatorBlock]:
    """Actuators with a spring and a position as reference."""
    return [block for block in robot.actuators if MODES[block.mode].spring and not MODES[block.mode].direct]


def _beyond(joints: tuple[Holding, ...], sag: float) -> tuple[Holding, ...]:
    """Joints that sag by more than `sag` (a fraction of their scale), or come to rest on a stop."""
    return tuple(one for one in joints if one.on_stop or one.sag > sag * one.scale)


def _carried(robot: Robot) -> dict[str, float]:
    """Inertia that the spring of each joint moves if all joints accelerate equally, kg m^2, by joint."""
    names = [joint.name for joint in robot.moving_joints]
    return dict(zip(names, np.abs(zero_pose_matrix(robot)).sum(axis=1).tolist(), strict=True))


def _stiffness_and_step(scenario: Scenario, block: ActuatorBlock) -> tuple[float, float]:
    """Stiffness of the springs in N m/rad at the last references, and change of the references during the run in rad."""
    drive = drive_of(block)
    motors, goal = goals_of(scenario, block, np.array([0.0, scenario.duration]))
    law: Any = drive.actuator.stiffness
    return float(law(float(goal[-1]), *(float(motor[-1]) for motor in motors), drive.elastic)), float(np.ptp(goal))


def _stronger(block: ActuatorBlock, weak: Holding) -> dict[str, float]:
    """Parameters of stronger motors if a motor is at its limit, else of stiffer controllers or springs; empty if no parameter
    would help."""
    actuator, values = ACTUATORS.get(block.actuator), block.values()
    most = 4.0 if weak.falls else 2.0
    # The sag of a joint on its stop is unknown, since the stop ends the motion.
    factor = most if weak.on_stop else min(max(1.25, math.sqrt(weak.sag / (ENOUGH * weak.scale))), most)
    drive = drive_of(block)
    lacking = abs(weak.load) / (RESERVE * min(drive.max_torque, default=math.inf))
    # A load above the spring's largest torque may hide that the motor reached its limit first.
    if weak.limited or lacking > 1.0:
        names, factor = motor_limits(values), max(1.25, lacking)
    elif weak.droop > 0.3 * weak.sag:
        names = tuple(f"controller_{i}_proportional" for i in range(1, actuator.motors + 1))
    else:
        names = linear_parameters(actuator, values)
    return {name: _rounded(factor * values[name]) for name in names}


def linear_parameters(actuator: type[Actuator], values: Mapping[str, float]) -> tuple[str, ...]:
    """Names of the spring parameters with N in their units, if the torque is proportional to them; else empty."""
    names = tuple(parameter.name for parameter in actuator.parameters if "N" in parameter.unit.split("/")[0])
    point = (0.0, *actuator.motor_references(0.1, actuator.typical_preset))
    once, twice = (
        actuator.elastic_torques(
            *point, tuple(values[p.name] * (factor if p.name in names else 1.0) for p in actuator.parameters)
        )
        for factor in (1.0, 2.0)
    )
    linear = any(once) and all(math.isclose(b, 2.0 * a, rel_tol=1e-9, abs_tol=1e-12) for a, b in zip(once, twice, strict=True))
    return names if linear else ()


def motor_limits(values: Mapping[str, float]) -> tuple[str, ...]:
    """Names of the motors' limits of torque, voltage and current, to which the largest torques are proportional."""
    limits = ("_max_torque", "_max_voltage", "_max_current")
    return tuple(name for name, value in values.items() if name.endswith(limits) and math.isfinite(value))


def _in_reserve(block: ActuatorBlock) -> ActuatorBlock:
    """Copy of the actuator block with motor limits multiplied by `RESERVE`; the rest of the torque is reserved for motion."""
    values = block.values()
    return _with_values(block, {name: RESERVE * values[name] for name in motor_limits(values)})


def _with_values(block: ActuatorBlock, given: Mapping[str, float]) -> ActuatorBlock:
    parameters = {name: replace(one, value=given.get(name, one.value)) for name, one in block.parameters.items()}
    return replace(block, parameters=parameters)


def _rounded(value: float) -> float:
    """The value rounded to two significant digits."""
    return float(f"{value:.2g}")
