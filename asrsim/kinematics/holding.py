"""Positions at which the joints come to rest under the arm's own weight, given their springs and motors.

The motors stand at their references minus the steady-state error of their controllers under load. Motor torques are limited
to the largest torque at rest, and joint torques to the effort limit. The friction of the motors is neglected.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from asrsim.actuators import ACTUATORS, MODES
from asrsim.actuators.rest import resting_motors
from asrsim.actuators.vectorised import over_arrays
from asrsim.robot import ActuatorBlock, Robot, merge_fixed
from asrsim.robot.chain import Chain
from asrsim.robot.mounting import drive_of
from asrsim.samples import Array
from asrsim.scenario.data import for_joint

if TYPE_CHECKING:
    from asrsim.actuators.drive import Drive
    from asrsim.scenario.data import Scenario

FALL = 1.0
"""Sag above which a joint is reported as falling, as a fraction of the joint's scale."""
SLIDING = 0.2
"""Displacement of a prismatic joint that counts as much as 1 rad of a revolute joint, m: the tip of a link of this length moves
as far."""
OFF = 0.1
"""Distance from the reference, as a fraction of the joint's scale, above which a joint at a stop has fallen onto the stop."""
STEPS = 400
"""Largest number of relaxation steps until rest."""
LARGEST_STEP = 0.05
"""Largest relaxation step, rad."""
TABLE = 401
"""Number of link positions at which the torque of a drive is tabulated."""
FARTHEST = 4.0
"""Largest tabulated distance from the reference, rad or m."""
POSTURES = 64
"""Number of random postures from which the variation of gravity's torque is estimated."""


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


def holdings(scenario: Scenario, robot: Robot, blocks: list[ActuatorBlock]) -> tuple[Holding, ...]:
    """Largest sag of each joint over time, found by overdamped relaxation from the position of its references."""
    chain = Chain(robot=merge_fixed(robot).robot, base_position=scenario.base_position, base_rpy=scenario.base_rpy)
    time = _instants(scenario, blocks)
    wanted = {
        joint.name: np.full(len(time), float(for_joint(scenario.initial_positions, joint.name, 0.0)))
        for joint in robot.moving_joints
    }
    goals: dict[str, Array] = {}
    for block in blocks:
        goals[block.joint], goal = goals_of(scenario, block, time)
        wanted[block.joint] = np.clip(goal, *robot.joint(block.joint).stops)
    generator = np.random.default_rng(0)
    postures = {name: generator.uniform(-np.pi, np.pi, POSTURES) for name in wanted}
    weights = chain.gravity_load(postures, scenario.gravity)
    joints = {
        block.joint: _Joint(drive_of(block), goals[block.joint], wanted[block.joint], robot, weights[block.joint])
        for block in blocks
    }
    start = chain.gravity_load(wanted, scenario.gravity)
    positions = dict(wanted)
    share, before = np.ones(len(time)), np.zeros((len(joints), len(time)))
    for _ in range(STEPS):
        loads = chain.gravity_load(positions, scenario.gravity)
        after = {name: joint.settle(positions[name], loads[name], share) for name, joint in joints.items()}
        moved = np.stack([after[name] - positions[name] for name in joints])
        positions |= after
        if np.max(np.abs(moved) / share) < 1e-5:
            break
        # The relaxation of coupled joints may oscillate: after a step that reverses the motion, the next is shorter.
        share = np.where(np.sum(moved * before, axis=0) < 0.0, 0.5 * share, np.minimum(1.1 * share, 1.0))
        before = moved
    return tuple(joint.holding(time, wanted[name], positions[name], start[name]) for name, joint in joints.items())


def _instants(scenario: Scenario, blocks: list[ActuatorBlock]) -> Array:
    """Instants (n,) to check, s: the start, the end, and extremes of the references."""
    grid = np.linspace(0.0, scenario.duration, 101)
    chosen = {0.0, float(scenario.duration)}
    for block in blocks:
        for signal in scenario.references_of(block.joint).values():
            values = signal.values(grid)
            chosen |= {float(grid[int(np.argmin(values))]), float(grid[int(np.argmax(values))])}
    ordered = sorted(chosen)
    return np.array(ordered if len(ordered) <= 8 else ordered[:: -(-len(ordered) // 8)])


class _Joint:
    """A joint with its drive at rest: the torque on the link, tabulated over positions of the link for each of n instants."""

    def __init__(self, drive: Drive, goals: Array, wanted: Array, robot: Robot, weights: Array) -> None:
        """weights: gravity torques in random postures, N m; the largest bounds the variation of the torque with the posture."""
        self._drive, self._goals, self._joint = drive, goals, robot.joint(drive.joint)
        self._weight = max(float(np.abs(weights).max()), 1e-6)
        low, high = self._joint.stops
        self._places = np.linspace(np.maximum(low, wanted - FARTHEST), np.minimum(high, wanted + FARTHEST), TABLE)
        spread = np.repeat(self._goals[:, None], TABLE, axis=1).reshape(len(self._goals), -1)
        _, torques = self._at_rest(self._places.ravel(), spread)
        effort = self._joint.most_effort
        self._torques = np.clip(torques.sum(axis=0), -effort, effort).reshape(self._places.shape)
        self._slopes = np.maximum(-np.gradient(self._torques, axis=0) / np.gradient(self._places, axis=0), 0.0)

    def _at_rest(self, position: Array, goals: Array) -> tuple[Array, Array]:
        """Positions of the motors at rest, and torques of the springs in N m."""
        resting = resting_motors(self._drive, position, goals)
        return resting, over_arrays(self._drive.actuator.elastic_torques)(position, *resting, self._drive.elastic)

    def settle(self, position: Array, load: Array, share: Array) -> Array:
        """Position (n,) after a relaxation step towards equilibrium with the load. share: fraction of a full step."""
        table = zip(position, self._places.T, self._torques.T, self._slopes.T, strict=True)
        rows = [(np.interp(q, places, torques), np.interp(q, places, slopes)) for q, places, torques, slopes in table]
        torque, stiffness = np.array(rows).T
        step = np.clip((torque + load) / (stiffness + self._weight), -LARGEST_STEP, LARGEST_STEP)
        return np.asarray(np.clip(position + share * step, self._places[0], self._places[-1]))

    def holding(self, time: Array, wanted: Array, position: Array, load: Array) -> Holding:
        """Sag of the joint at the instant of the largest sag."""
        off = np.abs(position - wanted)
        worst = int(np.argmax(off))
        low, high = self._joint.stops
        scale = min(SLIDING if self._joint.kind == "prismatic" else 1.0, high - low)
        stopped = min(abs(position[worst] - low), abs(position[worst] - high)) < 1e-6
        resting, torques = (rows[:, worst] for rows in self._at_rest(position, self._goals))
        most = np.array(self._drive.max_torque or np.inf)
        motors = self._drive.actuator.motors
        return Holding(
            joint=self._joint.name, sag=float(off[worst]), load=float(load[worst]), time=float(time[worst]), scale=scale,
            on_stop=bool(stopped and off[worst] > OFF * scale),
            limited=bool(np.any(np.abs(torques[:motors]) > (1.0 - 1e-6) * most)),
            overloaded=bool(abs(torques.sum()) > self._joint.most_effort),
            droop=float(abs(np.mean((self._goals[:, worst] - resting)[:motors]))),
        )  # fmt: skip
