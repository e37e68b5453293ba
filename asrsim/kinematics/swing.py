"""How far and how long an arm swings when its references jump, and parameters with which it comes to rest.

The arm is taken as linear and undamped, with the mass matrix of its zero pose. The joints are coupled: the shoulder shakes a
light wrist on a soft spring, even if the wrist holds its own weight well.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from asrsim.actuators import ACTUATORS, MODES
from asrsim.actuators.drive import Drive
from asrsim.kinematics.holding import goals_of, holdings
from asrsim.kinematics.sizing import linear_parameters, motor_limits
from asrsim.robot import ActuatorBlock, Robot, with_overrides
from asrsim.robot.inertia import zero_pose_matrix
from asrsim.robot.mounting import drive_of
from asrsim.samples import Array
from asrsim.scenario.data import Scenario

SHAKEN_FACTOR = 2.0
"""Largest deflection of a joint as a multiple of its own step; a larger one comes from its neighbours. (A joint alone
deflects by its step.)"""
MOTOR_SHARE = 0.8
"""Share of its largest torque that a motor may need as the arm swings."""
PROPOSED_SHARE = 0.6
"""Share of its largest torque that a motor needs with proposed parameters."""
STIFFER = 1.5
"""Factor on the spring, or on the proportional gain, of a joint that its neighbours shake."""
STIFF_CONTROLLER = 2.0
"""A controller counts as stiff if it is this many times as stiff as its spring."""
TRIES = 20
"""Largest number of attempts to find parameters."""
SWING_TIME = 3.0
"""s, time within which the swings of joints with different natural frequencies have added up."""
SLOW = 4.0
"""rad/s, lowest natural frequency of a joint on its spring, with the other joints locked: a slower joint has not arrived when
a run of some seconds ends, even with good damping."""
LONGEST_DECAY = 8.0
"""s, longest time until 5 % of a swing is left with the damping of the robot file; above it a warning is given."""
PROPOSED_DECAY = 2.0
"""s until 5 % of a swing is left with the proposed damping."""
MOST_RATIO = 0.5
"""Largest damping ratio of a joint alone that is proposed: an overdamped arm shows nothing of its springs."""


@dataclass(frozen=True, kw_only=True)
class Swing:
    """The swing of one joint when the references jump."""

    block: ActuatorBlock
    step: float
    """rad or m by which its reference jumps."""
    deflection: float
    """rad or m, largest deflection of spring and controller together."""
    used: float
    """Largest share of its torque limit that a motor needs, with linear springs and the joint's weight."""
    droops: bool
    """Its controllers are hardly stiffer than its springs."""
    rate: float
    """rad/s, natural frequency on spring and controller, with the other joints locked."""

    @property
    def shaken(self) -> bool:
        """Its neighbours shake it far beyond its own step."""
        return 0.0 < SHAKEN_FACTOR * self.step < self.deflection

    @property
    def slow(self) -> bool:
        """Its spring is too soft for the inertia that it carries."""
        return self.rate < SLOW


@dataclass(frozen=True, kw_only=True)
class _Linear:
    """The arm, linearised about the end of its references, in the n joints that have a spring and a position reference."""

    blocks: list[ActuatorBlock]
    drives: list[Drive]
    masses: Array
    """(n, n) kg m^2."""
    springs: Array
    """(n,) N m/rad."""
    gains: Array
    """(n,) N m/rad, stiffness of the controllers; inf for ideal motors."""
    damping: Array
    """(n,) N m s/rad, damping in the robot's file."""
    steps: Array
    """(n,) rad by which the references jump."""
    ends: list[tuple[float, ...]]
    """Final references: for the link, and for the actuator."""

    @classmethod
    def of(cls, scenario: Scenario, robot: Robot) -> _Linear | None:
        """None if nothing swings, or if the mass matrix is singular."""
        blocks = [block for block in robot.actuators if MODES[block.mode].spring and not MODES[block.mode].direct]
        drives = [drive_of(block) for block in blocks]
        names = [joint.name for joint in robot.moving_joints]
        columns = [names.index(drive.joint) for drive in drives]
        masses = zero_pose_matrix(robot)[np.ix_(columns, columns)]
        if not blocks or np.linalg.eigvalsh(masses)[0] <= 0.0:
            return None
        goals = [goals_of(scenario, block, np.array([0.0, scenario.duration])) for block in blocks]
        ends = [(float(goal[-1]), *(float(motor[-1]) for motor in motors)) for motors, goal in goals]
        laws: list[Any] = [drive.actuator.stiffness for drive in drives]
        stiffness = (law(*end, drive.elastic) for law, drive, end in zip(laws, drives, ends, strict=True))
        return cls(
            blocks=blocks, drives=drives, masses=masses, springs=np.maximum(list(stiffness), 1e-9),
            gains=np.array([sum(drive.proportional) or np.inf for drive in drives]),
            damping=np.array([robot.joint(drive.joint).damping for drive in drives]),
            steps=np.array([np.ptp(goal) for _, goal in goals]), ends=ends,
        )  # fmt: skip

    @property
    def stiffness(self) -> Array:
        """(n,) N m/rad, spring and controller in series."""
        return np.asarray(1.0 / (1.0 / self.springs + 1.0 / self.gains))

    def lasts(self, damping: Array) -> float:
        """s until 5 % of the longest swing is left with damping (n,) in N m s/rad; 0 if every mode is overdamped."""
        size = len(self.masses)
        inverse = np.linalg.inv(self.masses)
        below = np.hstack([-inverse * self.stiffness, -inverse * damping])
        rates = np.linalg.eigvals(np.vstack([np.hstack([np.zeros((size, size)), np.eye(size)]), below]))
        swinging = rates[(np.abs(rates.imag) > np.abs(rates.real))]
        return float(3.0 / max(1e-9, -swinging.real.max())) if len(swinging) else 0.0


def swings(scenario: Scenario, robot: Robot) -> tuple[Swing, ...]:
    """The swing of every joint with a spring and a position reference; empty if the mass matrix is singular."""
    arm = _Linear.of(scenario, robot)
    if arm is None:
        return ()
    lag = float(np.mean([_lag(drive) for drive in arm.drives]))
    largest = _largest(arm.masses, arm.stiffness, arm.steps, lag)
    loads = {one.joint: abs(one.load) for one in holdings(scenario, robot, arm.blocks)} if any(scenario.gravity) else {}
    rates = np.sqrt(arm.stiffness / np.diag(arm.masses))
    found = []
    for j, drive in enumerate(arm.drives):
        pull = arm.springs[j] * largest[j] + loads.get(drive.joint, 0.0)
        law: Any = drive.actuator.elastic_torques
        resting = law(*arm.ends[j], drive.elastic)
        shares = ((abs(torque) + pull) / max(most, 1e-9) for torque, most in zip(resting, drive.max_torque, strict=False))
        found.append(
            Swing(
                block=arm.blocks[j], step=float(arm.steps[j]), deflection=float(largest[j]),
                used=float(max(shares, default=0.0)), rate=float(rates[j]),
                droops=bool(arm.gains[j] < STIFF_CONTROLLER * arm.springs[j]),
            )
        )  # fmt: skip
    return tuple(found)


def calming(scenario: Scenario, robot: Robot) -> tuple[float, Mapping[str, Mapping[str, float]]]:
    """s for which the arm swings with the damping of its file, and by joint the keys of `link_damping` that bring it to rest;
    empty if it comes to rest anyway, or if its masses are unknown."""
    arm = _Linear.of(scenario, robot)
    if arm is None or (lasts := arm.lasts(arm.damping)) < LONGEST_DECAY:
        return 0.0, {}
    inertia = np.diag(arm.masses)
    critical = 2.0 * np.sqrt(inertia * arm.springs)
    ratio = next(
        (
            ratio
            for ratio in np.arange(0.1, MOST_RATIO, 0.05)
            if arm.lasts(np.maximum(arm.damping, ratio * critical)) < PROPOSED_DECAY
        ),
        MOST_RATIO,
    )
    keys = {"ratio": float(f"{ratio:.2g}")}
    lacking = zip(arm.drives, inertia, arm.damping < ratio * critical, strict=True)
    return lasts, {drive.joint: {**keys, "inertia": float(f"{own:.2g}")} for drive, own, lacks in lacking if lacks}


def steadying(scenario: Scenario, robot: Robot) -> Mapping[str, Mapping[str, float]]:
    """Joint -> parameter -> value with which no joint is shaken or slow and no motor is at its limit; empty if there is nothing
    to mend, or if no such values were found."""
    found: dict[str, dict[str, float]] = {}
    for _ in range(TRIES):
        given = {
            one.block.joint: _stiffer(one)
            for one in swings(scenario, robot)
            if one.shaken or one.slow or one.used > MOTOR_SHARE
        }
        if not given:
            return found
        if not all(given.values()):
            break
        found = {joint: found.get(joint, {}) | given.get(joint, {}) for joint in {**found, **given}}
        robot = with_overrides(robot, parameters=given)
    return {}


def _largest(masses: Array, stiffness: Array, steps: Array, lag: float) -> Array:
    """(n,) rad, largest distance from the new references. masses: (n, n) kg m^2; stiffness: (n,) N m/rad; steps: (n,) rad;
    lag: s by which the motors lag behind their references, which smooths fast motions."""
    inverse = np.linalg.inv(np.linalg.cholesky(masses))
    squares, modes = np.linalg.eigh(inverse @ np.diag(stiffness) @ inverse.T)
    shapes, rates = inverse.T @ modes, np.sqrt(np.maximum(squares, 0.0))
    amplitudes = shapes.T @ masses @ steps / np.hypot(1.0, rates * lag)
    time = np.linspace(0.0, SWING_TIME, 1501)
    return np.asarray(np.abs(shapes @ (amplitudes[:, None] * np.cos(np.outer(rates, time)))).max(axis=1))


def _lag(drive: Drive) -> float:
    """s by which the slower motor lags behind its reference; 0 for ideal motors."""
    constants = zip(drive.derivative, drive.motor_damping, drive.proportional, strict=True)
    return max(((d + damping) / max(p, 1e-9) for d, damping, p in constants), default=0.0)


def _stiffer(swing: Swing) -> dict[str, float]:
    """Stiffer springs or controllers if the joint is shaken or slow, else stronger motors; empty if no parameter is known to
    help."""
    values, factor = swing.block.values(), max(STIFFER, (SLOW / max(swing.rate, 1e-3)) ** 2)
    if not swing.shaken and not swing.slow:
        names, factor = motor_limits(values), swing.used / PROPOSED_SHARE
    elif swing.droops:
        names = tuple(name for name in values if name.endswith("_proportional"))
    else:
        names = linear_parameters(ACTUATORS.get(swing.block.actuator), values)
    return {name: float(f"{factor * values[name]:.2g}") for name in names}
