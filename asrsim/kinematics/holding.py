"""Where each joint comes to rest under the arm's own weight, as its springs and motors hold it.

The rest is sought with motors where references put them and no stronger than their largest torque; what their controllers
droop by under load is left out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from asrsim.actuators import ACTUATORS, MODES
from asrsim.actuators.vectorised import over_arrays, references_over_arrays
from asrsim.robot import ActuatorBlock, Robot
from asrsim.robot.chain import Chain
from asrsim.samples import Array
from asrsim.scenario.data import for_joint

if TYPE_CHECKING:
    from asrsim.scenario.data import Scenario

FALL = 1.0
"""rad beyond which it is said to fall."""
STEPS = 400
LARGEST_STEP = 0.05
"""rad, of the search for the rest."""


@dataclass(frozen=True, kw_only=True)
class Holding:
    """How one joint holds the weight at the scenario's references."""

    joint: str
    sag: float
    """rad or m, the largest distance between where the reference asks it to be and where it comes to rest."""
    load: float
    """N m or N, by which gravity drives it where the reference asks it to be, at that instant."""
    on_stop: bool
    """It comes to rest on a joint stop that the reference does not ask for."""
    limited: bool
    """A motor gives way: it would need more than its largest torque."""
    time: float
    """s, of that instant."""

    @property
    def falls(self) -> bool:
        """It does not merely sag."""
        return self.on_stop or self.sag > FALL


def _instants(scenario: Scenario, blocks: list[ActuatorBlock]) -> Array:
    """A few instants (n,) s at which references are at an extreme, the start and the end among them."""
    grid = np.linspace(0.0, scenario.duration, 101)
    chosen = {0.0, float(scenario.duration)}
    for block in blocks:
        for signal in scenario.references_of(block.joint).values():
            values = signal.values(grid)
            chosen |= {float(grid[int(np.argmin(values))]), float(grid[int(np.argmax(values))])}
    ordered = sorted(chosen)
    return np.array(ordered if len(ordered) <= 8 else ordered[:: -(-len(ordered) // 8)])


def _goals(scenario: Scenario, block: ActuatorBlock, time: Array) -> tuple[Array, Array, Array]:
    """Where motors (or motor and adjuster) are asked to stand, (n,) each, and the link with them."""
    actuator, mode = ACTUATORS.get(block.actuator), MODES[block.mode]
    given = scenario.references_of(block.joint)
    rest = np.full(len(time), float(for_joint(scenario.initial_positions, block.joint, 0.0)))
    references = []
    for slot, name in enumerate(mode.references):
        idle = np.zeros(len(time)) if slot and (mode.mapped or actuator.adjuster) else rest
        references.append(np.asarray(given[name].values(time), dtype=float) if name in given else idle)
    first, second = references
    if mode.mapped:
        goal = first
        first, second = references_over_arrays(actuator)(first, second)
    elif actuator.motors < 2:
        goal = first
    else:
        goal = np.array([actuator.equilibrium_position(a, b) for a, b in zip(first, second, strict=True)])
    return first, second, goal


def holdings(scenario: Scenario, robot: Robot, blocks: list[ActuatorBlock]) -> tuple[Holding, ...]:
    """Each joint at the instant at which it is worst, by overdamped motion from where references ask it to be."""
    chain = Chain(robot=robot, base_position=scenario.base_position, base_rpy=scenario.base_rpy)
    time = _instants(scenario, blocks)
    wanted = {
        joint.name: np.full(len(time), float(for_joint(scenario.initial_positions, joint.name, 0.0)))
        for joint in robot.moving_joints
    }
    springs = {}
    for block in blocks:
        first, second, goal = _goals(scenario, block, time)
        wanted[block.joint] = np.clip(goal, *_stops(robot, block.joint))
        springs[block.joint] = _Spring(block, first, second)
    start = chain.gravity_load(wanted, scenario.gravity)
    weight = {name: _weight(robot, name, scenario) for name in wanted}
    positions = {name: values.copy() for name, values in wanted.items()}
    for _ in range(STEPS):
        loads = chain.gravity_load(positions, scenario.gravity)
        largest = 0.0
        for name, spring in springs.items():
            torque, stiffness = spring.at(positions[name])
            step = np.clip((torque + loads[name]) / (stiffness + weight[name]), -LARGEST_STEP, LARGEST_STEP)
            after = np.clip(positions[name] + step, *_stops(robot, name))
            largest = max(largest, float(np.max(np.abs(after - positions[name]))))
            positions[name] = after
        if largest < 1e-5:
            break
    found = []
    for name, spring in springs.items():
        off = np.abs(positions[name] - wanted[name])
        worst = int(np.argmax(off))
        low, high = _stops(robot, name)
        stopped = min(abs(positions[name][worst] - low), abs(positions[name][worst] - high)) < 1e-6 and off[worst] > 0.1
        found.append(
            Holding(
                joint=name, sag=float(off[worst]), load=float(start[name][worst]), on_stop=bool(stopped),
                limited=bool(spring.limited(positions[name])[worst]), time=float(time[worst]),
            )
        )  # fmt: skip
    return tuple(found)


class _Spring:
    """The springs of one joint with motors held where they are asked to stand, (n,) instants."""

    def __init__(self, block: ActuatorBlock, first: Array, second: Array) -> None:
        self._actuator = ACTUATORS.get(block.actuator)
        values = block.values()
        self._parameters = tuple(values[parameter.name] for parameter in self._actuator.parameters)
        self._law = over_arrays(self._actuator.elastic_torques)
        self._goals = first, second
        ideal = not MODES[block.mode].motor
        self._limits = [math.inf if ideal else values[f"motor_{i}_max_torque"] for i in range(1, self._actuator.motors + 1)]

    def _torques(self, position: Array) -> Array:
        return self._law(position, *self._goals, self._parameters)

    def at(self, position: Array) -> tuple[Array, Array]:
        """Torque on the link (n,) N m, and how it stiffens, N m/rad: a motor gives way at its largest torque."""
        torques = self._torques(position)
        near = self._torques(position + 1e-4)
        for motor, limit in enumerate(self._limits):
            torques[motor], near[motor] = np.clip(torques[motor], -limit, limit), np.clip(near[motor], -limit, limit)
        torque: Array = torques.sum(axis=0)
        return torque, np.maximum((torque - near.sum(axis=0)) / 1e-4, 0.0)

    def limited(self, position: Array) -> Array:
        """(n,) whether some motor gives way."""
        torques = self._torques(position)
        yields: Array = np.any([abs(torques[motor]) > limit for motor, limit in enumerate(self._limits)], axis=0)
        return yields


def _stops(robot: Robot, name: str) -> tuple[float, float]:
    joint = robot.joint(name)
    if joint.kind == "continuous" or joint.lower is None or joint.upper is None:
        return -math.inf, math.inf
    return joint.lower, joint.upper


def _weight(robot: Robot, name: str, scenario: Scenario) -> float:
    """N m/rad: how fast gravity's torque about a joint may change with posture, from masses and the reach behind it."""
    by_parent: dict[str, list[tuple[str, float]]] = {}
    for joint in robot.joints:
        by_parent.setdefault(joint.parent, []).append((joint.child, float(np.linalg.norm(joint.origin))))
    masses = {link.name: (link.mass or 0.0, float(np.linalg.norm(link.centre_of_mass))) for link in robot.links}
    waiting, total = [(robot.joint(name).child, 0.0)], 0.0
    while waiting:
        link, reach = waiting.pop()
        mass, centre = masses[link]
        total += mass * (reach + centre)
        waiting += [(child, reach + length) for child, length in by_parent.get(link, ())]
    return max(total * float(np.linalg.norm(scenario.gravity)), 1e-6)
