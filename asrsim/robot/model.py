"""The robot as pure data: what the URDF says, before anything is built."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Literal

from asrsim.errors import Problem

Vector = tuple[float, float, float]
Origin = Literal["tag", "default", "mode default", "scenario"]
UNREAD = float("nan")
"""Value of a parameter with a fault that is already reported; compared by identity, since other NaNs are possible."""
STRIBECK_VELOCITY = 0.1
"""rad/s (m/s), where a file gives none."""
INERTIAS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
"""Of a link's inertia, as URDFs name them."""
ShapeKind = Literal["box", "sphere", "cylinder", "capsule", "mesh"]


@dataclass(frozen=True, kw_only=True)
class ParameterValue:
    """A parameter of one actuator, with where its value came from."""

    name: str
    value: float
    """:data:`UNREAD` where what is given has a fault."""
    unit: str
    origin: Origin
    tag: str = ""
    """The toolbox's tag name, whether the file has it or not."""
    line: int | None = None
    text: str = ""
    """The text of the tag, where the value came from one."""


@dataclass(frozen=True, kw_only=True)
class ActuatorBlock:
    """One `<gazebo><plugin>` block of the toolbox: an actuator on a joint."""

    actuator: str
    """Registry name: `qbmove` for `libqbmove_plugin.so`."""
    joint: str
    mode: int
    namespace: str = ""
    subscribe_external_torque: bool = False
    sample_time: float | None = None
    """s, the later dialect's `<t_sample>`; kept as data, the simulation runs at the scenario's step."""
    parameters: Mapping[str, ParameterValue] = field(default_factory=dict)
    """Every parameter of the actuator by name, defaults filled in."""
    plugin_name: str = ""
    line: int | None = None

    def values(self) -> Mapping[str, float]:
        """Parameter values by name."""
        return self._values

    @cached_property
    def _values(self) -> dict[str, float]:
        return {name: parameter.value for name, parameter in self.parameters.items()}


@dataclass(frozen=True, kw_only=True)
class Shape:
    """A collision or visual of a link."""

    kind: ShapeKind
    size: tuple[float, ...] = ()
    """m. box: edges x, y, z; sphere: radius; cylinder and capsule: radius, length; mesh: none."""
    origin: Vector = (0.0, 0.0, 0.0)
    """m, the shape's frame in the link's frame."""
    rpy: Vector = (0.0, 0.0, 0.0)
    """rad, the same frame's orientation."""
    mesh: str = ""
    """The mesh's file as the robot file names it; `Packages.resolve` finds it."""
    scale: Vector = (1.0, 1.0, 1.0)
    """Of a mesh, along its own axes."""
    colour: tuple[float, float, float, float] | None = None
    """Red, green, blue, opacity, 0 to 1; None where the file gives none."""
    line: int | None = None


@dataclass(frozen=True, kw_only=True)
class Link:
    """A rigid body."""

    name: str
    mass: float | None
    """kg; None where the file gives no `<inertial>`."""
    inertia: tuple[float, float, float, float, float, float] | None
    """ixx, ixy, ixz, iyy, iyz, izz about the centre of mass, in the inertial frame, kg m^2."""
    centre_of_mass: Vector = (0.0, 0.0, 0.0)
    """m, in the link's frame."""
    inertial_rpy: Vector = (0.0, 0.0, 0.0)
    """rad, turns the inertial frame against the link's frame."""
    collisions: tuple[Shape, ...] = ()
    visuals: tuple[Shape, ...] = ()
    line: int | None = None


@dataclass(frozen=True, kw_only=True)
class Mimic:
    """A joint that is to follow another: position = multiplier * (the other's) + offset. Data only, not simulated."""

    joint: str
    multiplier: float
    offset: float
    """rad or m."""

    def __str__(self) -> str:
        return f"{self.multiplier:g} * {self.joint} + {self.offset:g}"


@dataclass(frozen=True, kw_only=True)
class Joint:
    """A joint of the tree."""

    name: str
    kind: str
    """URDF type: revolute, continuous, prismatic, fixed, floating, planar."""
    parent: str
    child: str
    axis: Vector = (1.0, 0.0, 0.0)
    """Unit vector in the joint's frame."""
    origin: Vector = (0.0, 0.0, 0.0)
    """m, the joint's frame in the parent link's frame."""
    rpy: Vector = (0.0, 0.0, 0.0)
    """rad, the same frame's orientation."""
    lower: float | None = None
    """rad or m; None: no limit, as of every continuous joint."""
    upper: float | None = None
    effort: float | None = None
    """N m or N; None: no limit given."""
    velocity: float | None = None
    damping: float = 0.0
    friction: float = 0.0
    """N m or N, Coulomb."""
    stribeck_friction: float = 0.0
    """N m or N: static friction above the Coulomb level, which fades with speed (`<stribeckFriction>`); 0: none."""
    stribeck_velocity: float = STRIBECK_VELOCITY
    """rad/s or m/s at which 37 % of that are left (`<stribeckVelocity>`)."""
    load_friction: float = 0.0
    """Share of the torque through the joint's drive that adds to the Coulomb level (`<loadFriction>`); 0: none."""
    spring_stiffness: float = 0.0
    """N m/rad or N/m, of a passive spring (Gazebo's `<springStiffness>`); 0: none."""
    spring_reference: float = 0.0
    """rad or m where that spring is at rest (`<springReference>`)."""
    mimic: Mimic | None = None
    line: int | None = None

    @property
    def frictions(self) -> tuple[float, float, float]:
        """Coulomb level and static excess in N m (N), and the load's share: all 0 where nothing rubs."""
        return self.friction, self.stribeck_friction, self.load_friction

    @property
    def friction_varies(self) -> bool:
        """Its friction depends on speed or load."""
        return bool(self.stribeck_friction or self.load_friction)

    @property
    def stops(self) -> tuple[float, float]:
        """Lower and upper limit in rad or m, infinite where there is none."""
        return -math.inf if self.lower is None else self.lower, math.inf if self.upper is None else self.upper

    @property
    def most_effort(self) -> float:
        """N m or N, infinite where there is no limit."""
        return math.inf if self.effort is None else self.effort

    @property
    def moves(self) -> bool:
        """One degree of freedom that an actuator can drive."""
        return self.kind in ("revolute", "continuous", "prismatic")


@dataclass(frozen=True, kw_only=True)
class Robot:
    """A robot as its file says it; :func:`asrsim.robot.load_robot` gives it without faults."""

    name: str
    path: Path
    text: str = field(repr=False)
    """URDF text as read, for the log; for xacro, as expanded. Engines get the data instead."""
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    actuators: tuple[ActuatorBlock, ...]
    warnings: tuple[Problem, ...] = ()
    faults: tuple[Problem, ...] = ()
    """Errors of the file. Parts with a fault have a default value in this robot, or are missing."""
    unread: frozenset[str] = frozenset()
    """Joints of which it is not known which actuator drives them in which mode, since that has a fault."""

    def joint(self, name: str) -> Joint:
        """The joint of that name; KeyError if there is none."""
        return {joint.name: joint for joint in self.joints}[name]

    @cached_property
    def carried(self) -> Mapping[str, tuple[Joint, ...]]:
        """Link -> the joints that it is the parent of, in file order; absent: none."""
        found: dict[str, tuple[Joint, ...]] = {}
        for joint in self.joints:
            found[joint.parent] = (*found.get(joint.parent, ()), joint)
        return found

    @cached_property
    def outward_joints(self) -> tuple[Joint, ...]:
        """All joints from the root to the tips, parents first."""
        found: list[Joint] = []
        waiting = [self.root.name]
        while waiting:
            joints = self.carried.get(waiting.pop(), ())
            found += joints
            waiting += [joint.child for joint in joints]
        return tuple(found)

    @property
    def root(self) -> Link:
        """The link that is no joint's child."""
        children = {joint.child for joint in self.joints}
        return next(link for link in self.links if link.name not in children)

    @property
    def moving_joints(self) -> tuple[Joint, ...]:
        """Joints with a degree of freedom, in file order."""
        return tuple(joint for joint in self.joints if joint.moves)
