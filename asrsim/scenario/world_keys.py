"""Keys of what surrounds the robot: wrenches, objects, ground."""

from __future__ import annotations

from typing import Any

from asrsim.document.block import Block, Key
from asrsim.document.composite import Either, ListOf, MapOf, is_list, is_mapping, is_scalar
from asrsim.document.kinds import Boolean, Choice, File, Optional, Text
from asrsim.errors import Problem, ScenarioError
from asrsim.robot.meshes import mesh_fault
from asrsim.scenario.data import World, WorldObject, Wrench
from asrsim.scenario.kinds import NOT_NEGATIVE, NUMBER, ORIGIN, POSITION, POSITIVE, RPY, SHARE, Keys
from asrsim.signals.parse import SIGNAL

_AXES = ListOf(of=Optional(SIGNAL), length=3, names=("x", "y", "z"))


def _wrench(**arguments: Any) -> Wrench:
    if all(signal is None for signal in (*arguments["force"], *arguments["torque"])):
        raise ScenarioError(Problem(message="a wrench needs a force or a torque", key="force", code="empty-wrench"))
    return Wrench(**arguments)


WRENCH = Block(
    keys=(
        Key(name="link", kind=Text(noun="name of a link"), doc="the link it acts on"),
        Key(name="force", kind=_AXES, default=(None,) * 3, unit="N", doc="a signal an axis, `null` for none", shown="none"),
        Key(name="torque", kind=_AXES, default=(None,) * 3, unit="N m", doc="a signal an axis, `null` for none", shown="none"),
        Key(name="point", kind=POSITION, default=ORIGIN, unit="m", doc="where the force acts, in the link's frame"),
        Key(name="frame", kind=Choice(("world", "link")), default="world", doc="frame of force and torque"),
    ),
    build=_wrench,
    noun="wrench",
)

_SIZES = {"box": (3, "x, y, z"), "sphere": (1, "radius"), "cylinder": (2, "radius, length"), "mesh": (3, "scale x, y, z")}
_SIZE = Either(((is_scalar, POSITIVE), (is_list, ListOf(of=POSITIVE, minimum=1))))


def _object(**arguments: Any) -> WorldObject:
    """A world object whose shape and size agree; its name is filled in by the world."""
    shape, size, mesh = arguments["shape"], arguments["size"], arguments["mesh"]
    if isinstance(size, float):
        size = (size,)
    count, names = _SIZES[shape]
    if shape == "mesh":
        size = size or (1.0, 1.0, 1.0)
    if len(size) != count:
        raise ScenarioError(Problem(message=f"the size of a {shape} is [{names}]", key="size", code="size"))
    if (shape == "mesh") != (mesh is not None):
        message = "a mesh needs the key 'mesh', its file" if mesh is None else f"a {shape} has no mesh file"
        raise ScenarioError(Problem(message=message, key="mesh", code="mesh"))
    if mesh is not None and (fault := mesh_fault(mesh)) is not None:
        raise ScenarioError(Problem(message=f"the mesh {fault}", key="mesh", code="mesh"))
    return WorldObject(**{**arguments, "size": size, "name": ""})


OBJECT = Block(
    keys=(
        Key(name="shape", kind=Choice(tuple(_SIZES)), doc="its shape"),
        Key(
            name="size", kind=_SIZE, default=(), unit="m",
            doc="box: [x, y, z]; sphere: radius; cylinder: [radius, length]; mesh: scale [x, y, z]",
        ),
        Key(name="mesh", kind=Optional(File(noun="mesh")), default=None, doc="mesh: its file"),
        Key(name="mass", kind=NOT_NEGATIVE, default=0.0, unit="kg", doc="0: it does not move"),
        Key(
            name="inertia", kind=Optional(ListOf(of=POSITIVE, length=3, names=("xx", "yy", "zz"))), default=None,
            unit="kg m^2", doc="principal moments; default: those of the solid shape",
        ),
        Key(
            name="friction", kind=NOT_NEGATIVE, default=0.5, unit="1",
            doc="Coulomb coefficient; a contact's is the product of both bodies'",
        ),
        Key(name="restitution", kind=SHARE, default=0.0, unit="1", doc="0: no bounce, 1: elastic"),
        Key(name="position", kind=POSITION, default=ORIGIN, unit="m", doc="of its centre"),
        Key(name="rpy", kind=RPY, default=ORIGIN, unit="rad", doc="orientation"),
        Key(
            name="colour", kind=ListOf(of=SHARE, length=4, names=("red", "green", "blue", "alpha")),
            default=(0.72, 0.55, 0.35, 1.0), doc="for pictures",
        ),
    ),
    build=_object,
    noun="object",
)  # fmt: skip

GROUND: Block[Keys] = Block(
    keys=(
        Key(name="friction", kind=NOT_NEGATIVE, default=1.0, unit="1", doc="Coulomb coefficient"),
        Key(name="height", kind=NUMBER, default=0.0, unit="m", doc="z of the surface"),
    ),
    build=dict,
    noun="ground",
)


RESERVED = ("ground", "robot")
"""Names that contacts have for what is no object."""


def _world(ground: bool | dict[str, float], objects: dict[str, WorldObject]) -> World:
    from dataclasses import replace

    for name in RESERVED:
        if name in objects:
            raise ScenarioError(
                Problem(
                    message=f"an object cannot be called '{name}': contacts are named so", key=f"objects.{name}", code="name"
                )
            )
    surface = ground if isinstance(ground, dict) else {"friction": 1.0, "height": 0.0}
    return World(
        ground=ground is not False,
        ground_friction=surface["friction"],
        ground_height=surface["height"],
        objects=tuple(replace(item, name=name) for name, item in objects.items()),
    )


WORLD = Block(
    keys=(
        Key(
            name="ground", kind=Either(((is_mapping, GROUND), (is_scalar, Boolean()))), default=False,
            doc="a level ground at height 0, or one with friction and height",
        ),
        Key(name="objects", kind=MapOf(of=OBJECT, noun="name", star=False), default={}, doc="bodies beside the robot"),
    ),
    build=_world,
    noun="world",
)  # fmt: skip
