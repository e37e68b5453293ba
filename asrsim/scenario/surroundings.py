"""Keys of a scenario about the surroundings of the robot: wrenches, closures of chains, ground and objects."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from asrsim.document.block import Block, declare, declared_keys
from asrsim.document.kinds import (
    NOT_NEGATIVE,
    NUMBER,
    POSITIVE,
    SHARE,
    Boolean,
    Choice,
    Either,
    File,
    Key,
    ListOf,
    MapOf,
    Null,
)
from asrsim.errors import ScenarioError
from asrsim.robot.meshes import mesh_fault
from asrsim.robot.model import Shape, Vector
from asrsim.samples import TIP, TIP_GOAL
from asrsim.scenario.kinds import JOINT, LINK, ORIGIN, POSITION, RPY, Keys
from asrsim.signals.base import Signal
from asrsim.signals.parse import SIGNAL

_AXES = ListOf(of=Either((Null(), SIGNAL)), names=("x", "y", "z"))
Axes = tuple[Signal | None, Signal | None, Signal | None]


@dataclass(frozen=True, kw_only=True)
class Wrench:
    """Force and torque on a link, given by signals."""

    link: str = declare(LINK, doc="the link on which the wrench acts")
    force: Axes = declare(_AXES, default=(None,) * 3, unit="N", doc="a signal for each axis; `null`: 0", shown="none")
    torque: Axes = declare(_AXES, default=(None,) * 3, unit="N m", doc="a signal for each axis; `null`: 0", shown="none")
    point: Vector = declare(POSITION, default=ORIGIN, unit="m", doc="point at which the force acts, in the link's frame")
    frame: str = declare(Choice(("world", "link")), default="world", doc="frame of force and torque")

    def __post_init__(self) -> None:
        if all(signal is None for signal in (*self.force, *self.torque)):
            raise ScenarioError("a wrench needs a force or a torque", key="force", code="empty-wrench")


_SIZES = {"box": (3, "x, y, z"), "sphere": (1, "radius"), "cylinder": (2, "radius, length"), "mesh": (3, "scale x, y, z")}
_SIZE = Either((POSITIVE, ListOf(of=POSITIVE, minimum=1)))


@dataclass(frozen=True, kw_only=True)
class LoopClosure:
    """Closure of a chain: a point of one link coincides with a point of another link."""

    links: tuple[str, ...] = declare(ListOf(of=LINK, names=("first", "second")), doc="the links that close the chain")
    points: tuple[Vector, ...] = declare(
        ListOf(of=POSITION, names=("first", "second")), unit="m", doc="the points that coincide, in the frames of the links"
    )
    master: str | None = declare(
        Either((Null(), JOINT)),
        default=None,
        shown="the driven joint of the loop, or its first joint",
        doc="the joint that the other joints of the loop follow",
    )


@dataclass(frozen=True, kw_only=True)
class WorldObject:
    """Object in the robot's surroundings."""

    name: str
    shape: str = declare(Choice(tuple(_SIZES)), doc="shape of the object")
    size: tuple[float, ...] = declare(
        _SIZE, default=(), unit="m", doc="box: [x, y, z]; sphere: radius; cylinder: [radius, length]; mesh: scale [x, y, z]"
    )
    mesh: Path | None = declare(File(noun="mesh"), default=None, doc="file of the mesh")
    mass: float = declare(NOT_NEGATIVE, default=0.0, unit="kg", doc="mass; an object with mass 0 does not move")
    inertia: Vector | None = declare(
        ListOf(of=POSITIVE, names=("xx", "yy", "zz")),
        default=None,
        unit="kg m^2",
        doc="principal moments of inertia; default: the moments of the solid shape; required for a mesh that moves. The centre "
        "of mass is the centre of the shape; for a mesh, its origin",
    )
    friction: float = declare(
        NOT_NEGATIVE,
        default=0.5,
        unit="1",
        doc="Coulomb coefficient; the coefficient of a contact is the product of the coefficients of the two bodies",
    )
    position: Vector = declare(POSITION, default=ORIGIN, unit="m", doc="position of the centre")
    rpy: Vector = declare(RPY, default=ORIGIN, unit="rad", doc="orientation")
    colour: tuple[float, float, float, float] = declare(
        ListOf(of=SHARE, names=("red", "green", "blue", "alpha")), default=(0.72, 0.55, 0.35, 1.0), doc="colour in pictures"
    )

    @property
    def solid(self) -> Shape:
        """The object as a shape at the origin of its frame."""
        kind: Any = self.shape
        x, y, z = self.size if kind == "mesh" else (1.0, 1.0, 1.0)
        return Shape(kind=kind, size=self.size, mesh=str(self.mesh), scale=(x, y, z))


def _object(**arguments: Any) -> WorldObject:
    """World object, after checking that shape and size agree. The world sets its name later."""
    shape, size, mesh = arguments["shape"], arguments["size"], arguments["mesh"]
    if isinstance(size, float):
        size = (size,)
    count, names = _SIZES[shape]
    if shape == "mesh":
        size = size or (1.0, 1.0, 1.0)
    if len(size) != count:
        raise ScenarioError(f"the size of a {shape} is [{names}]", key="size", code="size")
    if (shape == "mesh") != (mesh is not None):
        message = "a mesh needs the key 'mesh', its file" if mesh is None else f"a {shape} has no mesh file"
        raise ScenarioError(message, key="mesh", code="mesh")
    if mesh is not None and (fault := mesh_fault(mesh)) is not None:
        raise ScenarioError(f"the mesh {fault}", key="mesh", code="mesh")
    if mesh is not None and arguments["mass"] and arguments["inertia"] is None:
        raise ScenarioError("a mesh with a mass needs its principal moments of inertia", key="inertia", code="mesh")
    return WorldObject(**{**arguments, "size": size, "name": ""})


_OBJECTS = MapOf(of=Block(keys=declared_keys(WorldObject), build=_object, noun="object"), noun="name", star=False)
_GROUND: Block[Keys] = Block(
    keys=(
        Key(name="friction", kind=NOT_NEGATIVE, default=1.0, unit="1", doc="Coulomb coefficient"),
        Key(name="height", kind=NUMBER, default=0.0, unit="m", doc="z of the surface"),
    ),
    build=dict,
    noun="ground",
)


GROUND_SIZE = 100.0
"""Edge length in m of the box that serves as the ground."""


@dataclass(frozen=True, kw_only=True)
class World:
    """Surroundings of the robot: ground and objects."""

    ground: bool = declare(
        Either((_GROUND, Boolean())),
        default=False,
        doc="`true`: a level ground at height 0; or a mapping with friction and height",
    )
    ground_friction: float = 1.0
    ground_height: float = 0.0
    """Height z of the ground's surface, m."""
    objects: tuple[WorldObject, ...] = declare(
        _OBJECTS, default={}, doc="objects in addition to the robot", field_default=tuple
    )

    @property
    def empty(self) -> bool:
        """Whether the world has neither ground nor objects."""
        return not self.solids

    @property
    def solids(self) -> tuple[WorldObject, ...]:
        """The objects, and the ground as a large box if the world has a ground. With a plane, PyBullet's contact forces would
        jump."""
        if not self.ground:
            return self.objects
        at = 0.0, 0.0, self.ground_height - 0.5 * GROUND_SIZE
        size = (GROUND_SIZE,) * 3
        return WorldObject(name="ground", shape="box", size=size, friction=self.ground_friction, position=at), *self.objects


RESERVED = ("ground", "robot", TIP, TIP_GOAL)
"""Names that objects must not have, as logs use them for other bodies."""


def _world(ground: bool | dict[str, Any], objects: dict[str, WorldObject]) -> World:
    for name in RESERVED:
        if name in objects:
            message = f"an object cannot have the name '{name}', which logs use for another body"
            raise ScenarioError(message, key=f"objects.{name}", code="name")
    named = tuple(replace(item, name=name) for name, item in objects.items())
    if isinstance(ground, bool):
        return World(ground=ground, objects=named)
    return World(ground=True, ground_friction=ground["friction"], ground_height=ground["height"], objects=named)


WORLD = Block(keys=declared_keys(World), build=_world, noun="world")
