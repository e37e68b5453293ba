"""What a simulation hands on: arrays by quantity and joint. The log is written from these and read back into these."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class JointInfo:
    """What a reader of a log must know of a joint to understand its numbers."""

    name: str
    actuator: str
    """Registry name of the actuator (`sea`, `qbmove`, ...), `rigid` for a joint without plugin."""
    mode: int | None
    """Operation mode 0..8; None for a joint without plugin."""
    namespace: str = ""
    """ROS namespace without slashes at the ends; topics are `/<namespace>/<joint>/...`."""
    motors: int = 0
    """Number of motor positions the actuator has (SEA 1, qbMove 2; AwAS-II 2: motor and adjuster)."""
    prismatic: bool = False
    quantities: tuple[str, ...] = ()
    """Names from `asrsim.quantities.QUANTITIES` that this joint records."""


@dataclass(frozen=True, kw_only=True)
class Frame:
    """A link's frame in its parent's, for viewers."""

    parent: str
    """Link, or the world."""
    child: str
    position: tuple[float, float, float]
    """m, where the joint is at 0."""
    rotation: tuple[float, float, float, float]
    """Quaternion x y z w, likewise."""
    joint: str = ""
    """The joint that moves it; empty: it stands still."""
    axis: tuple[float, float, float] = (1.0, 0.0, 0.0)
    """Of the joint, in its frame."""
    prismatic: bool = False


@dataclass(frozen=True)
class Command:
    """A value set from outside, as it took effect."""

    substep: int
    """Substeps that were done when it was set; it holds from there on."""
    joint: str
    reference: str
    """Name in the joint's mode, or `external_torque`."""
    value: float | None
    """SI; None: the scenario's again."""


TIP, TIP_GOAL = "tip", "tip_goal"
"""Bodies of a Cartesian task: its point, and where its path asks it to be."""


@dataclass(frozen=True, kw_only=True, repr=False)
class Samples:
    """A chunk of a run, or a whole one: n samples at whole steps."""

    time: Array
    """(n,) s, simulated time."""
    joints: tuple[str, ...]
    values: Mapping[str, Array]
    """Quantity name -> (n, number of joints), SI; NaN columns where a joint does not record the quantity."""
    bodies: Mapping[str, Array] = field(default_factory=dict)
    """Object or link name -> (n, 7): position x y z in m, orientation quaternion x y z w, world frame."""
    contacts: Mapping[str, Array] = field(default_factory=dict)
    """"object/link" or "object/ground" -> (n, 3): contact force on the first body in N, world frame."""

    def __repr__(self) -> str:
        span = f", {self.time[0]:g} to {self.time[-1]:g} s" if len(self.time) else ""
        return f"Samples({len(self.time)} of {', '.join(self.joints)}{span}: {', '.join(self.values)})"

    def forces_on(self, body: str) -> dict[str, Array]:
        """What can touch a body -> (n, 3) N, its force on the body in the world frame, 0 without contact."""
        forces = {}
        for pair, force in self.contacts.items():
            first, _, second = pair.partition("/")
            if body in (first, second):
                # The force acts on the first body; on the second it is opposite. NaN: no contact then.
                forces[second if body == first else first] = np.nan_to_num(force) * (1.0 if body == first else -1.0)
        return forces

    def joint(self, name: str) -> dict[str, Array]:
        """All quantities of one joint, each (n,); all-NaN ones left out."""
        index = self.joints.index(name)
        columns = {quantity: values[:, index] for quantity, values in self.values.items()}
        return {quantity: column for quantity, column in columns.items() if not np.all(np.isnan(column))}


def concatenate(parts: Sequence[Samples], *, joints: Sequence[str] = (), quantities: Sequence[str] = ()) -> Samples:
    """Joins samples in time. Bodies and contacts that a part does not have are NaN there.

    joints, quantities: of the result if there are no parts.
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
    """Everything about a run that is not a time series: enough to repeat it from its log alone."""

    robot: str
    """Name of the robot."""
    joints: tuple[JointInfo, ...]
    step: float
    """s between samples of the simulation loop."""
    log_every: int = 1
    """Steps between logged samples."""
    variant: str = ""
    urdf: str = ""
    """URDF text as loaded (xacro expanded)."""
    urdf_path: str = ""
    scenario: str = ""
    """Scenario text as read; empty for runs started from the library without a file."""
    scenario_path: str = ""
    resolved: Mapping[str, Any] = field(default_factory=dict)
    """Resolved scenario and parameters, plain JSON values: what a rerun needs."""
    metadata: Mapping[str, str] = field(default_factory=dict)
    """Versions, seed, engine, stepping, substeps, ... as text."""
    attachments: Mapping[str, bytes] = field(default_factory=dict)
    """Further files a rerun needs (CSV playbacks, manager YAML), by name."""
    frames: tuple[Frame, ...] = ()
    """Of the links, for `/tf`; not read back."""
    frame_rate: float = 30.0
    """Hz of `/tf`, at most."""

    def __repr__(self) -> str:
        return f"RunInfo({self.robot}, variant {self.variant}, {len(self.joints)} joints, {self.scenario_path})"


def picking(rows: list[int]) -> Any:
    """What picks rows of an array: a slice where they are neighbours, which saves a copy."""
    neighbours = rows == list(range(rows[0], rows[0] + len(rows)))
    return slice(rows[0], rows[0] + len(rows)) if neighbours else np.array(rows)


def grid(first: int, count: int, step: float) -> Array:
    """Times of steps in s; rounded, so that 3 * 0.1 is the 0.3 that a user writes."""
    return np.round(np.arange(first, first + count) * step, 12)
