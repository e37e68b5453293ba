"""Where each joint comes to rest under the arm's own weight, given its springs and motors.

The motors stand at their references, less the steady-state error of their controllers under load. They give at most their
largest torque at rest, and each joint at most its effort limit. The friction of the motors is neglected.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from asrsim.actuators import ACTUATORS, MODES
from asrsim.actuators.vectorised import equilibrium_over_arrays, over_arrays, references_over_arrays
from asrsim.robot import ActuatorBlock, Robot, merge_fixed
from asrsim.robot.chain import Chain
from asrsim.robot.mounting import drive_of
from asrsim.samples import Array
from asrsim.scenario.data import for_joint

if TYPE_CHECKING:
    from asrsim.actuators.drive import Drive
    from asrsim.scenario.data import Scenario

FALL = 1.0
"""Sag above which a joint is reported as falling, as a share of the joint's scale."""
SLIDING = 0.2
"""m of a prismatic joint that count as much as 1 rad of a revolute joint: a link of this length moves its tip so far."""
OFF = 0.1
"""A joint at a stop farther from its reference than this share of the joint's scale has fallen onto the stop."""
STEPS = 400
"""Largest number of relaxation steps until rest."""
LARGEST_STEP = 0.05
"""rad, largest relaxation step."""


@dataclass(frozen=True, kw_only=True)
class Holding:
    """How far one joint sags under the arm's weight at the scenario's references, and why."""

    joint: str
    sag: float
    """rad or m, the largest distance between the position that the reference asks for and the position of rest."""
    load: float
    """N m or N, load of gravity on the joint at the position that the reference asks for, at the instant `time`."""
    on_stop: bool
    """The joint comes to rest at a stop where the reference does not put it."""
    limited: bool
    """A motor would need more than its largest torque."""
    overloaded: bool
    """The joint's effort limit clips the torque of its springs."""
    time: float
    """s, the instant of the largest sag."""
    scale: float
    """rad or m, unit in which the sag of this joint is judged: 1 rad, `SLIDING`, or the joint's travel if that is shorter."""
    droop: float
    """rad or m of the sag that comes from the steady-state error of the motors' controllers."""

    @property
    def falls(self) -> bool:
        """The joint falls: it does not merely sag."""
        return self.on_stop or self.sag > FALL * self.scale


def _instants(scenario: Scenario, blocks: list[ActuatorBlock]) -> Array:
    """(n,) s: the start, the end, and instants at which references are at an extreme."""
    grid = np.linspace(0.0, scenario.duration, 101)
    chosen = {0.0, float(scenario.duration)}
    for block in blocks:
        for signal in scenario.references_of(block.joint).values():
            values = signal.values(grid)
            chosen |= {float(grid[int(np.argmin(values))]), float(grid[int(np.argmax(values))])}
    ordered = sorted(chosen)
    return np.array(ordered if len(ordered) <= 8 else ordered[:: -(-len(ordered) // 8)])


def goals_of(scenario: Scenario, block: ActuatorBlock, time: Array) -> tuple[tuple[Array, ...], Array]:
    """Positions that the references ask for at `time`, (n,) each: of the motors (and an adjuster), and of the link."""
    actuator, mode = ACTUATORS.get(block.actuator), MODES[block.mode]
    given = scenario.references_of(block.joint)
    rest = np.full(len(time), float(for_joint(scenario.initial_positions, block.joint, 0.0)))
    goals = []
    for slot, name in enumerate(mode.references_of(actuator.motors)):
        idle = np.zeros(len(time)) if slot and (mode.mapped or actuator.adjuster) else rest
        goals.append(np.asarray(given[name].values(time), dtype=float) if name in given else idle)
    if mode.mapped:
        return references_over_arrays(actuator)(goals[0], goals[1]), goals[0]
    return tuple(goals), goals[0] if actuator.motors < 2 else equilibrium_over_arrays(actuator)(*goals)


def holdings(scenario: Scenario, robot: Robot, blocks: list[ActuatorBlock]) -> tuple[Holding, ...]:
    """Each joint at the instant of its largest sag, found by overdamped motion from the position of its references."""
    chain = Chain(robot=merge_fixed(robot).robot, base_position=scenario.base_position, base_rpy=scenario.base_rpy)
    time = _instants(scenario, blocks)
    wanted = {
        joint.name: np.full(len(time), float(for_joint(scenario.initial_positions, joint.name, 0.0)))
        for joint in robot.moving_joints
    }
    goals: dict[str, tuple[Array, ...]] = {}
    for block in blocks:
        goals[block.joint], goal = goals_of(scenario, block, time)
        wanted[block.joint] = np.clip(goal, *robot.joint(block.joint).stops)
    groups = [
        _Springs([block for block in blocks if block.actuator == actuator], goals)
        for actuator in dict.fromkeys(block.actuator for block in blocks)
    ]
    start = chain.gravity_load(wanted, scenario.gravity)
    positions = {name: values.copy() for name, values in wanted.items()}
    for springs in groups:
        springs.weight = np.array([[_weight(robot, name, scenario)] for name in springs.names])
        springs.low, springs.high = np.array([robot.joint(name).stops for name in springs.names]).T[:, :, None]
        springs.efforts = np.array([[robot.joint(name).most_effort] for name in springs.names])
    share, before = np.ones(len(time)), np.zeros((len(goals), len(time)))
    for _ in range(STEPS):
        loads = chain.gravity_load(positions, scenario.gravity)
        moved = np.concatenate([springs.settle(positions, loads, share) for springs in groups])
        if np.max(np.abs(moved) / share) < 1e-5:
            break
        # Joints that move together may oscillate together: a step that reverses was too long and is shortened.
        share = np.where(np.sum(moved * before, axis=0) < 0.0, 0.5 * share, np.minimum(1.1 * share, 1.0))
        before = moved
    limited = {name: rows for springs in groups for name, rows in springs.limited(positions).items()}
    droops = {name: row for springs in groups for name, row in zip(springs.names, springs.droops.mean(axis=0), strict=True)}
    found = []
    for name in goals:
        off = np.abs(positions[name] - wanted[name])
        worst = int(np.argmax(off))
        low, high = robot.joint(name).stops
        scale = min(SLIDING if robot.joint(name).kind == "prismatic" else 1.0, high - low)
        stopped = min(abs(positions[name][worst] - low), abs(positions[name][worst] - high)) < 1e-6
        stopped = stopped and off[worst] > OFF * scale
        found.append(
            Holding(
                joint=name, sag=float(off[worst]), load=float(start[name][worst]), on_stop=bool(stopped),
                limited=bool(limited[name][0][worst]), overloaded=bool(limited[name][1][worst]), time=float(time[worst]),
                scale=scale, droop=float(abs(droops[name][worst])),
            )
        )  # fmt: skip
    return tuple(found)


class _Springs:
    """The springs of all joints (j) that have the same actuator, with their motors near their references at (n,) instants."""

    def __init__(self, blocks: list[ActuatorBlock], goals: Mapping[str, tuple[Array, ...]]) -> None:
        actuator = ACTUATORS.get(blocks[0].actuator)
        values = [block.values() for block in blocks]
        self.names = [block.joint for block in blocks]
        self._parameters = tuple(np.array([[given[p.name]] for given in values]) for p in actuator.parameters)
        self._law = over_arrays(actuator.elastic_torques)
        self._goals = tuple(np.stack([goals[name][slot] for name in self.names]) for slot in range(actuator.positions()))
        drives = [drive_of(block) for block in blocks]
        ideal = (math.inf,) * actuator.motors
        self._limits = np.array([drive.max_torque or ideal for drive in drives]).T[:, :, None]
        """(motors, j, 1) N m, largest torques of the motors."""
        self._gains = np.array([_gains(drive) or ideal for drive in drives]).T[:, :, None]
        """(motors, j, 1) N m/rad, stiffness of the controllers."""
        self._most = np.divide(self._limits, self._gains, out=np.zeros_like(self._gains), where=np.isfinite(self._gains))
        """(motors, j, 1) rad, steady-state error at which a motor gives its largest torque."""
        self.droops = np.zeros((actuator.motors, *self._goals[0].shape))
        """(motors, j, n) rad, steady-state errors of the motors."""
        self.weight = self.low = self.high = self.efforts = np.zeros((len(blocks), 1))
        """Bound on the change of gravity's torques with posture, N m/rad; stops, rad or m; effort limits, N m or N."""

    def _torques(self, position: Array) -> Array:
        """(motors, j, n) N m."""
        places = [goal - droop for goal, droop in zip(self._goals, self.droops, strict=False)]
        return self._law(position, *places, *self._goals[len(places) :], self._parameters)

    def _slopes(self, position: Array, most: float | Array = math.inf) -> tuple[Array, Array]:
        """Torques, clipped at `most`, and stiffnesses at fixed motors, (motors, j, n)."""
        here, near = (np.clip(self._torques(position + off)[: len(self._limits)], -most, most) for off in (0.0, 1e-4))
        return here, np.maximum((here - near) / 1e-4, 0.0)

    def settle(self, positions: dict[str, Array], loads: Mapping[str, Array], share: Array) -> Array:
        """Move the joints towards equilibrium with their loads by shares (n,) of a full step. Returns their displacements
        (j, n) in rad or m. A motor gives at most its largest torque."""
        position = np.stack([positions[name] for name in self.names])
        torques, slopes = self._slopes(position)
        # First the motors, with a fixed link; then the link, on spring and controller in series. A motor's steady-state error
        # is proportional to the spring's torque: clipping one clips the other.
        droops = self.droops + (torques / self._gains - self.droops) / (1.0 + slopes / self._gains)
        self.droops = np.clip(droops, -self._most, self._most)
        torques, slopes = self._slopes(position, self._limits)
        torque, stiffness = torques.sum(axis=0), (slopes / (1.0 + slopes / self._gains)).sum(axis=0)
        stiffness = np.where(np.abs(torque) > self.efforts, 0.0, stiffness)
        torque = np.clip(torque, -self.efforts, self.efforts)
        load = np.stack([loads[name] for name in self.names])
        step = np.clip((torque + load) / (stiffness + self.weight), -LARGEST_STEP, LARGEST_STEP)
        after = np.clip(position + share * step, self.low, self.high)
        positions.update(zip(self.names, after, strict=True))
        return np.asarray(after - position)

    def limited(self, positions: Mapping[str, Array]) -> dict[str, tuple[Array, Array]]:
        """Joint -> (n,) whether a motor is at its largest torque, and whether the joint is at its effort limit."""
        torques = self._torques(np.stack([positions[name] for name in self.names]))[: len(self._limits)]
        weak = np.any(np.abs(torques) > self._limits, axis=0)
        overloaded = np.abs(np.clip(torques, -self._limits, self._limits).sum(axis=0)) > self.efforts
        return {name: (weak[j], overloaded[j]) for j, name in enumerate(self.names)}


def _gains(drive: Drive) -> tuple[float, ...]:
    """N m/rad, stiffness of each motor's controller; inf with integral action (no steady-state error); () for ideal motors."""
    if not drive.mode.motor:
        return ()
    gains = zip(drive.proportional, drive.integral, strict=True)
    return tuple(math.inf if integral > 0.0 else max(gain, 1e-6) for gain, integral in gains)


def _weight(robot: Robot, name: str, scenario: Scenario) -> float:
    """N m/rad: bound on the change of gravity's torque about a joint with posture, from the masses that it carries."""
    masses = {link.name: (link.mass or 0.0, float(np.linalg.norm(link.centre_of_mass))) for link in robot.links}
    waiting, total = [(robot.joint(name).child, 0.0)], 0.0
    while waiting:
        link, reach = waiting.pop()
        mass, centre = masses[link]
        total += mass * (reach + centre)
        waiting += [(joint.child, reach + float(np.linalg.norm(joint.origin))) for joint in robot.carried.get(link, ())]
    return max(total * float(np.linalg.norm(scenario.gravity)), 1e-6)
