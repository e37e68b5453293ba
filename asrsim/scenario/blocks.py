"""Kinds and blocks of a scenario's keys, with their data classes: engines, joints, surroundings, goals and claims."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

from asrsim.actuators import ACTUATORS, MODES
from asrsim.document.block import Block, block_of, declare, declared_keys
from asrsim.document.kinds import (
    NOT_NEGATIVE,
    NUMBER,
    POSITIVE,
    SHARE,
    Boolean,
    Choice,
    Either,
    File,
    Integer,
    Key,
    Kind,
    ListOf,
    MapOf,
    Null,
    Number,
    Schema,
    Text,
)
from asrsim.document.node import Node
from asrsim.document.reading import DocumentReading, KeyPath, Rejected
from asrsim.document.yaml_reader import read_yaml
from asrsim.errors import InputError, ScenarioError
from asrsim.quantities import DERIVED, QUANTITIES
from asrsim.registry.engines import ENGINES
from asrsim.registry.steppings import stepping_called
from asrsim.robot.meshes import mesh_fault
from asrsim.robot.model import Shape
from asrsim.samples import TIP, TIP_GOAL
from asrsim.signals.base import Signal
from asrsim.signals.parse import SIGNAL

# -- kinds -------------------------------------------------------------------------------------------------------------

Vector = tuple[float, float, float]
Keys = dict[str, Any]
"""Value of a block from which no object is built: a plain mapping of its keys."""

POSITION = ListOf(of=NUMBER, names=("x", "y", "z"))
RPY = ListOf(of=NUMBER, names=("roll", "pitch", "yaw"))
SIGNALS_BY_JOINT = MapOf(of=SIGNAL)
JOINT = Text(text="name of a joint")
LINK = Text(text="name of a link")
ORIGIN = (0.0, 0.0, 0.0)
"""Default of positions (m) and orientations (rad)."""


def names_a_folder(name: str) -> bool:
    """Whether a name is valid for a folder, as scenarios and variants give their names to the folders of results."""
    good = bool(name.strip()) and name not in (".", "..") and len(name.encode(errors="replace")) <= 255
    return good and all(sign.isprintable() and sign not in "/\\" for sign in name)


class FolderName(Text):
    """Kind of value: text that is valid as the name of a folder."""

    def read(self, node: Node, path: KeyPath, reading: DocumentReading) -> str:
        name = super().read(node, path, reading)
        if not names_a_folder(name):
            raise reading.fault(node, path, "must be valid as the name of a folder", code="name")
        return name


MAX_DEPTH = 4
"""Deepest level of a manager file that is searched for the list of joints."""


class ManagerFile(File):
    """Kind of value: a manager file, from which order of joints and namespace are read. Other keys have no effect.

    The parameters may be under the name of a node (`/**: ros__parameters:`).
    """

    def read(self, node: Node, path: KeyPath, reading: DocumentReading) -> Any:
        try:
            root, _ = read_yaml(super().read(node, path, reading))
        except InputError as error:
            reading.problems.extend(error.problems)
            raise Rejected from None
        table = _find(root, MAX_DEPTH)
        names = table["joints_name"] if table else root
        joints = tuple(str(item.value).strip() for item in names.value) if isinstance(names.value, list) else ()
        if not table or not joints:
            raise reading.fault(names, path, "the manager file has no list 'joints_name'", code="manager", show=False)
        twice = [joint for joint in joints if joints.count(joint) > 1]
        if twice:
            message = f"'joints_name' lists joint '{twice[0]}' twice"
            raise reading.fault(names, path, message, code="manager", show=False)
        space = table["namespace"].value if "namespace" in table else None
        return {"joint_order": joints, "namespace": str(space or "").strip().strip("/") or None}


def _find(node: Node, depth: int) -> dict[str, Node] | None:
    """Mapping that contains the list of joints; None if it is missing."""
    if not isinstance(node.value, dict) or depth == 0:
        return None
    if "joints_name" in node.value:
        return node.value
    return next((found for item in node.value.values() if (found := _find(item, depth - 1)) is not None), None)


def prescribes_motion(engine: str) -> bool:
    """Whether the engine prescribes the motion of the links by the key `motion`."""
    return ENGINES.get(engine).prescribed


def released_order(stepping: str) -> bool:
    """Whether the stepping is that of the released toolbox, with its motors and its order of updates."""
    return stepping_called(stepping).released


# -- joints ------------------------------------------------------------------------------------------------------------

MODE = Integer(minimum=0, maximum=max(MODES))
_INFINITE = ("inf", "+inf", "-inf", math.inf, -math.inf)


class ParameterNumber(Number):
    """Kind of value: a number, also an infinite one, such as a torque without limit."""

    def read(self, node: Node, path: KeyPath, reading: DocumentReading) -> float:
        return float(str(node.value)) if node.value in _INFINITE else super().read(node, path, reading)

    def schema(self) -> Schema:
        return {"anyOf": [super().schema(), {"enum": list(_INFINITE[:3])}]}


PARAMETERS = MapOf(of=ParameterNumber(), noun="parameter", star=False)


@dataclass(frozen=True, kw_only=True)
class Effects:
    """Imperfections between a controller and the joint; all off by default."""

    delay: float = declare(NOT_NEGATIVE, default=0.0, unit="s", doc="dead time")
    rate: float | None = declare(
        Number(above=0.0, maximum=1e6),
        default=None,
        unit="Hz",
        doc="values are held between ticks of this rate",
        shown="continuous",
    )
    quantum: float = declare(NOT_NEGATIVE, default=0.0, unit="signal's", doc="step of quantisation")
    noise: float = declare(
        NOT_NEGATIVE, default=0.0, unit="signal's",
        doc="standard deviation of Gaussian noise, a new draw each tick (or step), by the scenario's seed",
    )  # fmt: skip

    @property
    def active(self) -> bool:
        """Whether any imperfection is set."""
        return bool(self.delay or self.rate or self.quantum or self.noise)


@dataclass(frozen=True, kw_only=True)
class LinkDamping:
    """Link damping as a function of the stiffness: c(k) = constant + ratio * 2 sqrt(inertia * k), off by default."""

    constant: float = declare(NOT_NEGATIVE, default=0.0, unit="N m s/rad", doc="damping in addition to the URDF's")
    ratio: float = declare(NOT_NEGATIVE, default=0.0, unit="1", doc="damping ratio at `inertia` and the present stiffness")
    inertia: float = declare(NOT_NEGATIVE, default=0.0, unit="kg m^2", doc="inertia for which `ratio` is defined")


@dataclass(frozen=True, kw_only=True)
class GivenActuator:
    """Actuator that the scenario puts on a joint, in place of the actuator in the robot file, if any."""

    type: str = declare(
        Choice(lambda: ACTUATORS, "name of an actuator", missing="Your own actuators need --plugin FILE"),
        doc="the actuator's type; `asrsim actuators` lists all types",
    )
    mode: int = declare(MODE, default=6, doc="operation mode")
    parameters: Mapping[str, float] = declare(PARAMETERS, default={}, doc="by name or the toolbox's tag; others by default")


EFFECTS_BY_JOINT = MapOf(of=block_of(Effects, "effects"))


class Range(ListOf[float]):
    """Kind of value: two numbers, the smaller one first."""

    def read(self, node: Node, path: KeyPath, reading: DocumentReading) -> tuple[float, ...]:
        found = super().read(node, path, reading)
        if found[0] > found[1]:
            raise reading.fault(node, path, "the first value must not exceed the second", code="range")
        return found


_MOTORS = ListOf(of=NUMBER, minimum=1)
START: Block[Keys] = Block(
    keys=(
        Key(name="position", kind=NUMBER, default=None, unit="rad", doc="of the link", shown="0"),
        Key(name="velocity", kind=NUMBER, default=None, unit="rad/s", doc="of the link", shown="0"),
        Key(
            name="motor_positions", kind=_MOTORS, default=None, unit="rad", doc="of each motor, link side",
            shown="the link's, springs undeflected",
        ),
        Key(
            name="motor_velocities", kind=_MOTORS, default=None, unit="rad/s", doc="of each motor, link side",
            shown="at rest",
        ),
    ),
    build=dict,
    noun="state",
    main="position",
)  # fmt: skip
EQUILIBRIUM = "equilibrium"


class StartTables(Either):
    """Kind of value: the start of the joints, read into four tables and a flag of the scenario."""

    def read(self, node: Node, path: KeyPath, reading: DocumentReading) -> Mapping[str, Any]:
        states = super().read(node, path, reading)
        if states == EQUILIBRIUM:
            return {"initial_equilibrium": True}
        names = {"position": "positions", "velocity": "velocities"}
        tables: dict[str, dict[str, Any]] = {f"initial_{names.get(name, name)}": {} for name in START.names}
        for joint, state in states.items():
            for value, table in zip(state.values(), tables.values(), strict=True):
                if value is not None:
                    table[joint] = value
        return tables


_AT_REST = Choice((EQUILIBRIUM,), missing="A mapping from joint to state is valid too")
INITIAL = StartTables((_AT_REST, MapOf(of=START)))


# -- surroundings ------------------------------------------------------------------------------------------------------

_AXES = ListOf(of=Either((Null(), SIGNAL)), names=("x", "y", "z"))
Axes = tuple[Signal | None, Signal | None, Signal | None]


@dataclass(frozen=True, kw_only=True)
class Wrench:
    """Force and torque on a link, given by signals."""

    link: str = declare(LINK, doc="the link on which the wrench acts")
    force: Axes = declare(_AXES, default=(None,) * 3, unit="N", doc="a signal an axis, `null` for none", shown="none")
    torque: Axes = declare(_AXES, default=(None,) * 3, unit="N m", doc="a signal an axis, `null` for none", shown="none")
    point: Vector = declare(POSITION, default=ORIGIN, unit="m", doc="where the force acts, in the link's frame")
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
        Either((Null(), JOINT)), default=None, shown="its driven joint, or the first",
        doc="the joint that the other joints of the loop follow",
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class WorldObject:
    """Object in the robot's surroundings."""

    name: str
    shape: str = declare(Choice(tuple(_SIZES)), doc="its shape")
    size: tuple[float, ...] = declare(
        _SIZE, default=(), unit="m", doc="box: [x, y, z]; sphere: radius; cylinder: [radius, length]; mesh: scale [x, y, z]"
    )
    mesh: Path | None = declare(File(noun="mesh"), default=None, doc="mesh: its file")
    mass: float = declare(NOT_NEGATIVE, default=0.0, unit="kg", doc="0: it does not move")
    inertia: Vector | None = declare(
        ListOf(of=POSITIVE, names=("xx", "yy", "zz")), default=None, unit="kg m^2",
        doc="principal moments; default: those of the solid shape; a mesh that moves needs them; the centre of mass is the "
        "shape's middle, of a mesh its origin",
    )  # fmt: skip
    friction: float = declare(
        NOT_NEGATIVE, default=0.5, unit="1", doc="Coulomb coefficient; a contact's is the product of both bodies'"
    )
    position: Vector = declare(POSITION, default=ORIGIN, unit="m", doc="position of the centre")
    rpy: Vector = declare(RPY, default=ORIGIN, unit="rad", doc="orientation")
    colour: tuple[float, float, float, float] = declare(
        ListOf(of=SHARE, names=("red", "green", "blue", "alpha")), default=(0.72, 0.55, 0.35, 1.0),
        doc="for pictures",
    )  # fmt: skip

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
        Either((_GROUND, Boolean())), default=False,
        doc="a level ground at height 0, or one with friction and height",
    )  # fmt: skip
    ground_friction: float = 1.0
    ground_height: float = 0.0
    """Height z of the ground's surface, m."""
    objects: tuple[WorldObject, ...] = declare(_OBJECTS, default={}, doc="bodies beside the robot", field_default=tuple)

    @property
    def empty(self) -> bool:
        """Whether the world has neither ground nor objects to collide with."""
        return not self.solids

    @property
    def solids(self) -> tuple[WorldObject, ...]:
        """The ground, if there is one, as a large box, and the objects. With a plane, PyBullet's contact forces would jump."""
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


# -- goals -------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class CartesianPose:
    """Waypoint of a Cartesian task."""

    time: float = declare(NOT_NEGATIVE, unit="s", doc="time at which the pose is reached")
    position: Vector = declare(POSITION, unit="m", doc="position in the world's frame")
    rpy: Vector | None = declare(RPY, default=None, unit="rad", doc="orientation", shown="free")


@dataclass(frozen=True, kw_only=True)
class CartesianTask:
    """Path of a point on a link, from which closed-loop inverse kinematics computes equilibrium references."""

    link: str = declare(LINK, doc="the link that moves along the path")
    poses: tuple[CartesianPose, ...] = declare(
        ListOf(of=block_of(CartesianPose, "pose"), minimum=1), doc="the path, in ascending time"
    )
    point: Vector = declare(POSITION, default=ORIGIN, unit="m", doc="the point on the path, in the link's frame")
    joints: tuple[str, ...] = declare(
        ListOf(of=JOINT), default=(), doc="joints that move",
        shown="all actuated ones between base and link",
    )  # fmt: skip
    gain: float = declare(POSITIVE, default=10.0, unit="1/s", doc="gain of the closed loop")
    damping: float = declare(POSITIVE, default=1e-3, unit="m", doc="damping of the least squares")
    interpolation: str = declare(Choice(("minimum_jerk", "linear")), default="minimum_jerk", doc="between the poses")
    gravity_compensation: bool = declare(
        Boolean(), default=False, doc="add the springs' deflection under gravity to the equilibrium"
    )
    motor_droop: bool = declare(Boolean(), default=False, doc="compensate the motors' steady-state error under load too")
    preset: Mapping[str, float] = declare(
        MapOf(of=NUMBER, bare=True), default={}, unit="rad",
        doc="stiffness preset of the joints, where `references` give none",
    )  # fmt: skip
    tolerance: float = declare(
        POSITIVE, default=1e-3, unit="m", doc="largest distance from the path; beyond, the path is unreachable"
    )

    def __post_init__(self) -> None:
        for before, after in pairwise(pose.time for pose in self.poses):
            if after <= before:
                message = f"times must ascend, but {after:g} follows {before:g}"
                raise ScenarioError(message, key="poses", code="order")
        if len({pose.rpy is None for pose in self.poses}) > 1:
            message = "either all poses have an orientation (rpy) or none"
            raise ScenarioError(message, key="poses", code="mixed-orientation")


LawName = Literal["auto", "paper"]
FirstGuess = Literal["zero", "reference", "inverse_dynamics"]


@dataclass(frozen=True, kw_only=True)
class Filter:
    """Zero-phase filter for the learned input."""

    cutoff: float = declare(POSITIVE, unit="Hz", doc="frequency above which nothing is learned")
    order: int = declare(Integer(minimum=1, maximum=8), default=2, doc="order of the Butterworth filter")


@dataclass(frozen=True, kw_only=True)
class Learning:
    """Settings of iterative learning control: trajectory, law, stopping criteria."""

    trajectory: Mapping[str, Signal] = declare(SIGNALS_BY_JOINT, unit="rad", doc="desired link positions")
    law: LawName = declare(
        Choice(("auto", "paper")), default="auto",
        doc="auto: norm-optimal, needs no tuning; paper: equation 13 with fixed gains",
    )  # fmt: skip
    gain: float = declare(POSITIVE, default=0.5, unit="1", doc="K of K exp(-n / gain_decay), the weight of the last error")
    gain_decay: float | None = declare(
        Either((Null("none"), POSITIVE)), default=10.0, unit="iterations", doc="decay of the gain; `none`: it is constant"
    )
    joint_gains: Mapping[str, float] = declare(
        MapOf(of=POSITIVE, star=False), default={}, unit="1", doc="gains that replace `gain`"
    )
    filter: Filter | None = declare(
        block_of(Filter, "zero-phase filter"), default=None, doc="zero-phase filter on what is learned", shown="none"
    )
    first_guess: FirstGuess | None = declare(
        Choice(("zero", "reference", "inverse_dynamics")), default=None,
        doc="first input: zero, the trajectory, or inverse dynamics through the springs",
        shown="law auto: inverse_dynamics; else zero",
    )  # fmt: skip
    tolerance: float = declare(POSITIVE, unit="rad", doc="stop when the largest error of every joint is within it")
    max_iterations: int = declare(Integer(minimum=1, maximum=100_000), default=50, doc="stop after so many")
    patience: int = declare(
        Integer(minimum=1), default=3,
        doc="stop when the error has grown, or there was no progress, for so many iterations in a row",
    )  # fmt: skip


COMPARISONS = ("==", "<", "<=", ">", ">=")


class AnyData(Kind[Any]):
    """Kind of value: plain data that another module validates."""

    text = "anything"

    def read(self, node: Node, path: KeyPath, reading: DocumentReading) -> Any:
        return node.plain()

    def schema(self) -> Schema:
        return {}


@dataclass(frozen=True, kw_only=True)
class Expectation:
    """Claim about a run: a comparison of a measure of a joint's quantity with a value."""

    joint: str | None = declare(JOINT, default=None, doc="the joint (or give `body`)")
    body: str | None = declare(Text(text="name of an object"), default=None, doc="an object of the world")
    quantity: str = declare(Text(text="name of a quantity"), doc="the quantity, such as link_position")
    measure: str = declare(Text(text="name of a measure"), doc="the measure, such as steady_state, overshoot, maximum, rmse")
    comparison: str = declare(Choice(COMPARISONS), default="==", doc="the comparison; `==` within the tolerance")
    value: float = declare(NUMBER, unit="measure's", doc="the number to compare with")
    tolerance: float = declare(NOT_NEGATIVE, default=0.0, unit="measure's", doc="largest difference under `==`")
    variant: str | None = declare(Text(text="name of a variant"), default=None, doc="the variant of the claim", shown="all")
    engine: str | None = declare(
        Choice(ENGINES.names),
        default=None,
        doc="the engine of the claim, as engines differ in accuracy",
        shown="all",
    )
    reference: str | None = declare(
        Text(text="name of a quantity"), default=None, shown="the joint's own",
        doc="another quantity of the same joint to compare with, for measures of two series",
    )  # fmt: skip
    against: Path | None = declare(
        File(noun="recording", folder=True, beside=".yaml"), default=None,
        doc="a recording to compare with, for measures of a difference",
    )  # fmt: skip
    options: Mapping[str, Any] = declare(MapOf(of=AnyData(), noun="option", star=False), default={}, doc="of the measure")
    line: int | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        if (self.joint is None) == (self.body is None):
            raise ScenarioError("needs the key joint or body", key="", code="expect")
        known = (*QUANTITIES, *DERIVED)
        for key, name in (("quantity", self.quantity), ("reference", self.reference)):
            if self.joint is not None and name is not None and name not in known:
                raise ScenarioError("no such quantity", key=key, choices=known, meant=name, code="unknown-quantity")
        if self.reference is not None and (self.body is not None or self.against is not None):
            raise ScenarioError("needs the key joint, and excludes the key `against`", key="reference", code="expect")
