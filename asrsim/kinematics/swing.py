"""How far and how long an arm swings when its references jump, and what its springs, motors and joints need to come to rest.

The arm is linear and undamped here, its mass matrix that of the zero pose. Joints swing together: a light wrist on a soft
spring is thrown about by the shoulder, however well it holds its own weight.
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
from asrsim.robot.inertia import zero_pose_inertia
from asrsim.robot.mounting import drive_of
from asrsim.samples import Array
from asrsim.scenario.data import Scenario

THROWN = 2.0
"""Times its own step that a joint may swing; more comes from its neighbours. (A joint alone swings by once its step.)"""
USED = 0.8
"""Share of its largest torque that a motor may need as the arm swings."""
SPARE = 0.6
"""The share that it needs with proposed parameters."""
STIFFER = 1.5
"""Factor on springs, or on the gains that droop, of a joint that is thrown."""
FIRM = 2.0
"""Times as stiff as its spring that a controller is."""
TRIES = 20
"""Rounds in which other parameters are tried, at most."""
LONG = 3.0
"""s in which joints that swing at different rates have met."""
SLOW = 4.0
"""rad/s, the least rate at which a joint swings on its spring, the others locked: a slower one is still on its way when a run
of some seconds ends, however well it is damped."""
ON_AND_ON = 8.0
"""s after which 5 % of a swing may be left in a robot file's own damping; beyond it the arm is said to swing on."""
CALM = 2.0
"""s after which 5 % of a swing are left with proposed damping."""
MOST_RATIO = 0.5
"""Damping ratio of a joint alone, at most proposed; an arm that creeps shows nothing of its springs."""


@dataclass(frozen=True, kw_only=True)
class Swing:
    """One joint as the arm swings."""

    block: ActuatorBlock
    step: float
    """rad or m by which its reference jumps."""
    deflection: float
    """rad or m, the largest of its spring and controller."""
    used: float
    """Largest share of its torque that a motor needs, were springs linear; the joint's weight included."""
    droops: bool
    """Its controllers are little stiffer than its springs."""
    rate: float
    """rad/s at which it swings on spring and controller, the others locked."""

    @property
    def thrown(self) -> bool:
        """Its neighbours throw it about."""
        return 0.0 < THROWN * self.step < self.deflection

    @property
    def slow(self) -> bool:
        """Its spring is too soft for what it carries."""
        return self.rate < SLOW


@dataclass(frozen=True, kw_only=True)
class _Linear:
    """The arm about the end of its references, in the joints (n) that a spring leads to them."""

    blocks: list[ActuatorBlock]
    drives: list[Drive]
    masses: Array
    """(n, n) kg m^2."""
    springs: Array
    """(n,) N m/rad."""
    gains: Array
    """(n,) N m/rad of the controllers; inf of ideal motors."""
    damping: Array
    """(n,) N m s/rad, of the robot's file."""
    steps: Array
    """(n,) rad by which the references jump."""
    ends: list[tuple[float, ...]]
    """Where they end: of the link, and of what the actuator takes."""

    @classmethod
    def of(cls, scenario: Scenario, robot: Robot) -> _Linear | None:
        """None where nothing swings, or the mass matrix is singular."""
        blocks = [block for block in robot.actuators if MODES[block.mode].spring and not MODES[block.mode].direct]
        drives = [drive_of(block) for block in blocks]
        inertia = zero_pose_inertia(robot)
        columns = [inertia.names.index(drive.joint) for drive in drives]
        masses = inertia.matrix[np.ix_(columns, columns)]
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
        """s after which 5 % of the longest swing are left with damping (n,) N m s/rad; 0 where all of it creeps."""
        size = len(self.masses)
        inverse = np.linalg.inv(self.masses)
        below = np.hstack([-inverse * self.stiffness, -inverse * damping])
        rates = np.linalg.eigvals(np.vstack([np.hstack([np.zeros((size, size)), np.eye(size)]), below]))
        swinging = rates[(np.abs(rates.imag) > np.abs(rates.real))]
        return float(3.0 / max(1e-9, -swinging.real.max())) if len(swinging) else 0.0


def swings(scenario: Scenario, robot: Robot) -> tuple[Swing, ...]:
    """Every joint that a spring leads to its references; none where the mass matrix is singular."""
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
                used=float(max(shares, default=0.0)), droops=bool(arm.gains[j] < FIRM * arm.springs[j]), rate=float(rates[j]),
            )
        )  # fmt: skip
    return tuple(found)


def calming(scenario: Scenario, robot: Robot) -> tuple[float, Mapping[str, Mapping[str, float]]]:
    """s for which the arm swings on in its file's own damping, and by joint the keys of `link_damping` with which it comes to
    rest; none where it does so by itself, or nothing is known of its masses."""
    arm = _Linear.of(scenario, robot)
    if arm is None or (lasts := arm.lasts(arm.damping)) < ON_AND_ON:
        return 0.0, {}
    inertia = np.diag(arm.masses)
    critical = 2.0 * np.sqrt(inertia * arm.springs)
    ratio = next(
        (ratio for ratio in np.arange(0.1, MOST_RATIO, 0.05) if arm.lasts(np.maximum(arm.damping, ratio * critical)) < CALM),
        MOST_RATIO,
    )
    keys = {"ratio": float(f"{ratio:.2g}")}
    lacking = zip(arm.drives, inertia, arm.damping < ratio * critical, strict=True)
    return lasts, {drive.joint: {**keys, "inertia": float(f"{own:.2g}")} for drive, own, lacks in lacking if lacks}


def steadying(scenario: Scenario, robot: Robot) -> Mapping[str, Mapping[str, float]]:
    """Joint -> parameter -> value with which no joint is thrown about or slow and no motor gives way; empty where none is, or
    where no such values were found."""
    found: dict[str, dict[str, float]] = {}
    for _ in range(TRIES):
        given = {one.block.joint: _firmer(one) for one in swings(scenario, robot) if one.thrown or one.slow or one.used > USED}
        if not given:
            return found
        if not all(given.values()):
            break
        found = {joint: found.get(joint, {}) | given.get(joint, {}) for joint in {**found, **given}}
        robot = with_overrides(robot, parameters=given)
    return {}


def _largest(masses: Array, stiffness: Array, steps: Array, lag: float) -> Array:
    """(n,) rad, largest distance from the new references. masses: (n, n) kg m^2; stiffness: (n,) N m/rad; steps: (n,) rad;
    lag: s by which motors follow their references, which smooths what is fast."""
    inverse = np.linalg.inv(np.linalg.cholesky(masses))
    squares, modes = np.linalg.eigh(inverse @ np.diag(stiffness) @ inverse.T)
    shapes, rates = inverse.T @ modes, np.sqrt(np.maximum(squares, 0.0))
    amplitudes = shapes.T @ masses @ steps / np.hypot(1.0, rates * lag)
    time = np.linspace(0.0, LONG, 1501)
    return np.asarray(np.abs(shapes @ (amplitudes[:, None] * np.cos(np.outer(rates, time)))).max(axis=1))


def _lag(drive: Drive) -> float:
    """s by which the slower motor follows its reference; 0 of ideal ones."""
    constants = zip(drive.derivative, drive.motor_damping, drive.proportional, strict=True)
    return max(((d + damping) / max(p, 1e-9) for d, damping, p in constants), default=0.0)


def _firmer(swing: Swing) -> dict[str, float]:
    """Stiffer springs or controllers where the joint is thrown about or slow; else stronger motors; empty where it is not known
    how."""
    values, factor = swing.block.values(), max(STIFFER, (SLOW / max(swing.rate, 1e-3)) ** 2)
    if not swing.thrown and not swing.slow:
        names, factor = motor_limits(values), swing.used / SPARE
    elif swing.droops:
        names = tuple(name for name in values if name.endswith("_proportional"))
    else:
        names = linear_parameters(ACTUATORS.get(swing.block.actuator), values)
    return {name: float(f"{factor * values[name]:.2g}") for name in names}
