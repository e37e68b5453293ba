"""The keys of a scenario: one declaration for validation, JSON Schema, `--set` and the documentation."""

from __future__ import annotations

from dataclasses import replace

from asrsim.document.block import Block, Key
from asrsim.document.composite import Either, ListOf, MapOf, is_mapping, is_scalar
from asrsim.document.kinds import Boolean, Choice, File, Integer, Number, Optional, Text
from asrsim.scenario.data import Effects, LinkDamping, World
from asrsim.scenario.kinds import NOT_NEGATIVE, NUMBER, ORIGIN, POSITION, POSITIVE, RPY, SIGNALS_BY_JOINT, FolderName, Keys
from asrsim.scenario.learning_keys import LEARNING
from asrsim.scenario.task_keys import EXPECTATION, TASK, JointReferences
from asrsim.scenario.world_keys import WORLD, WRENCH
from asrsim.signals.parse import SIGNAL

ROBOT_FILE = File(noun="robot (URDF or xacro)", attach=False)

ROBOT: Block[Keys] = Block(
    keys=(
        Key(name="file", kind=ROBOT_FILE, doc="URDF or xacro file"),
        Key(name="arguments", kind=MapOf(of=Text(), noun="argument", star=False), default={}, doc="xacro arguments"),
        Key(
            name="packages",
            kind=MapOf(of=File(noun="folder", attach=False, exists=False), noun="package", star=False),
            default={},
            doc="folders of `package://` names",
        ),
    ),
    build=dict,
    noun="robot",
)


BASE: Block[Keys] = Block(
    keys=(
        Key(name="position", kind=POSITION, default=ORIGIN, unit="m", doc="of the robot's root in the world"),
        Key(name="rpy", kind=RPY, default=ORIGIN, unit="rad", doc="orientation of the robot's root"),
        Key(name="fixed", kind=Boolean(), default=True, doc="false: the robot floats"),
    ),
    build=dict,
    noun="base",
)

EFFECTS = Block(
    keys=(
        Key(name="delay", kind=NOT_NEGATIVE, default=0.0, unit="s", doc="dead time"),
        Key(name="rate", kind=Optional(POSITIVE), default=None, unit="Hz", doc="values are held between ticks of this rate"),
        Key(name="quantum", kind=NOT_NEGATIVE, default=0.0, unit="signal's", doc="step of quantisation"),
        Key(
            name="noise",
            kind=NOT_NEGATIVE,
            default=0.0,
            unit="signal's",
            doc="standard deviation of Gaussian noise, a new draw each tick, by the scenario's seed",
        ),
    ),
    build=Effects,
    noun="effects",
)

_EFFECTS_BY_JOINT = MapOf(of=EFFECTS)
ALL_EFFECTS: Block[Keys] = Block(
    keys=(
        Key(name="commands", kind=_EFFECTS_BY_JOINT, default={}, doc="on the references"),
        Key(name="sensors", kind=_EFFECTS_BY_JOINT, default={}, doc="on what the PID controllers read"),
    ),
    build=dict,
    noun="effects of commands and sensors",
)

LINK_DAMPING = Block(
    keys=(
        Key(name="constant", kind=NOT_NEGATIVE, default=0.0, unit="N m s/rad", doc="on top of the URDF's damping"),
        Key(name="ratio", kind=NOT_NEGATIVE, default=0.0, unit="1", doc="damping ratio at `inertia` and the present stiffness"),
        Key(name="inertia", kind=NOT_NEGATIVE, default=0.0, unit="kg m^2", doc="inertia at which `ratio` is meant"),
    ),
    build=LinkDamping,
    noun="damping law",
)

LOCKED = "locked"
_MOTION = Either(
    (
        (lambda node: node.value == LOCKED, Choice((LOCKED,))),
        (is_mapping, MapOf(of=Either(((lambda node: node.value == LOCKED, Choice((LOCKED,))), (lambda _: True, SIGNAL))))),
    )
)
_MODE = Integer(minimum=0, maximum=6)
_COUNT = Optional(Integer(minimum=1), word="auto")

STEPPINGS = ("leapfrog", "euler", "toolbox")
ENGINES = ("bullet", "bench")

KEYS: tuple[Key, ...] = (
    Key(name="name", kind=Optional(FolderName()), default=None, doc="of the scenario", shown="the file's name"),
    Key(
        name="variant", kind=Optional(FolderName()), default=None, shown="default",
        doc="name of this variant, in a file without variants",
    ),
    Key(
        name="robot",
        kind=Either(((is_scalar, ROBOT_FILE), (is_mapping, ROBOT))),
        doc="URDF or xacro file, or a mapping with `file`, `arguments` and `packages`",
    ),
    Key(
        name="base", kind=BASE, default={"position": ORIGIN, "rpy": ORIGIN, "fixed": True}, shown=" ",
        doc="pose of the robot's root",
    ),
    Key(name="gravity", kind=POSITION, default=(0.0, 0.0, -9.81), unit="m/s^2", doc="in the world's frame"),
    Key(
        name="initial",
        kind=MapOf(of=NUMBER),
        default={},
        unit="rad",
        doc="link positions at the start; motors stand there too, so springs are undeflected and a loaded link first sags",
        shown="0",
    ),
    Key(name="duration", kind=POSITIVE, unit="s", doc="simulated time, a whole number of steps"),
    Key(name="step", kind=POSITIVE, default=1e-3, unit="s", doc="of the simulation"),
    Key(
        name="log_rate", kind=Optional(POSITIVE), default=None, unit="Hz",
        doc="samples logged a second; 1/step must be a multiple", shown="every step",
    ),
    Key(name="seed", kind=Integer(minimum=0), default=0, doc="of all noise"),
    Key(
        name="stepping", kind=Choice(STEPPINGS), default="leapfrog",
        doc="leapfrog (second order), euler (first order), or toolbox (the released toolbox's order)",
    ),
    Key(name="substeps", kind=_COUNT, default=None, doc="world steps a step", shown="auto"),
    Key(name="motor_substeps", kind=_COUNT, default=None, doc="motor-and-spring steps a world step", shown="auto"),
    Key(name="substep_cap", kind=Integer(minimum=1), default=100, doc="a spring that needs more substeps is an error"),
    Key(name="engine", kind=Choice(ENGINES), default="bullet", doc="bullet, or bench: the links' motion is prescribed"),
    Key(
        name="motion", kind=_MOTION, default={}, unit="rad",
        doc="bench: `locked`, or a signal (or `locked`) a joint; a CSV by `playback`", shown="locked",
    ),
    Key(name="compiled", kind=Optional(Boolean(), word="auto"), default=None, doc="the compiled loop", shown="auto"),
    Key(
        name="modes", kind=Either(((is_mapping, MapOf(of=_MODE)), (is_scalar, _MODE))), default={},
        doc="operation modes that replace the URDF's, for all joints or a joint",
    ),
    Key(
        name="parameters", kind=MapOf(of=MapOf(of=Number(finite=False), noun="parameter", star=False)), default={},
        doc="actuator parameters that replace the URDF's, by our name or the toolbox's tag",
    ),
    Key(
        name="manager", kind=Optional(File(noun="manager YAML")), default=None,
        doc="the toolbox's manager file: order of the joints in robot-level arrays, and namespace",
    ),
    Key(
        name="references", kind=MapOf(of=JointReferences()), default={},
        doc="the actuators' references, by the names of their mode; beside them `inverse_dynamics: true` makes the first a "
        "desired motion of the link, whose input is computed",
    ),
    Key(name="external_torques", kind=SIGNALS_BY_JOINT, default={}, unit="N m", doc="on the links, about the joints"),
    Key(name="wrenches", kind=ListOf(of=WRENCH), default=(), doc="forces and torques on links"),
    Key(
        name="effects", kind=ALL_EFFECTS, default={"commands": {}, "sensors": {}}, shown=" ",
        doc="delay, hold, quantisation and noise of commands and sensors",
    ),
    Key(name="link_damping", kind=MapOf(of=LINK_DAMPING), default={}, doc="link damping that changes with the stiffness"),
    Key(name="world", kind=WORLD, default=World(), doc="ground and objects", shown="empty"),
    Key(name="task", kind=Optional(TASK), default=None, doc="a Cartesian path, made into references"),
    Key(name="ilc", kind=Optional(LEARNING), default=None, doc="iterative learning control, for `asrsim ilc`"),
    Key(name="expect", kind=ListOf(of=EXPECTATION), default=(), doc="claims that the run must meet"),
)  # fmt: skip
"""Every key of a variant, in the order in which people write them."""

SCENARIO: Block[Keys] = Block(keys=KEYS, build=dict, noun="scenario", may_be_empty=False, read_before=("variants",))
"""One variant."""

VARIANT: Block[Keys] = Block(
    keys=tuple(
        replace(key, default=None if key.required else key.default) for key in KEYS if key.name not in ("name", "variant")
    ),
    build=dict,
    noun="keys that differ",
)

VARIANTS = Key(
    name="variants",
    kind=MapOf(of=VARIANT, noun="name", star=False),
    default={},
    doc="named variants: what each changes, merged into the rest; `null` takes a key away",
)
