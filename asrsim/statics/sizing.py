"""Checks that springs and motors hold the arm's own weight, and proposed parameters with which the arm holds and comes to rest.

The arm rests where springs, motors and gravity balance. The motors stand at their references minus the steady-state error of
their controllers under load. Motor torques are limited to the largest torque at rest, and joint torques to the effort limit.
The friction of the motors is neglected. Responses to steps and oscillations are estimated joint by joint, with the mass matrix
of the zero pose.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from asrsim.actuators import ACTUATORS, MODES, Actuator
from asrsim.actuators.rest import MotorsAtRest, alike, resting_motors
from asrsim.actuators.vectorised import over_arrays
from asrsim.errors import Problem
from asrsim.robot import ActuatorBlock, Joint, Robot
from asrsim.robot.dynamics import RobotModel, robot_model
from asrsim.robot.mounting import drive_of
from asrsim.robot.values import with_overrides
from asrsim.samples import Array
from asrsim.scenario.data import for_joint
from asrsim.scenario.doubts import made_elsewhere
from asrsim.scenario.starts import start_positions
from asrsim.statics.balance import Loads, balanced, by_differences

if TYPE_CHECKING:
    from asrsim.actuators.drive import Drive
    from asrsim.scenario.data import Scenario

FALL = 1.0
"""Sag above which a joint counts as falling, as a fraction of the joint's scale."""
SLIDING = 0.2
"""Displacement of a prismatic joint that counts as much as 1 rad of a revolute joint, m: the tip of a link of this length moves
as far."""
OFF = 0.1
"""Distance from the reference, as a fraction of the joint's scale, above which a joint at a stop has fallen onto the stop."""
INSTANTS = 8
"""Largest number of instants of a run that are checked."""
POSTURES = 64
"""Number of random postures in which the largest torque of gravity on each joint is sought."""
MOBILE_POSTURES = 16
"""Number of random postures in which the smallest inertia of each joint is sought."""
CLOSE = 1e-3
"""Distance from the position of rest at which its search ends, rad (m); sags are printed with two digits."""
SHOVE = 0.1
"""Displacement by which the search leaves an unstable equilibrium, rad (m): far, since the arm falls a long way."""
SAG = 0.3
"""Sag above which a joint gets a warning, rad; every soft arm sags a little. For a prismatic joint, or a travel below 1 rad:
fraction of the joint's scale (see `Holding.scale`)."""
ENOUGH = 0.15
"""Largest sag in any posture with proposed parameters, rad or fraction of the scale. This value is below `SAG` as a margin for
neglected effects."""
MOTOR_SHARE = 0.5
"""Largest fraction of a motor's torque that holds and moves an arm with proposed parameters."""
SLOWEST = 5.0
"""Lowest natural frequency of a joint with proposed parameters, rad/s. A slower joint does not reach its reference in a run of
a few seconds, even with good damping."""
CARRYING = 3.0
"""Largest natural frequency of a joint that carries weight, as a multiple of the highest frequency of other joints."""
SHORT = 0.01
"""Travel below which a joint counts as one that cannot move, as a fraction of the scale of its kind."""
LONGEST_DECAY = 8.0
"""Settling time (to 5 %) with the damping of the robot file above which a warning is given, s."""
RATIO = 0.3
"""Proposed damping ratio of a joint. In an overdamped arm, the effect of the springs would not be visible."""


@dataclass(frozen=True, kw_only=True)
class Holding:
    """Sag of a joint under the arm's weight at the scenario's references, and its causes."""

    joint: str
    sag: float
    """Largest distance between the commanded position and the position of rest, rad or m."""
    load: float
    """Gravity load on the joint at the commanded position and the instant `time`, N m or N."""
    on_stop: bool
    """Whether the joint rests at a stop although its reference is elsewhere."""
    limited: bool
    """Whether a motor gives its largest torque."""
    overloaded: bool
    """Whether the joint's effort limit clips the torque of its springs."""
    time: float
    """Instant of the largest sag, s."""
    scale: float
    """Scale for the sag of this joint, rad or m: 1 rad, `SLIDING`, or the joint's travel if that is shorter."""
    droop: float
    """Part of the sag that the steady-state error of the motor controllers causes, rad or m."""

    @property
    def falls(self) -> bool:
        """Whether the joint falls instead of sagging a little."""
        return self.on_stop or self.sag > FALL * self.scale


def goals_of(scenario: Scenario, block: ActuatorBlock, time: Array) -> tuple[Array, Array]:
    """Commanded positions at `time`: motors and adjuster (positions, n), and link (n,)."""
    actuator, mode = ACTUATORS.get(block.actuator), MODES[block.mode]
    given = scenario.references_of(block.joint)
    rest = np.full(len(time), float(for_joint(scenario.initial_positions, block.joint, 0.0)))
    goals = []
    for slot, name in enumerate(mode.references_of(actuator.motors)):
        idle = np.zeros(len(time)) if slot and (mode.mapped or actuator.adjuster) else rest
        goals.append(np.asarray(given[name].values(time), dtype=float) if name in given else idle)
    if mode.mapped:
        return over_arrays(actuator.motor_references)(goals[0], goals[1]), goals[0]
    return np.stack(goals), goals[0] if actuator.motors < 2 else over_arrays(actuator.equilibrium_position)(*goals)


class _Statics:
    """Springs and weight of an arm at the instants of a scenario that are checked."""

    def __init__(self, scenario: Scenario, robot: Robot, model: RobotModel, blocks: list[ActuatorBlock]) -> None:
        self.model, self.time = model, _instants(scenario, blocks)
        wanted = np.tile([*start_positions(scenario, robot).values()], (len(self.time), 1))
        self.drives: dict[int, tuple[Joint, Drive, Array]] = {}
        """Joint, drive, and positions of its motors at the instants (positions, instants), by column of the joint."""
        for block in blocks:
            column, joint = model.joints.index(block.joint), robot.joint(block.joint)
            goals, goal = goals_of(scenario, block, self.time)
            self.drives[column] = joint, drive_of(block), goals
            wanted[:, column] = np.clip(goal, *joint.stops)
        self.couplings = model.couplings
        self.wanted = self.couplings.expand(wanted)
        """Commanded positions (instants, joints), rad or m."""
        rows = [*self.drives.values()]
        self._efforts = np.array([joint.most_effort for joint, *_ in rows])
        self._motors = [
            (group, MotorsAtRest([rows[i][1] for i in group], np.stack([rows[i][2] for i in group], axis=1)))
            for group in alike([drive for _, drive, _ in rows])
        ]
        """Motors, and the numbers of their springs, for each kind of drive."""

    def weights(self, movable: NDArray[np.bool_]) -> Loads:
        """Torques of gravity on the links in N m. movable: joints that may move."""
        if self.couplings:
            return by_differences(lambda q: -self.model.gravity_torques(q), movable)

        def weighing(q: Array) -> tuple[Array, Array]:
            torques, stiffness = self.model.gravity_stiffness(q)
            return -torques, -stiffness

        return weighing

    def springs(self, positions: Array) -> tuple[Array, Array]:
        """Torques (instants, joints) in N m of the springs on the links, and their changes per displacement of their joints, in
        the steps of one search by Newton's method; see `MotorsAtRest.follow`."""
        q, columns = self.couplings.expand(positions), [*self.drives]
        links = q[:, columns].T
        torques, changes = np.empty_like(links), np.empty_like(links)
        for group, motors in self._motors:
            torques[group], changes[group] = motors.follow(links[group])
        found = np.zeros((2, *q.shape))
        found[0][:, columns] = np.clip(torques.T, -self._efforts, self._efforts)
        found[1][:, columns] = np.where(np.abs(torques.T) < self._efforts, changes.T, 0.0)
        return self.couplings.fold(found[0], q), self.couplings.fold_gains(found[1], q)


@np.errstate(all="ignore")
def holdings(statics: _Statics) -> tuple[Holding, ...]:
    """Largest sag of each joint over time, from the position of its references to the position of rest."""
    model, wanted, couplings, columns = statics.model, statics.wanted, statics.couplings, [*statics.drives]
    movable = np.isin(np.arange(len(model.joints)), couplings.master[columns])
    positions, _ = balanced(
        statics.weights(movable), statics.springs, wanted, model.lower, model.upper, movable, close=CLOSE, shove=SHOVE
    )
    positions = couplings.expand(positions)
    sags, loads = np.abs(positions - wanted)[:, columns], -model.gravity_torques(wanted)[:, columns]
    worst, rows = sags.argmax(axis=0), np.arange(len(columns))
    links = positions[:, columns][worst, rows]
    joints, drives, references = zip(*statics.drives.values(), strict=True)
    found: dict[int, Holding] = {}
    for group in alike(drives):
        goals = np.stack([references[row][:, worst[row]] for row in group], axis=1)[..., None]
        resting, own = resting_motors([drives[row] for row in group], links[group, None], goals)
        motors = drives[group[0]].actuator.motors
        pulls, droops = own[..., 0].T, np.abs((goals - resting)[:motors, :, 0].mean(axis=0)).tolist()
        for row, pull, droop in zip(group, pulls, droops, strict=True):
            joint, sag, scale = joints[row], float(sags[worst[row], row]), _scale(joints[row])
            stopped = np.abs(links[row] - joint.stops).min() < 1e-6
            most = np.array(drives[row].max_torque or np.inf)
            found[row] = Holding(
                joint=joint.name,
                sag=sag,
                load=float(loads[worst[row], row]),
                time=float(statics.time[worst[row]]),
                scale=scale,
                on_stop=bool(stopped and sag > OFF * scale),
                limited=bool(np.any(np.abs(pull[:motors]) > (1.0 - 1e-6) * most)),
                overloaded=bool(abs(pull.sum()) > joint.most_effort),
                droop=droop,
            )
    return tuple(found[row] for row in range(len(columns)))


def _weights(model: RobotModel) -> dict[str, float]:
    """Largest gravity load on each joint in random postures, N m or N."""
    postures = np.random.default_rng(0).uniform(-np.pi, np.pi, (len(model.joints), POSTURES)).T
    return dict(zip(model.joints, np.abs(model.gravity_torques(postures)).max(axis=0).tolist(), strict=True))


def _instants(scenario: Scenario, blocks: list[ActuatorBlock]) -> Array:
    """Instants (n,) to check, s: the start, the end, and a choice of the extremes of the references."""
    grid = np.linspace(0.0, scenario.duration, 101)
    chosen = {0, len(grid) - 1}
    for block in blocks:
        for signal in scenario.references_of(block.joint).values():
            values = signal.values(grid)
            chosen |= {int(np.argmin(values)), int(np.argmax(values))}
    kept = np.linspace(0, len(chosen) - 1, min(len(chosen), INSTANTS)).round().astype(int)
    return np.asarray(grid[np.array(sorted(chosen))[kept]])


def _scale(joint: Joint) -> float:
    """Scale for the sag of a joint, rad or m. The travel counts unless it is so short that the joint cannot sag."""
    low, high = joint.stops
    usual = SLIDING if joint.kind == "prismatic" else 1.0
    return min(usual, high - low) if high - low > SHORT * usual else usual


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
        return _weak(self.joints)


def sizing(scenario: Scenario, robot: Robot) -> Sizing:
    """Sag of the joints at the references of a scenario, and parameters that would hold them.

    robot: the robot with the scenario's modes and parameters. The function ignores floating bases, modes without springs,
    torque, voltage and current references, and references that already account for the weight (of a task, of learning, or of
    a joint with a `desired` motion).
    """
    blocks, model = _sagging(scenario, robot), robot_model(scenario, robot)
    joints = holdings(_Statics(scenario, robot, model, blocks)) if blocks else ()
    return Sizing(joints=joints, proposal=_proposal(scenario, robot, model) if _weak(joints) else {})


def _proposal(scenario: Scenario, robot: Robot, model: RobotModel) -> dict[str, dict[str, float]]:
    """Values of parameters, by joint and parameter, with which no joint sags too much; empty if there are none."""

    def weak(robot: Robot) -> tuple[Holding, ...]:
        return _weak(holdings(_Statics(scenario, robot, model, _sagging(scenario, robot))))

    # No parameter changes an effort limit: a joint with too low a limit gets its own warning.
    endless = replace(robot, joints=tuple(replace(joint, effort=None) for joint in robot.joints))
    left, proposal = weak(endless), dict[str, dict[str, float]]()
    stronger = strengthened(scenario, robot) if left else {}
    # Stronger joints load others, which may then sag.
    while any(one.joint in stronger for one in left):
        proposal |= {one.joint: stronger.pop(one.joint) for one in left if one.joint in stronger}
        left = weak(with_overrides(endless, parameters=proposal))
    return {} if left else proposal


def _sagging(scenario: Scenario, robot: Robot) -> list[ActuatorBlock]:
    """Actuators whose springs must hold the arm at their references; see `sizing`."""
    if not scenario.fixed_base or not any(scenario.gravity):
        return []
    return [
        block
        for block in _sprung(robot)
        if not made_elsewhere(scenario, block.joint) and for_joint(scenario.desired, block.joint) is None
    ]


def weight_warnings(scenario: Scenario, robot: Robot, model: RobotModel, *, propose: bool = False) -> tuple[Problem, ...]:
    """Warnings about joints that sag or fall in a valid scenario; see `sizing`. A robot with closed chains is not checked.

    model: model of the robot. propose: propose parameters for the weak joints, which takes some time.
    """
    blocks = _sagging(scenario, robot)
    if not blocks or robot.loops:
        return ()
    statics = _Statics(scenario, robot, model, blocks)
    found = Sizing(joints=holdings(statics))
    if propose and found.weak:
        found = replace(found, proposal=_proposal(scenario, robot, model))
    return problems_of_weight(found, robot, scenario.path)


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
            # One warning gives the parameters of all joints.
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
    for block in _sprung(robot):
        drive, weight = drive_of(block), weights[block.joint]
        present, pretension, step = _springs(scenario, block)
        moving = SLOWEST**2 * inertia[block.joint]
        # Springs take two thirds of the largest sag. Controllers, which are twice as stiff, take the rest.
        stiffness = max(1.5 * weight / (ENOUGH * _scale(robot.joint(block.joint))), moving)
        resolved = fastest**2 * lightest[block.joint] / max(present, 1e-9)
        # The weight may need a faster joint, but none that a run cannot resolve.
        spring = min(max(stiffness / max(present, 1e-9), min(resolved, 1.0)), CARRYING**2 * resolved)
        gain = 2.0 * stiffness / max(sum(drive.proportional), 1e-9) if drive.mode.controller else 1.0
        # The last term accelerates the link for a step of its reference at the lowest frequency.
        torque = (spring * pretension + weight + moving * step) / MOTOR_SHARE
        values = block.values()
        factors = dict.fromkeys(linear_parameters(drive.actuator, values), spring)
        factors |= {name: gain for name in values if name.endswith("_proportional")}
        factors |= dict.fromkeys(motor_limits(values), torque / min(drive.max_torque, default=math.inf))
        # Factors just above 1 are left out: they come from the rounding of an earlier proposal.
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
    for block in _sprung(robot):
        own, joint = inertia[block.joint], robot.joint(block.joint)
        if joint.lower is not None and joint.lower == joint.upper:
            continue
        damping = damped[block.joint]
        critical = 2.0 * math.sqrt(own * max(_springs(scenario, block)[0], 0.0))
        if damping < RATIO * critical:
            lasts = max(lasts, 6.0 * own / damping if damping else math.inf)
            keys[block.joint] = {"ratio": RATIO, "inertia": _rounded(own)}
    return (lasts, keys) if lasts > LONGEST_DECAY else (0.0, {})


def _sprung(robot: Robot) -> list[ActuatorBlock]:
    """Actuators with a spring and a position as reference."""
    return [block for block in robot.actuators if MODES[block.mode].spring and not MODES[block.mode].direct]


def _weak(joints: tuple[Holding, ...]) -> tuple[Holding, ...]:
    """Joints that sag too much, or come to rest on a stop."""
    return tuple(one for one in joints if one.on_stop or one.sag > SAG * one.scale)


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
