"""Warnings about arms that sag under their own weight, and proposed parameters with which an arm holds and comes to rest.

Responses to steps and oscillations are estimated joint by joint, with the mass matrix of the zero pose.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from asrsim.actuators import Actuator
from asrsim.actuators.vectorised import over_arrays
from asrsim.errors import Problem
from asrsim.robot import ActuatorBlock, Robot
from asrsim.robot.dynamics import RobotModel, robot_model
from asrsim.robot.mounting import drive_of
from asrsim.robot.values import with_overrides
from asrsim.scenario.starts import start_positions
from asrsim.statics.holding import Holding, goals_of, holdings, scale_of, sprung

if TYPE_CHECKING:
    from asrsim.scenario.data import Scenario

POSTURES = 64
"""Number of random postures in which the largest torque of gravity on each joint is sought."""
MOBILE_POSTURES = 16
"""Number of random postures in which the smallest inertia of each joint is sought."""
ENOUGH = 0.15
"""Largest sag in any posture with proposed parameters, rad or fraction of the scale. This value is below `SAG` as a margin for
neglected effects."""
MOTOR_SHARE = 0.5
"""Largest fraction of a motor's torque that holds and moves an arm with proposed parameters."""
SLOWEST = 5.0
"""Lowest natural frequency of a joint with proposed parameters, rad/s. A slower joint does not reach its reference in a run of
a few seconds, even with good damping."""
CARRYING = 3.0
"""Largest natural frequency of a joint that carries weight, as a multiple of the highest frequency of the joints that carry no
weight.
"""
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
    """Values of parameters, by joint and parameter, with which no joint would sag too much. Empty if no joint sags too much
    with the present values, or if no better values were found.
    """

    @property
    def weak(self) -> tuple[Holding, ...]:
        """Joints that sag too much or fall."""
        return tuple(one for one in self.joints if one.weak)


def sizing(scenario: Scenario, robot: Robot) -> Sizing:
    """Sag of the joints at the references of a scenario, and parameters that would hold the joints; arguments as for
    `holdings`."""
    return _sized(scenario, robot, robot_model(scenario, robot), propose=True)


def weight_warnings(scenario: Scenario, robot: Robot, model: RobotModel, *, propose: bool = False) -> tuple[Problem, ...]:
    """Warnings about joints that sag or fall in a valid scenario; see `holdings`. A robot with closed chains is not checked.

    propose: whether parameters are proposed for the weak joints, which takes some time.
    """
    if robot.loops:
        return ()
    return problems_of_weight(_sized(scenario, robot, model, propose=propose), robot, scenario.path)


def _sized(scenario: Scenario, robot: Robot, model: RobotModel, *, propose: bool) -> Sizing:
    """Sag of the joints, with a proposal for the weak joints if `propose` is set."""
    found = Sizing(joints=holdings(scenario, robot, model))
    return replace(found, proposal=_proposal(scenario, robot, model)) if propose and found.weak else found


def _proposal(scenario: Scenario, robot: Robot, model: RobotModel) -> dict[str, dict[str, float]]:
    """Values of parameters, by joint and parameter, with which no joint sags too much; empty if no such values were found."""

    def weak(robot: Robot) -> list[str]:
        return [one.joint for one in holdings(scenario, robot, model) if one.weak]

    # Ignore effort limits, since no parameter changes them. A joint whose effort limit is too low gets a separate warning.
    endless = replace(robot, joints=tuple(replace(joint, effort=None) for joint in robot.joints))
    left, proposal = weak(endless), dict[str, dict[str, float]]()
    stronger = strengthened(scenario, robot) if left else {}
    # Check the proposal, since joints with stronger motors and springs may load other joints, which then sag.
    while any(joint in stronger for joint in left):
        proposal |= {joint: stronger.pop(joint) for joint in left if joint in stronger}
        left = weak(with_overrides(endless, parameters=proposal))
    return {} if left else proposal


def problems_of_weight(found: Sizing, robot: Robot, file: Path | None = None) -> tuple[Problem, ...]:
    """Warnings, one for each joint that sags or falls."""
    values = ", ".join(
        f"{joint}: {{{', '.join(f'{name}: {value:g}' for name, value in given.items())}}}"
        for joint, given in found.proposal.items()
    )
    hint: str | None = "Choose stiffer actuators or a lighter arm; `asrsim check` looks for parameters that hold the arm"
    if values:
        hint = f"with parameters: {{{values}}} springs and motors hold the arm"
    problems = []
    for one in found.weak:
        force, length = ("N", "m") if robot.joint(one.joint).kind == "prismatic" else ("N m", "rad")
        what = "falls onto its stop" if one.on_stop else "falls"
        if not one.falls:
            what = f"sags by {one.sag:.2g} {length}"
        if one.overloaded:
            why = f"its effort limit of {robot.joint(one.joint).effort or 0.0:g} {force} is too low"
            message_hint: str | None = "Raise `effort` in the <limit> of the robot's file"
        else:
            soft = "the controllers of its motors" if one.droop > 0.5 * one.sag else "its springs"
            why = "its motors are too weak" if one.limited else f"{soft} are too soft"
            # Give the hint only with the first warning, since it proposes parameters for all joints.
            message_hint, hint = hint, None
        message = f"{what} under the arm's own weight, {abs(one.load):.3g} {force} at {one.time:g} s: {why}"
        code = "falls" if one.falls else "sags"
        problems.append(Problem(message, file=file, key=one.joint, hint=message_hint, code=code))
    return tuple(problems)


def strengthened(scenario: Scenario, robot: Robot, *, fastest: float = math.inf) -> dict[str, dict[str, float]]:
    """Values of parameters, by joint and parameter, with which springs and motors hold the arm in any posture, and no joint is
    slow. Parameters that suffice are left out, and so are springs whose torque is proportional to no parameter.

    fastest: highest natural frequency of a joint, rad/s; stiffer springs are softened.
    """
    inertia, lightest, weights, found = _carried(robot), _lightest(robot), _weights(robot_model(scenario, robot)), {}
    for block in sprung(robot):
        drive, weight = drive_of(block), weights[block.joint]
        present, pretension, step = _springs(scenario, block)
        moving = SLOWEST**2 * inertia[block.joint]
        # Allow two thirds of the largest sag for the springs. The controllers, which are twice as stiff, cause the rest.
        stiffness = max(1.5 * weight / (ENOUGH * scale_of(robot.joint(block.joint))), moving)
        resolved = fastest**2 * lightest[block.joint] / max(present, 1e-9)
        # Let the weight require a higher natural frequency of the joint, up to the highest frequency that a run resolves.
        spring = min(max(stiffness / max(present, 1e-9), min(resolved, 1.0)), CARRYING**2 * resolved)
        gain = 2.0 * stiffness / max(sum(drive.proportional), 1e-9) if drive.mode.controller else 1.0
        # The last term of the torque accelerates the link for a step of its reference at the lowest frequency.
        torque = (spring * pretension + weight + moving * step) / MOTOR_SHARE
        values = block.values()
        factors = dict.fromkeys(linear_parameters(drive.actuator, values), spring)
        factors |= {name: gain for name in values if name.endswith("_proportional")}
        factors |= dict.fromkeys(motor_limits(values), torque / min(drive.max_torque, default=math.inf))
        # Leave out factors close to 1, which are due to the rounding of an earlier proposal.
        softer = spring < 1.0 / 1.05
        springs = linear_parameters(drive.actuator, values) if softer else ()
        if given := {
            name: _rounded(factor * values[name]) for name, factor in factors.items() if factor > 1.05 or name in springs
        }:
            found[block.joint] = given
    return found


def calming(scenario: Scenario, robot: Robot) -> tuple[float, Mapping[str, Mapping[str, float]]]:
    """Settling time of the arm with the damping of the robot file in s, and proposed keys of `link_damping` by joint. The
    proposal is empty if the arm settles soon, or if its masses are unknown. Without damping, the time is infinite."""
    inertia, moving = _carried(robot), robot.moving_joints
    places = robot.couplings.expand([*start_positions(scenario, robot).values()])
    dampings = robot.couplings.fold_gains([joint.damping for joint in moving], places).tolist()
    damped = dict(zip((joint.name for joint in moving), dampings, strict=True))
    lasts, keys = 0.0, {}
    for block in sprung(robot):
        own, joint = inertia[block.joint], robot.joint(block.joint)
        if joint.lower is not None and joint.lower == joint.upper:
            continue
        damping = damped[block.joint]
        critical = 2.0 * math.sqrt(own * max(_springs(scenario, block)[0], 0.0))
        if damping < RATIO * critical:
            lasts = max(lasts, 6.0 * own / damping if damping else math.inf)
            keys[block.joint] = {"ratio": RATIO, "inertia": _rounded(own)}
    return (lasts, keys) if lasts > LONGEST_DECAY else (0.0, {})


def _weights(model: RobotModel) -> dict[str, float]:
    """Largest gravity load on each joint in random postures, N m or N."""
    postures = np.random.default_rng(0).uniform(-np.pi, np.pi, (len(model.joints), POSTURES)).T
    return dict(zip(model.joints, np.abs(model.gravity_torques(postures)).max(axis=0).tolist(), strict=True))


def _carried(robot: Robot) -> dict[str, float]:
    """Inertia that the spring of each joint moves if all joints accelerate equally, kg m^2, by joint."""
    names = [joint.name for joint in robot.moving_joints]
    return dict(zip(names, np.abs(RobotModel(robot).mass_matrix(np.zeros(len(names)))).sum(axis=1).tolist(), strict=True))


def _lightest(robot: Robot) -> dict[str, float]:
    """Smallest inertia that the spring of each joint moves if all other joints are free, kg m^2, by joint."""
    names = [joint.name for joint in robot.moving_joints]
    postures = np.random.default_rng(0).uniform(-np.pi, np.pi, (MOBILE_POSTURES, len(names)))
    masses = RobotModel(robot).mass_matrix(np.vstack([np.zeros(len(names)), postures]))
    mobility = np.diagonal(np.linalg.pinv(masses, hermitian=True), axis1=1, axis2=2).max(axis=0)
    return dict(zip(names, (1.0 / np.maximum(mobility, 1e-30)).tolist(), strict=True))


def _springs(scenario: Scenario, block: ActuatorBlock) -> tuple[float, float, float]:
    """Stiffness of the unloaded springs at the last references, N m/rad; largest torque on a motor there, N m; change of the
    references during the run, rad."""
    drive = drive_of(block)
    motors, goal = goals_of(scenario, block, np.array([0.0, scenario.duration]))
    stiffness = over_arrays(drive.actuator.stiffness)(goal, *motors, drive.elastic)
    torques = over_arrays(drive.actuator.elastic_torques)(goal, *motors, drive.elastic)
    return float(stiffness[-1]), float(np.abs(torques[:, -1]).max()), float(np.ptp(goal))


def linear_parameters(actuator: type[Actuator], values: Mapping[str, float]) -> tuple[str, ...]:
    """Names of the spring parameters with N in their units, if the torque is proportional to them; else empty."""
    names = tuple(parameter.name for parameter in actuator.parameters if "N" in parameter.unit.split("/")[0])
    point = np.array([0.0, *actuator.motor_references(0.1, actuator.typical_preset)])[:, None]
    once, twice = (
        over_arrays(actuator.elastic_torques)(
            *point, tuple(values[p.name] * (factor if p.name in names else 1.0) for p in actuator.parameters)
        )
        for factor in (1.0, 2.0)
    )
    linear = once.any() and np.allclose(0.5 * twice, once, rtol=1e-9, atol=0.5e-12)
    return names if linear else ()


def motor_limits(values: Mapping[str, float]) -> tuple[str, ...]:
    """Names of the motors' limits of torque, voltage and current, to which the largest torques are proportional."""
    limits = ("_max_torque", "_max_voltage", "_max_current")
    return tuple(name for name, value in values.items() if name.endswith(limits) and math.isfinite(value))


def _rounded(value: float) -> float:
    """The value rounded to two significant digits."""
    return float(f"{value:.2g}")
