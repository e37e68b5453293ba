"""Whether springs and motors hold the arm's own weight, and what would hold it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from asrsim.actuators import ACTUATORS, MODES, Actuator
from asrsim.errors import Problem
from asrsim.kinematics.holding import Holding, holdings
from asrsim.robot import ActuatorBlock, Robot
from asrsim.robot.mounting import drive_of
from asrsim.scenario.check import made_elsewhere
from asrsim.scenario.data import for_joint

if TYPE_CHECKING:
    from asrsim.scenario.data import Scenario

SAG = 0.3
"""rad beyond which a joint is said to sag: a soft arm sags a little, that is what it is for. Of a sliding joint, or one whose
travel is less than 1 rad, the same share of its scale."""
ENOUGH = 0.15
"""Likewise, what proposed parameters leave: some of it is left to what is not foreseen here."""
RESERVE = 0.5
"""Share of its largest torque that a motor may need to hold an arm with proposed parameters: the rest is for moving it. (At 0.8
two of 35 random arms without damping were at their motors' limits for two thirds of a run, sliders 0.06 and 0.07 m off in the
mean; at 0.5 one still is for a third of it, 0.02 m off.)"""
TRIES = 40
"""Rounds in which parameters are proposed and tried, at most."""


@dataclass(frozen=True, kw_only=True)
class Sizing:
    """The joints that sag or fall, and what would hold them."""

    joints: tuple[Holding, ...]
    """All joints that are held by a spring."""
    proposal: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Joint -> parameter -> value with which all hold; empty where all hold, or where no such values were found."""

    @property
    def weak(self) -> tuple[Holding, ...]:
        """Those that sag or fall."""
        return self.beyond(SAG)

    def beyond(self, sag: float) -> tuple[Holding, ...]:
        """Those that sag by more (a share of their scale), or come to rest on a stop."""
        return tuple(one for one in self.joints if one.on_stop or one.sag > sag * one.scale)


def sizing(scenario: Scenario, robot: Robot, *, propose: bool = True, sag: float = SAG) -> Sizing:
    """How a scenario's robot, as :func:`apply_to_robot` made it, holds itself at its references.

    Nothing is said of floating bases, of modes without spring, of references that are torques, voltages or currents, that a
    task or learning makes, or beside which a `desired` motion of the link stands: they see to it themselves. sag: see `SAG`,
    beyond which something is proposed.
    """
    blocks = [
        block
        for block in robot.actuators
        if MODES[block.mode].spring
        and not MODES[block.mode].direct
        and not made_elsewhere(scenario, block.joint)
        and for_joint(scenario.desired, block.joint) is None
    ]
    if not scenario.fixed_base or not any(scenario.gravity) or not blocks:
        return Sizing(joints=())
    joints = holdings(scenario, robot, blocks)
    weak = Sizing(joints=joints).beyond(sag)
    if not weak or not propose:
        return Sizing(joints=joints)
    # No parameter changes an effort limit: a joint that it overloads gets a warning of its own.
    robot = replace(robot, joints=tuple(replace(joint, effort=None) for joint in robot.joints))
    changed = {block.joint: block for block in blocks}
    weak = Sizing(joints=holdings(scenario, robot, blocks)).beyond(sag)
    proposal: dict[str, dict[str, float]] = {}
    for _ in range(TRIES):
        for one in weak:
            given = _stronger(changed[one.joint], one)
            if not given:
                return Sizing(joints=joints)
            proposal[one.joint] = proposal.get(one.joint, {}) | given
            changed[one.joint] = _with_values(changed[one.joint], given)
        weak = Sizing(joints=holdings(scenario, robot, [_in_reserve(block) for block in changed.values()])).beyond(ENOUGH)
        if not weak:
            return Sizing(joints=joints, proposal=proposal)
    return Sizing(joints=joints)


def holding_findings(scenario: Scenario, robot: Robot, *, propose: bool) -> tuple[Problem, ...]:
    """Warnings of joints that sag or fall under the arm's own weight; propose: with parameters that hold it, which takes some
    ten times as long."""
    cure = "Choose stiffer actuators or a lighter arm" if propose else "`asrsim check` proposes parameters that hold the arm"
    return problems_of_weight(sizing(scenario, robot, propose=propose), robot, scenario.path, cure=cure)


def problems_of_weight(
    found: Sizing, robot: Robot, file: Path | None = None, *, cure: str = "Choose stiffer actuators or a lighter arm"
) -> tuple[Problem, ...]:
    """A warning for each joint that sags or falls; cure: what to do where nothing is proposed."""
    values = ", ".join(
        f"{joint}: {{{', '.join(f'{name}: {value:g}' for name, value in given.items())}}}"
        for joint, given in found.proposal.items()
    )
    hint: str | None = f"parameters: {{{values}}} holds the arm" if values else cure
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


def _stronger(block: ActuatorBlock, weak: Holding) -> dict[str, float]:
    """Values that hold more: motors where they give way, else springs; nothing where it is not known how."""
    actuator, values = ACTUATORS.get(block.actuator), block.values()
    most = 4.0 if weak.falls else 2.0
    # How far it would sag is not known of a joint on its stop.
    factor = most if weak.on_stop else min(max(1.25, math.sqrt(weak.sag / (ENOUGH * weak.scale))), most)
    drive = drive_of(block)
    lacking = abs(weak.load) / (RESERVE * min(drive.max_torque, default=math.inf))
    # A spring that was wound past its summit no longer shows that the motor gave way first.
    if weak.limited or lacking > 1.0:
        names, factor = motor_limits(values), max(1.25, lacking)
    elif weak.droop > 0.3 * weak.sag:
        names = tuple(f"controller_{i}_proportional" for i in range(1, actuator.motors + 1))
    else:
        names = linear_parameters(actuator, values)
    return {name: float(f"{factor * values[name]:.2g}") for name in names}


def linear_parameters(actuator: type[Actuator], values: Mapping[str, float]) -> tuple[str, ...]:
    """Parameters of a spring whose common factor is one of its torques: those in units with N; none if it is not so."""
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
    """Parameters whose common factor is one of the motors' largest torques: their limits of torque, voltage and current."""
    limits = ("_max_torque", "_max_voltage", "_max_current")
    return tuple(name for name, value in values.items() if name.endswith(limits) and math.isfinite(value))


def _in_reserve(block: ActuatorBlock) -> ActuatorBlock:
    """The block with motors that keep some of their torque for moving."""
    values = block.values()
    return _with_values(block, {name: RESERVE * values[name] for name in motor_limits(values)})


def _with_values(block: ActuatorBlock, given: Mapping[str, float]) -> ActuatorBlock:
    parameters = {name: replace(one, value=given.get(name, one.value)) for name, one in block.parameters.items()}
    return replace(block, parameters=parameters)
