"""Data that a simulation produces: arrays by quantity and joint. Logs are written from these classes and read into them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import PurePath
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
STAIRS = 0.5
"""Fraction of a command's changes that directly follow another change, below which the command counts as piecewise constant.
Other commands are smooth.
"""


@dataclass(frozen=True, kw_only=True)
class JointInfo:
    """Description of a joint, which is needed to interpret the joint's numbers in a log."""

    name: str
    actuator: str
    """Registry name of the actuator (`sea`, `qbmove`, ...); `rigid` for a joint without plugin."""
    mode: int | None
    """Operation mode 0..8; None for a joint without plugin."""
    namespace: str = ""
    """ROS namespace without slashes at the ends; topics are `/<namespace>/<joint>/...`."""
    motors: int = 0
    """Number of motor positions that the actuator has (SEA 1, qbMove 2; AwAS-II 2: motor and adjuster)."""
    prismatic: bool = False
    quantities: tuple[str, ...] = ()
    """Names of the quantities in `asrsim.quantities.QUANTITIES` that this joint records."""


@dataclass(frozen=True, kw_only=True)
class Frame:
    """Frame of a link relative to its parent link, for viewers."""

    parent: str
    """Name of the parent link, or the world."""
    child: str
    position: tuple[float, float, float]
    """Position at joint position 0, m."""
    rotation: tuple[float, float, float, float]
    """Rotation at joint position 0, quaternion x y z w."""
    joint: str = ""
    """Joint that moves the link; empty: the link is fixed."""
    axis: tuple[float, float, float] = (1.0, 0.0, 0.0)
    """Axis of the joint, in the joint's frame."""
    prismatic: bool = False


@dataclass(frozen=True)
class Command:
    """Value that a client sets in a live run, and the substep after which the value acts."""

    substep: int
    """Number of completed substeps when the value was set; the value acts in the next substep and later."""
    joint: str
    reference: str
    """Name of the reference in the joint's mode, or `external_torque`."""
    value: float | None
    """Value in SI units; None: the reference of the scenario acts again."""


@dataclass(frozen=True)
class HeldWrench:
    """Force and torque that act on a body until they are replaced."""

    body: str
    """Name of a link or of an object of the world."""
    force: tuple[float, float, float]
    """Force in N, world frame."""
    torque: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Torque in N m, world frame."""
    point: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Point of the body at which the force acts, in the body's frame, m."""


@dataclass(frozen=True)
class WrenchCommand:
    """Wrench that is set in a live run, and the substep after which the wrench acts, as in `Command`."""

    substep: int
    wrench: HeldWrench


TIP, TIP_GOAL = "tip", "tip_goal"
"""Names of two bodies in the log of a Cartesian task: the tip, and the desired position of the tip."""


@dataclass(frozen=True, kw_only=True, repr=False)
class Samples:
    """Samples of a run or of a part of a run: n samples at whole steps."""

    time: Array
    """Simulated times (n,), s."""
    joints: tuple[str, ...]
    values: Mapping[str, Array]
    """Values (n, joints) of each quantity in SI units, by name; a column is NaN if its joint does not record the quantity."""
    bodies: Mapping[str, Array] = field(default_factory=dict)
    """Poses (n, 7) of each object or link, by name: position x y z in m, orientation as quaternion x y z w, world frame."""
    contacts: Mapping[str, Array] = field(default_factory=dict)
    """Contact force (n, 3) in N, world frame, on the first body of each pair, by pair: "object/link" or "object/ground"."""

    def __repr__(self) -> str:
        span = f", {self.time[0]:g} to {self.time[-1]:g} s" if len(self.time) else ""
        return f"Samples({len(self.time)} of {', '.join(self.joints)}{span}: {', '.join(self.values)})"

    def forces_on(self, body: str) -> dict[str, Array]:
        """Contact forces (n, 3) in N, world frame, on this body, by name of the other body; 0 without contact."""
        forces = {}
        for pair, force in self.contacts.items():
            first, _, second = pair.partition("/")
            if body in (first, second):
                # The logged force acts on the first body, and the opposite force acts on the second body. NaN means no contact.
                forces[second if body == first else first] = np.nan_to_num(force) * (1.0 if body == first else -1.0)
        return forces

    def joint(self, name: str) -> dict[str, Array]:
        """All recorded quantities of one joint, each an array (n,), by name."""
        index = self.joints.index(name)
        columns = {quantity: values[:, index] for quantity, values in self.values.items()}
        return {quantity: column for quantity, column in columns.items() if not np.all(np.isnan(column))}


def concatenate(parts: Sequence[Samples], *, joints: Sequence[str] = (), quantities: Sequence[str] = ()) -> Samples:
    """Samples joined in time. Bodies and contacts that one of the parts lacks are NaN in that part.

    joints, quantities: names of the result's joints and quantities if `parts` is empty.
    """
    if not parts:
        return Samples(time=np.empty(0), joints=tuple(joints), values={name: np.empty((0, len(joints))) for name in quantities})
    if len(parts) == 1:
        return parts[0]

    def joined(tables: list[Mapping[str, Array]], width: int) -> dict[str, Array]:
        names = dict.fromkeys(name for table in tables for name in table)
        return {
            name: np.concatenate(
                [
                    table[name] if name in table else np.full((len(part.time), width), np.nan)
                    for table, part in zip(tables, parts, strict=True)
                ]
            )
            for name in names
        }

    return Samples(
        time=np.concatenate([part.time for part in parts]),
        joints=parts[0].joints,
        values=joined([part.values for part in parts], len(parts[0].joints)),
        bodies=joined([part.bodies for part in parts], 7),
        contacts=joined([part.contacts for part in parts], 3),
    )


@dataclass(frozen=True, kw_only=True, repr=False)
class RunInfo:
    """Description of a run without its time series; with it, the run can be repeated from its log."""

    robot: str
    """Name of the robot."""
    joints: tuple[JointInfo, ...]
    step: float
    """Time step of the simulation loop, s."""
    log_every: int = 1
    """Number of steps from one logged sample to the next."""
    variant: str = ""
    urdf: str = ""
    """URDF text as loaded, after xacro expansion."""
    urdf_path: str = ""
    scenario: str = ""
    """Scenario text as read; empty for a scenario that was made in the library without a file."""
    scenario_path: str = ""
    resolved: Mapping[str, Any] = field(default_factory=dict)
    """Resolved scenario and parameters as plain data, needed to repeat the run."""
    metadata: Mapping[str, str] = field(default_factory=dict)
    """Versions, seed, engine, stepping, substeps and similar entries as text."""
    attachments: Mapping[str, bytes] = field(default_factory=dict)
    """Content of each further file that is needed to repeat the run (CSV playbacks, manager YAML), by name."""
    frames: tuple[Frame, ...] = ()
    """Frames of the links, for the topic `/tf`; they are not read back from a log."""
    frame_rate: float = 30.0
    """Highest rate of messages on the topic `/tf`, Hz."""

    @property
    def scenario_name(self) -> str:
        """Name of the scenario; by default the name of its file without suffix; empty for a scenario without a file."""
        file = PurePath(self.scenario_path).stem
        return file and str(self.resolved.get("scenario", {}).get("name", file))

    def __repr__(self) -> str:
        return f"RunInfo({self.robot}, variant {self.variant}, {len(self.joints)} joints, {self.scenario_path})"


def picking(rows: list[int]) -> Any:
    """Index that selects rows of an array. For adjacent rows it is a slice, which avoids a copy."""
    neighbours = rows == list(range(rows[0], rows[0] + len(rows)))
    return slice(rows[0], rows[0] + len(rows)) if neighbours else np.array(rows)


def grid(first: int, count: int, step: float) -> Array:
    """Times of `count` steps that begin with step `first`, s. They are rounded so that 3 * 0.1 gives 0.3."""
    return np.round(np.arange(first, first + count) * step, 12)


def is_staircase(values: Array) -> bool:
    """Whether a command with these samples (n,) is piecewise constant, so that an equal value follows most of its changes."""
    changes = np.diff(values) != 0.0
    following = float(np.sum(changes[1:] & changes[:-1])) / max(1, int(np.sum(changes)))
    return following < STAIRS
