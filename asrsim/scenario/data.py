"""Data class of a scenario: one resolved and valid variant. Each field declares the key that it is read from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar, overload

from asrsim.document.block import Block, block_of, declare, declared_keys
from asrsim.document.kinds import (
    NOT_NEGATIVE,
    NUMBER,
    POSITIVE,
    REQUIRED,
    Boolean,
    Choice,
    Either,
    Entry,
    File,
    Integer,
    Key,
    ListOf,
    MapOf,
    Null,
    Schema,
    Text,
)
from asrsim.document.reading import KeyPath
from asrsim.errors import Problem
from asrsim.registry.engines import ENGINES, default_engine
from asrsim.registry.steppings import OWN_STEPPINGS, STEPPINGS
from asrsim.robot.model import Vector
from asrsim.samples import Array, grid
from asrsim.scenario.expectation import Expectation
from asrsim.scenario.goals import CartesianPose, CartesianTask, Learning
from asrsim.scenario.joints import (
    IMPERFECTIONS_BY_JOINT,
    INITIAL,
    MODE,
    PARAMETERS,
    GivenActuator,
    Imperfections,
    LinkDamping,
    RangeOf,
)
from asrsim.scenario.kinds import LINK, ORIGIN, POSITION, RPY, SIGNALS_BY_JOINT, AnyData, FolderName, Keys
from asrsim.scenario.manager import ManagerFile
from asrsim.scenario.surroundings import WORLD, LoopClosure, World, WorldObject, Wrench
from asrsim.signals.base import Signal
from asrsim.signals.parse import SIGNAL

__all__ = [
    "CartesianPose",
    "CartesianTask",
    "Expectation",
    "GivenActuator",
    "Imperfections",
    "Learning",
    "LinkDamping",
    "Scenario",
    "Vector",
    "World",
    "WorldObject",
    "Wrench",
    "for_joint",
]

T = TypeVar("T")
_COUNT = Either((Null("auto"), Integer(minimum=1)))


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """One resolved variant of a scenario, with all that a run needs. Keys of mappings are names of joints, or `"*"` for all
    joints."""

    name: str = declare(FolderName(), default=None, doc="name of the scenario", shown="the file's name", field_default=REQUIRED)
    variant: str = declare(
        FolderName(),
        default=None,
        doc="name of this variant, in a file without variants",
        shown="default",
        field_default="default",
    )
    robot: Path = declare(File(noun="robot (URDF or xacro)", attach=False), key="robot.file", doc="URDF or xacro file")
    xacro_arguments: Mapping[str, str] = declare(
        MapOf(of=Text(), noun="argument", star=False), key="robot.arguments", default={}, doc="xacro arguments"
    )
    package_paths: Mapping[str, Path] = declare(
        MapOf(of=File(noun="folder", attach=False, exists=False), noun="package", star=False),
        key="robot.packages",
        default={},
        doc="folders of `package://` names",
    )
    locked: tuple[str, ...] = declare(
        ListOf(of=Text()),
        default=(),
        doc="joints that are fixed at 0, even if they move in the robot file; `*` stands for any text: `[gripper_*]`",
    )
    base_position: Vector = declare(
        POSITION, key="base.position", default=ORIGIN, unit="m", doc="position of the robot's root in the world"
    )
    base_rpy: Vector = declare(RPY, key="base.rpy", default=ORIGIN, unit="rad", doc="orientation of the robot's root")
    fixed_base: bool = declare(Boolean(), key="base.fixed", default=True, doc="false: the robot floats")
    gravity: Vector = declare(POSITION, default=(0.0, 0.0, -9.81), unit="m/s^2", doc="gravity in the world's frame")
    actuators: Mapping[str, GivenActuator] = declare(
        MapOf(of=block_of(GivenActuator, "mapping that describes an actuator", main="type"), bare=True),
        default={},
        doc="actuators of joints, in place of the actuators in the robot file",
        shown="the actuators of the robot file",
    )
    modes: Mapping[str, int] = declare(
        MapOf(of=MODE, bare=True),
        default={},
        doc="operation modes that replace the modes in the URDF, for all joints or for single joints",
    )
    parameters: Mapping[str, Mapping[str, float]] = declare(
        MapOf(of=PARAMETERS),
        default={},
        doc="actuator parameters that replace the parameters in the URDF, by name in asrsim or by tag of the toolbox",
    )
    armature: Mapping[str, float] = declare(
        MapOf(of=NOT_NEGATIVE, bare=True),
        default={},
        unit="kg m^2",
        shown="from the robot file, except behind springs",
        doc="inertia of rotors that move with the link, reflected to the joint: rotor inertia times the square of the gear "
        "ratio",
    )
    weightless: tuple[str, ...] = declare(
        ListOf(of=LINK), default=(), doc="links on which gravity does not act, as if they were supported"
    )
    loops: tuple[LoopClosure, ...] = declare(
        ListOf(of=block_of(LoopClosure, "loop")),
        default=(),
        doc="closed chains of one degree of freedom, such as four-bar fingers, in addition to the chains of the robot file; a "
        "chain between the same links replaces the chain in the file",
    )
    initial_positions: Mapping[str, float] = declare(
        INITIAL,
        key="initial",
        spread=True,
        default={},
        unit="rad",
        doc="initial link positions, or initial states of joints. By default, motors start at the position of their link, so "
        "springs are undeflected and a loaded link first sags. `equilibrium`: the robot starts at rest under the first "
        "references, with loaded springs",
        shown="0",
    )
    initial_velocities: Mapping[str, float] = field(default_factory=dict)
    """Initial velocities of links, rad/s."""
    initial_motor_positions: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    """Initial positions of the motors, rad; by default they follow from the link's position, with undeflected springs."""
    initial_motor_velocities: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    """Initial velocities of the motors, rad/s; 0 by default."""
    initial_equilibrium: bool = False
    """True: the run starts at static equilibrium, with loaded springs and motors at the first references and presets."""
    duration: float = declare(POSITIVE, unit="s", doc="simulated time, a whole number of steps", field_default=1.0)
    step: float = declare(POSITIVE, default=1e-3, unit="s", doc="time step of the simulation")
    log_every: int = declare(
        POSITIVE,
        key="log_rate",
        default=None,
        unit="Hz",
        field_default=1,
        shown="every step",
        doc="logged samples per second; 1/step must be a multiple",
    )
    """Number of steps between logged samples."""
    log_layout: str = declare(
        Choice(("full", "compact")),
        key="log",
        default="full",
        doc="full: the toolbox's topics; compact: one message for each joint and `/joint_states`",
    )
    tf_rate: float = declare(
        NOT_NEGATIVE, default=30.0, unit="Hz", doc="largest rate of the links' frames on `/tf` in the log; 0: no frames"
    )
    seed: int = declare(Integer(minimum=0), default=0, doc="seed of all noise")
    engine: str = declare(
        Either((Null("auto"), Entry(ENGINES))),
        default=None,
        shown="auto",
        field_default=default_engine,
        doc="physics engine that moves the links; `auto`: bullet if it is installed; bench: the motion of the links is "
        "prescribed",
    )
    stepping: str = declare(
        Choice(lambda: tuple(STEPPINGS), missing=OWN_STEPPINGS),
        default="leapfrog",
        doc="leapfrog (second order), euler (first order), or toolbox (the order of computations in the released toolbox)",
    )
    substeps: int | None = declare(_COUNT, default=None, doc="substeps of the links in each step", shown="auto")
    motor_substeps: int | None = declare(
        _COUNT, default=None, doc="substeps of motors and springs in each substep of the links", shown="auto"
    )
    max_substeps: int = declare(
        Integer(minimum=1),
        default=100,
        doc="largest number of substeps of the links in each step; a spring that needs more substeps is an error",
    )
    compiled: bool | None = declare(
        Either((Null("auto"), Boolean())),
        default=None,
        doc="whether the loop of a run is compiled to machine code",
        shown="auto",
    )
    velocity_cutoff: bool | None = declare(
        Either((Null("auto"), Boolean())),
        key="velocity_limit_cutoff",
        default=None,
        shown="auto",
        doc="whether a torque that accelerates a joint beyond its velocity limit is set to 0, as in Gazebo; `auto`: only in "
        "toolbox stepping",
    )
    motion: Mapping[str, Signal] = declare(
        SIGNALS_BY_JOINT,
        default={},
        unit="rad",
        shown="locked",
        doc="only with `engine: bench`: the prescribed link positions, for example a `playback` signal that reads a CSV file",
    )
    """Prescribed link positions; joints without an entry are locked."""
    joint_order: tuple[str, ...] = declare(
        ManagerFile(noun="manager YAML"),
        key="manager",
        spread=True,
        default=None,
        field_default=(),
        doc="the toolbox's manager file: order of the joints in robot-level arrays, and namespace",
    )
    """Order of the joints in arrays for the whole robot; empty: order of the URDF."""
    namespace: str | None = None
    """Namespace from the manager file, which replaces the namespace in the actuator blocks."""
    references: Mapping[str, Mapping[str, Signal]] = declare(
        MapOf(of=MapOf(of=SIGNAL, noun="reference", star=False)),
        default={},
        doc="references of the actuators; their names follow from the mode; a missing reference keeps its initial value",
    )
    inverse_dynamics: Mapping[str, bool] = declare(
        MapOf(of=Boolean(), bare=True),
        default={},
        doc="true: the joint's first reference is a desired motion of the link, for which the input is computed",
    )
    desired: Mapping[str, Signal] = declare(
        SIGNALS_BY_JOINT,
        default={},
        unit="rad",
        shown="the reference",
        doc="desired motion of the link if it differs from the reference (a learned input); the summary's errors refer to it",
    )
    reference_ranges: Mapping[str, Mapping[str, tuple[float, float]]] = declare(
        MapOf(of=MapOf(of=RangeOf(of=NUMBER, names=("least", "largest")), noun="reference", star=False)),
        default={},
        doc="[smallest, largest] value of references, or of `external_torque`, that are set from outside during the run "
        "(`asrsim live`, the library): other values are clamped, and the number of substeps is chosen for this range",
        shown="in live runs: the limits of the robot",
    )
    external_torques: Mapping[str, Signal] = declare(
        SIGNALS_BY_JOINT, default={}, unit="N m", doc="external torques on the links, about the joints"
    )
    wrenches: tuple[Wrench, ...] = declare(
        ListOf(of=block_of(Wrench, "load on a link")), default=(), doc="forces and torques on links"
    )
    command_imperfections: Mapping[str, Imperfections] = declare(
        IMPERFECTIONS_BY_JOINT,
        key="imperfections.commands",
        default={},
        doc="imperfections of the scenario's references; references that are set from outside (live runs, views, environments, "
        "the library) act as they were sent",
    )
    sensor_imperfections: Mapping[str, Imperfections] = declare(
        IMPERFECTIONS_BY_JOINT,
        key="imperfections.sensors",
        default={},
        doc="imperfections of the sensors that the PID controllers read. Positions have all of them; velocities, on which the "
        "derivative action acts, are delayed and held, but have neither noise nor quantisation",
    )
    link_damping: Mapping[str, LinkDamping] = declare(
        MapOf(of=block_of(LinkDamping, "damping law")),
        default={},
        doc="link damping of joints with actuators, which changes with the stiffness",
    )
    world: World = declare(WORLD, default=World(), doc="ground and objects", shown="empty", field_default=World)
    task: CartesianTask | None = declare(
        block_of(CartesianTask, "Cartesian task"), default=None, doc="a Cartesian path for computed references"
    )
    learning: Learning | None = declare(
        block_of(Learning, "learning"), key="ilc", default=None, doc="iterative learning control, for `asrsim ilc`"
    )
    expect: tuple[Expectation, ...] = declare(
        ListOf(of=block_of(Expectation, "claim")), default=(), doc="claims that the run must meet"
    )
    path: Path | None = None
    text: str = field(default="", repr=False)
    """Text of the file, with all variants."""
    attachments: Mapping[str, Path] = field(default_factory=dict)
    """Short name -> file that the scenario names (playbacks, manager file); the log attaches these files."""
    resolved: Mapping[str, Any] = field(default_factory=dict, repr=False)
    """This variant with overrides as plain JSON values; parsing them gives this scenario."""
    unread: tuple[KeyPath, ...] = ()
    """Paths of the invalid keys that `read_scenarios` left out."""
    named: tuple[tuple[KeyPath, str, str], ...] = field(default=(), compare=False, repr=False)
    """Names in the file: path, name, and noun, such as `joint` or `link`; `*` stands for all joints."""
    as_read: Scenario | None = field(default=None, compare=False, repr=False)
    """The scenario without the changes that code has made since it was read; None for a scenario that was not read."""
    states_engine: bool = field(default=False, compare=False, repr=False)
    """Whether the scenario states the engine; False: the engine was chosen automatically."""
    lines: Mapping[str, int] = field(default_factory=dict, compare=False, repr=False)
    """Line in the file for each dotted key, for messages of later checks."""

    def references_of(self, joint: str) -> dict[str, Signal]:
        """References of a joint by name. Entries for the joint take precedence over entries for all joints."""
        return {**self.references.get("*", {}), **self.references.get(joint, {})}

    def ranges_of(self, joint: str) -> dict[str, tuple[float, float]]:
        """Declared ranges of a joint's references by name. Entries for the joint take precedence."""
        return {**self.reference_ranges.get("*", {}), **self.reference_ranges.get(joint, {})}

    def computes_reference(self, joint: str) -> bool:
        """Whether a Cartesian task or iterative learning computes the joint's reference."""
        if any(joint in trajectory or "*" in trajectory for trajectory in self.trajectories.values()):
            return True
        return self.task is not None and (not self.task.joints or joint in self.task.joints)

    def placed(self, problem: Problem) -> Problem:
        """Problem with the file and line of its key, or of the nearest parent key, unless it already states a file."""
        if problem.file is not None:
            return problem
        key = problem.key or ""
        while key and key not in self.lines:
            key = key.rpartition(".")[0]
        return replace(problem, file=self.path, line=problem.line or self.lines.get(key))

    @property
    def steps(self) -> int:
        """Number of steps in the run."""
        return round(self.duration / self.step)

    def step_times(self) -> Array:
        """Times (n,) of the start and of the end of every step, s."""
        return grid(0, self.steps + 1, self.step)

    @property
    def trajectories(self) -> dict[str, Mapping[str, Signal]]:
        """Trajectories to learn, by key of the scenario; each maps joints to desired link positions."""
        if self.learning is None:
            return {}
        return {"ilc.trajectory": self.learning.trajectory}


@overload
def for_joint(table: Mapping[str, T], joint: str) -> T | None: ...


@overload
def for_joint(table: Mapping[str, T], joint: str, default: T) -> T: ...


def for_joint(table: Mapping[str, T], joint: str, default: T | None = None) -> T | None:
    """Entry of a joint in a mapping: the entry with the joint's name, else the entry `"*"`, else `default`."""
    return table.get(joint, table.get("*", default))


def _group(name: str, doc: str, main: str = "", **options: Any) -> Key:
    """Key with a mapping whose keys are fields of the scenario."""
    block: Block[Keys] = Block(keys=(), build=dict, noun=f"mapping of {name}", main=main)
    return Key(name=name, kind=block, doc=doc, spread=True, **options)


KEYS: tuple[Key, ...] = declared_keys(
    Scenario,
    groups=(
        _group("robot", "URDF or xacro file, or a mapping with `file`, `arguments` and `packages`", main="file"),
        _group("base", "pose of the robot's root", default={}),
        _group("imperfections", "delay, hold, quantisation and noise of commands and sensors", default={}),
    ),
)
"""All keys of a variant, in the order of the documentation."""

SCENARIO: Block[Keys] = Block(keys=KEYS, build=dict, noun="scenario", read_before=("variants",))
"""Block of one variant."""


@dataclass(frozen=True)
class Change(AnyData):
    """Kind of value: the value that a variant gives to a key. A mapping may be incomplete, since it is merged into the common
    mapping."""

    key: str

    def schema(self) -> Schema:
        return {"anyOf": [{"$ref": f"#/properties/{self.key}"}, {"type": "object"}]}


VARIANT: Block[Keys] = Block(
    keys=tuple(
        replace(key, kind=Change(key.name), default=None, spread=False) for key in KEYS if key.name not in ("name", "variant")
    ),
    build=dict,
    noun="keys that differ",
)

VARIANTS = Key(
    name="variants",
    kind=MapOf(of=VARIANT, noun="name", star=False),
    default={},
    doc="named variants: the keys that each variant changes; they are merged into the common keys, and `null` removes a key",
)
