"""Inverse dynamics through the springs: the input that moves soft joints as wanted, and whether the drives can follow.

tau = RNEA(q, dq, ddq) + c dq + F tanh(dq / 0.02) - tau_external,   then the inverse model of each joint's drive
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from asrsim.actuators.drive import Drive
from asrsim.actuators.vectorised import over_arrays
from asrsim.kinematics.desired import DesiredMotion, knot_distance
from asrsim.kinematics.drive_inverse import SLOW, DriveMotion, drive_backwards
from asrsim.kinematics.model import DynamicModel
from asrsim.quantities import linear_unit
from asrsim.samples import Array
from asrsim.scenario.data import LinkDamping

if TYPE_CHECKING:
    from asrsim.robot.model import Robot

START = 0.1
"""s at the start in which demands are not checked: motors that start unloaded must first take up their load. The last two
knots of the splines are not checked either: the derivatives are inaccurate there."""


@dataclass(frozen=True, kw_only=True)
class Losses:
    """Damping and friction of a joint beside those of its drive, and its effort limit and stops."""

    prismatic: bool = False
    """Whether the units are m and N instead of rad and N m."""
    damping: float = 0.0
    """N m s/rad."""
    friction: float = 0.0
    """N m."""
    law: LinkDamping | None = None
    """Link damping that depends on the stiffness."""
    effort: float = np.inf
    """N m."""
    stops: tuple[float, float] = (-np.inf, np.inf)
    """rad."""

    @classmethod
    def of(cls, robot: Robot, joint: str, law: LinkDamping | None = None) -> Losses:
        """The losses of a joint of the robot."""
        found = robot.joint(joint)
        return cls(
            prismatic=found.kind == "prismatic",
            damping=found.damping,
            friction=found.friction,
            law=law,
            effort=found.most_effort,
            stops=found.stops,
        )


@dataclass(frozen=True, kw_only=True)
class Demand:
    """The largest value that a motion needs of one part of a joint, and the limit of that part."""

    joint: str
    what: str
    """`motor torque`, `motor speed`, `spring deflection`, `spring torque`, `joint effort`, `joint stop`, or `error from the
    start` (an error in the first moments that learning cannot remove)."""
    needed: float
    limit: float
    unit: str
    time: float
    """s, the instant of the largest value."""
    motor: int = 0
    """1 or 2; 0 if the demand is not about a motor."""

    @property
    def score(self) -> float:
        """Needed value divided by the limit: above 1 the motion is out of reach."""
        if self.what == "joint stop":
            return 2.0
        return abs(self.needed / self.limit) if self.limit else (np.inf if self.needed else 0.0)

    def __str__(self) -> str:
        which = f" of motor {self.motor}" if self.motor else ""
        return (
            f"{self.joint} at {self.time:.3g} s: {self.what}{which} {abs(self.needed):.3g} {self.unit}, "
            f"limit {self.limit:.3g} {self.unit}"
        )


@dataclass(frozen=True, kw_only=True)
class InverseDynamics:
    """The input that moves the joints as wanted, with its demands on motors, springs and joints."""

    motion: DesiredMotion
    """The desired motion of the model's joints."""
    joints: tuple[str, ...]
    """The driven joints."""
    torques: Array = field(repr=False)
    """(n, joints) N m, torques on the links."""
    drives: tuple[DriveMotion, ...] = field(repr=False)
    demands: tuple[Demand, ...]
    """One for each part of each joint, the highest score first."""

    @property
    def inputs(self) -> Array:
        """(n, joints) the modes' first references."""
        return np.column_stack([drive.inputs for drive in self.drives])

    @property
    def out_of_reach(self) -> tuple[Demand, ...]:
        """Demands beyond their limit."""
        return tuple(demand for demand in self.demands if demand.score > 1.0)

    def inputs_at(self, time: Array, delays: Sequence[float] = ()) -> Array:
        """(k, joints) inputs at `time` (k,), advanced by the commands' delays in s; constant beyond both ends."""
        from scipy.interpolate import CubicSpline

        own = self.motion.time
        columns = []
        for index, values in enumerate(self.inputs.T):
            ahead = np.clip(time + (delays[index] if len(delays) else 0.0), own[0], own[-1])
            columns.append(CubicSpline(own, values)(ahead))
        return np.column_stack(columns)


def invert(
    model: DynamicModel,
    drives: Sequence[Drive],
    motion: DesiredMotion,
    presets: Mapping[str, Array],
    losses: Mapping[str, Losses],
    external: Mapping[str, Array] | None = None,
) -> InverseDynamics:
    """The inputs of `drives` that move the model's joints along `motion` (columns in the model's order).

    By joint: presets: second references (n,); losses; external: torques (n,) in N m on the links.
    """
    rigid = model.inverse_dynamics(motion.positions, motion.velocities, motion.accelerations)
    found, torques, demands = [], [], []
    for drive in drives:
        index = model.joints.index(drive.joint)
        position, velocity = motion.positions[:, index], motion.velocities[:, index]
        loss = losses.get(drive.joint, Losses())
        torque = rigid[:, index] + loss.damping * velocity + loss.friction * np.tanh(velocity / SLOW)
        if external is not None and drive.joint in external:
            torque = torque - external[drive.joint]
        preset = presets.get(drive.joint, np.zeros(len(position)))
        item = drive_backwards(drive, motion.time, position, velocity, torque, preset)
        if loss.law is not None:
            # The torque of the damping hardly changes the stiffness: one iteration is enough.
            torque = torque + _law_damping(drive, loss.law, position, item) * velocity
            item = drive_backwards(drive, motion.time, position, velocity, torque, preset)
        found.append(item)
        torques.append(torque)
        demands += demands_of(drive, motion.time, position, torque, item, loss)
    return InverseDynamics(
        motion=motion,
        joints=tuple(drive.joint for drive in drives),
        torques=np.column_stack(torques),
        drives=tuple(found),
        demands=tuple(sorted(demands, key=lambda demand: -demand.score)),
    )


def _law_damping(drive: Drive, law: LinkDamping, position: Array, item: DriveMotion) -> Array:
    if not drive.mode.spring:
        return np.full(len(position), law.constant)
    stiffness = over_arrays(drive.actuator.stiffness)(position, item.motors[:, 0], item.motors[:, 1], drive.elastic)
    return np.asarray(law.constant + 2.0 * law.ratio * np.sqrt(law.inertia * np.maximum(stiffness, 0.0)))


def demands_of(
    drive: Drive, time: Array, position: Array, torque: Array, item: DriveMotion, loss: Losses | None = None
) -> list[Demand]:
    """The highest demand on each part of a joint over the motion."""
    loss = loss or Losses()
    length = float(time[-1] - time[0])
    judged = (time >= time[0] + min(START, 0.2 * length)) & (time <= time[-1] - 2.0 * knot_distance(length))
    found: list[Demand] = []

    def add(what: str, needed: Array, limit: Array | float, unit: str, motor: int = 0) -> None:
        limits = np.broadcast_to(np.abs(limit), needed.shape)
        with np.errstate(all="ignore"):
            share = np.where(judged, np.nan_to_num(np.abs(needed) / limits, nan=0.0, posinf=np.inf), -1.0)
        worst = int(np.argmax(share))
        found.append(
            Demand(joint=drive.joint, what=what, needed=float(needed[worst]), limit=float(limits[worst]),
                   unit=linear_unit(unit) if loss.prismatic else unit,
                   time=float(time[worst]), motor=motor)
        )  # fmt: skip

    for motor, limit in enumerate(drive.max_torque if drive.mode.motor else ()):
        add("motor torque", item.motor_torques[:, motor], limit, "N m", motor + 1)
        rate = np.gradient(item.motors[:, motor], time)
        add("motor speed", rate, drive.max_velocity[motor], "rad/s", motor + 1)
    if drive.mode.spring:
        add("spring torque", torque, item.holdable, "N m")
        # Of two springs, the one with the smaller deflection still yields when the other is at its limit.
        deflections = np.abs(item.motors[:, : drive.actuator.motors] - position[:, None])
        add("spring deflection", deflections.min(axis=1), drive.max_deflection, "rad")
    add("joint effort", torque, loss.effort, "N m")
    lower, upper = loss.stops
    above, below = position - upper, lower - position
    worst = int(np.argmax(np.maximum(above, below)))
    limit = upper if above[worst] >= below[worst] else lower
    if max(above[worst], below[worst]) > 1e-3:
        # Only the distance beyond the stop counts, not its sign.
        found.append(
            Demand(joint=drive.joint, what="joint stop", needed=float(position[worst]), limit=float(limit),
                   unit="m" if loss.prismatic else "rad", time=float(time[worst]))
        )  # fmt: skip
    return found
