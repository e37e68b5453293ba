"""Robot as pure data, as described in its URDF."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from asrsim.errors import Problem
from asrsim.robot.couplings import Couplings, couplings_of

if TYPE_CHECKING:
    from asrsim.robot.loops import Loop

Vector = tuple[float, float, float]
ZERO: Vector = (0.0, 0.0, 0.0)
Origin = Literal["tag", "default", "mode default", "scenario"]
UNREAD = float("nan")
"""Value of a parameter whose problem is already reported. Compare a value with `UNREAD` by `is`, since other NaNs have
not been reported.
"""
STRIBECK_VELOCITY = 0.1
"""Velocity limit of a joint where the file has none, rad/s (m/s)."""
Inertia = tuple[float, float, float, float, float, float]
INERTIAS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
"""Names of the entries of an inertia tensor in URDFs."""
ShapeKind = Literal["box", "sphere", "cylinder", "capsule", "mesh"]


@dataclass(frozen=True, kw_only=True)
class ParameterValue:
    """Parameter of one actuator, and the source of its value."""

    name: str
    value: float
    """Value; `UNREAD` if the given value is invalid."""
    unit: str
    origin: Origin
    tag: str = ""
    """Name of the toolbox's tag, also if the file lacks the tag."""
    line: int | None = None
    text: str = ""
    """Text of the tag, if the value is from a tag."""


@dataclass(frozen=True, kw_only=True)
class ActuatorBlock:
    """One `<gazebo><plugin>` block of the toolbox: an actuator on a joint."""

    actuator: str
    """Name in the registry: `qbmove` for `libqbmove_plugin.so`."""
    joint: str
    mode: int
    namespace: str = ""
    subscribe_external_torque: bool = False
    parameters: Mapping[str, ParameterValue] = field(default_factory=dict)
    """All parameters of the actuator by name, with defaults."""
    plugin_name: str = ""
    line: int | None = None

    def values(self) -> Mapping[str, float]:
        """Values of the parameters by name."""
        return self._values

    @cached_property
    def _values(self) -> dict[str, float]:
        return {name: parameter.value for name, parameter in self.parameters.items()}

    @cached_property
    def names(self) -> Mapping[str, str]:
        """Parameters by the names that a scenario may give them: their own names, and the tags of the toolbox, whose `max_def`
        also means the `max_deflection` of a user's actuator.
        """
        tags = {one.tag: name for name, one in self.parameters.items() if one.tag}
        alias = {"max_def": "max_deflection"} if "max_deflection" in self.parameters else {}
        return {**alias, **tags, **{name: name for name in self.parameters}}


@dataclass(frozen=True, kw_only=True)
class Shape:
    """A collision or visual of a link."""

    kind: ShapeKind
    size: tuple[float, ...] = ()
    """Sizes, m. Box: edges x, y, z; sphere: radius; cylinder and capsule: radius, length; mesh: none."""
    origin: Vector = ZERO
    """Position of the shape's frame in the link's frame, m."""
    rpy: Vector = ZERO
    """Orientation of the shape's frame in the link's frame, rad."""
    mesh: str = ""
    """File of the mesh as named in the robot file; `Packages.resolve` finds it."""
    scale: Vector = (1.0, 1.0, 1.0)
    """Scale of the mesh along its own axes."""
    colour: tuple[float, float, float, float] | None = None
    """Red, green, blue, opacity, 0 to 1; None if the file states no colour."""
    line: int | None = None


@dataclass(frozen=True, kw_only=True)
class Link:
    """A rigid body."""

    name: str
    mass: float | None
    """Mass, kg; None if the file has no `<inertial>`."""
    inertia: Inertia | None
    """ixx, ixy, ixz, iyy, iyz, izz about the centre of mass, along the axes of the inertial frame, kg m^2."""
    centre_of_mass: Vector = ZERO
    """Position of the centre of mass in the link's frame, m."""
    inertial_rpy: Vector = ZERO
    """Orientation of the inertial frame in the link's frame, rad."""
    collisions: tuple[Shape, ...] = ()
    visuals: tuple[Shape, ...] = ()
    gravity: bool = True
    """Whether gravity acts on the link."""
    weightless_mass: float = 0.0
    """Mass of the parts of a merged link on which gravity does not act, kg."""
    weightless_centre: Vector = ZERO
    """Centre of this mass in the link's frame, m."""
    line: int | None = None

    @property
    def weightless(self) -> tuple[float, Vector]:
        """Mass on which gravity does not act, kg, and its centre in the link's frame, m."""
        return (self.weightless_mass, self.weightless_centre) if self.gravity else (self.mass or 0.0, self.centre_of_mass)


@dataclass(frozen=True, kw_only=True)
class Joint:
    """A joint of the tree."""

    name: str
    kind: str
    """URDF type: revolute, continuous, prismatic, fixed, floating, planar."""
    parent: str
    child: str
    axis: Vector = (1.0, 0.0, 0.0)
    """Unit vector of the axis in the joint's frame."""
    origin: Vector = ZERO
    """Position of the joint's frame in the parent link's frame, m."""
    rpy: Vector = ZERO
    """Orientation of the joint's frame in the parent link's frame, rad."""
    lower: float | None = None
    """Lower limit, rad or m; None: no limit, as for all continuous joints."""
    upper: float | None = None
    effort: float | None = None
    """Effort limit, N m or N; None: no limit."""
    velocity: float | None = None
    damping: float = 0.0
    friction: float = 0.0
    """Coulomb friction, N m or N."""
    stribeck_friction: float = 0.0
    """Static friction minus Coulomb friction, N m or N, which decreases with speed (`<stribeckFriction>`)."""
    stribeck_velocity: float = STRIBECK_VELOCITY
    """Speed at which 37 % of the static excess remains, rad/s or m/s (`<stribeckVelocity>`)."""
    load_friction: float = 0.0
    """Additional Coulomb friction as a fraction of the torque through the joint's drive (`<loadFriction>`)."""
    spring_stiffness: float = 0.0
    """Stiffness of a passive spring, N m/rad or N/m (Gazebo's `<springStiffness>`); 0: no spring."""
    spring_reference: float = 0.0
    """Rest position of the passive spring, rad or m (`<springReference>`)."""
    mimic: str = ""
    """Name of the joint that this joint follows: this joint's position is `multiplier` times the position of the followed
    joint, plus `offset`. Empty: the joint follows no other joint. The followed joint itself follows no joint.
    """
    multiplier: float = 1.0
    offset: float = 0.0
    """Position of this joint if the joint that it follows is at 0, rad or m."""
    rotor_inertia: float = 0.0
    """Inertia of the rotors that the file states for the joint, as felt at the joint (rotor inertia times the square of the
    gear ratio), kg m^2 (kg).
    """
    armature: float = 0.0
    """Inertia of rotors that moves with the link, kg m^2 (kg). It is `armature` of the scenario; if the scenario states none,
    `rotor_inertia`, or 0 behind a spring, where the motors of the actuator have separate inertias.
    """
    start: float | None = None
    """Initial position that the file states, rad or m; in closed chains, the position that closes the chain."""
    line: int | None = None

    @property
    def frictions(self) -> tuple[float, float, float]:
        """Coulomb friction and static excess in N m (N), and the fraction of the load; all 0 without friction."""
        return self.friction, self.stribeck_friction, self.load_friction

    @property
    def friction_varies(self) -> bool:
        """Whether the friction depends on speed or load."""
        return bool(self.stribeck_friction or self.load_friction)

    @property
    def stops(self) -> tuple[float, float]:
        """Lower and upper limit in rad or m; infinite without limits."""
        return -math.inf if self.lower is None else self.lower, math.inf if self.upper is None else self.upper

    @property
    def most_effort(self) -> float:
        """Effort limit, N m or N; infinite without a limit."""
        return math.inf if self.effort is None else self.effort

    @property
    def moves(self) -> bool:
        """Whether the joint has one degree of freedom, so that an actuator can drive it."""
        return self.kind in ("revolute", "continuous", "prismatic")


def is_locked(joint: str, locked: Sequence[str]) -> bool:
    """Whether one of the names is the joint's name; `*` in a name stands for any text."""
    return any(fnmatchcase(joint, name) for name in locked)


@dataclass(frozen=True, kw_only=True)
class Robot:
    """Robot as described in its file. `asrsim.robot.load_robot` returns robots without faults."""

    name: str
    path: Path
    text: str = field(repr=False)
    """Text of the URDF for the log; for xacro, the expanded text. Engines receive the data instead."""
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    actuators: tuple[ActuatorBlock, ...]
    findings: tuple[Problem, ...] = ()
    """Warnings of the reader about the text of the file; `asrsim.robot.doubts.warnings_of` adds the warnings about the
    values."""
    faults: tuple[Problem, ...] = ()
    """Errors of the file. In this robot, parts with an error have default values or are missing."""
    contact_words: tuple[str, ...] = ()
    """Elements of the file that act only in contacts; asrsim does not read them."""
    locked: tuple[str, ...] = ()
    """Names of the joints that the scenario fixes; `*` stands for any text."""
    loops: tuple[Loop, ...] = ()
    """Closed chains."""
    unread: frozenset[str] = frozenset()
    """Joints whose actuator or mode is unknown, because the file states it wrongly."""

    def joint(self, name: str) -> Joint:
        """Joint with this name. Raises KeyError if no joint has the name."""
        return self._by_name[name]

    @cached_property
    def _by_name(self) -> Mapping[str, Joint]:
        return {joint.name: joint for joint in self.joints}

    @cached_property
    def couplings(self) -> Couplings:
        """Couplings of the moving joints."""
        return couplings_of(self)

    @cached_property
    def followers(self) -> frozenset[str]:
        """Joints that follow another joint: joints that mimic another joint, and the joints of closed chains except their
        masters.
        """
        couplings, moving = self.couplings, self.moving_joints
        return frozenset(joint.name for j, joint in enumerate(moving) if couplings.master[j] != j)

    @property
    def inertials(self) -> tuple[object, ...]:
        """Inertias of links and rotors; robots with equal inertials have equal mass matrices."""
        return self.links, tuple(joint.armature for joint in self.joints)

    @cached_property
    def carried(self) -> Mapping[str, tuple[Joint, ...]]:
        """Child joints of each link, in file order."""
        found: dict[str, tuple[Joint, ...]] = {}
        for joint in self.joints:
            found[joint.parent] = (*found.get(joint.parent, ()), joint)
        return found

    @cached_property
    def outward_joints(self) -> tuple[Joint, ...]:
        """All joints from the root to the tips, branch by branch, parents first."""
        found: list[Joint] = []
        waiting = [*reversed(self.carried.get(self.root.name, ()))]
        while waiting:
            found.append(waiting.pop())
            waiting += reversed(self.carried.get(found[-1].child, ()))
        return tuple(found)

    @property
    def root(self) -> Link:
        """Link that is not the child of any joint."""
        children = {joint.child for joint in self.joints}
        return next(link for link in self.links if link.name not in children)

    @property
    def moving_joints(self) -> tuple[Joint, ...]:
        """Joints with a degree of freedom, in file order."""
        return tuple(joint for joint in self.joints if joint.moves)
