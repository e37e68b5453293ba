"""The scenario as pure data: one variant, resolved and valid. The reader makes it, the builder consumes it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar, overload

from asrsim.signals.base import Signal

Vector = tuple[float, float, float]
T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class Effects:
    """Imperfections between a controller and the joint; all off by default."""

    delay: float = 0.0
    """s."""
    rate: float | None = None
    """Hz: values are held between ticks of this control rate; None: continuous."""
    quantum: float = 0.0
    """Quantisation step in the signal's unit; 0: none."""
    noise: float = 0.0
    """Standard deviation of seeded Gaussian noise, a new draw each tick (or each step)."""

    @property
    def active(self) -> bool:
        """Whether anything differs from the ideal."""
        return bool(self.delay or self.rate or self.quantum or self.noise)


@dataclass(frozen=True, kw_only=True)
class LinkDamping:
    """Link damping as a function of the stiffness: c(k) = constant + ratio * 2 sqrt(inertia * k), off by default."""

    constant: float = 0.0
    """N m s/rad, in addition to the URDF's damping."""
    ratio: float = 0.0
    """Damping ratio with respect to `inertia` and the present stiffness."""
    inertia: float = 0.0
    """kg m^2 at which `ratio` is meant."""


@dataclass(frozen=True, kw_only=True)
class Wrench:
    """A force and torque on a link by signals."""

    link: str
    force: tuple[Signal | None, Signal | None, Signal | None] = (None, None, None)
    """N, along x, y, z."""
    torque: tuple[Signal | None, Signal | None, Signal | None] = (None, None, None)
    """N m."""
    point: Vector = (0.0, 0.0, 0.0)
    """Where the force acts, m, in the link's frame."""
    frame: str = "world"
    """`world` or `link`: the frame of force and torque."""


@dataclass(frozen=True, kw_only=True)
class WorldObject:
    """A body beside the robot."""

    name: str
    shape: str
    """box, sphere, cylinder, mesh."""
    size: tuple[float, ...] = ()
    """box: x, y, z; sphere: radius; cylinder: radius, length; mesh: scale x, y, z. m."""
    mesh: Path | None = None
    mass: float = 0.0
    """kg; 0: static."""
    inertia: Vector | None = None
    """Principal moments kg m^2; None: of the solid shape."""
    friction: float = 0.5
    """Coulomb coefficient; a contact's is the product of both bodies'."""
    restitution: float = 0.0
    position: Vector = (0.0, 0.0, 0.0)
    rpy: Vector = (0.0, 0.0, 0.0)
    colour: tuple[float, float, float, float] = (0.72, 0.55, 0.35, 1.0)


@dataclass(frozen=True, kw_only=True)
class World:
    """What stands around the robot."""

    ground: bool = False
    ground_friction: float = 1.0
    ground_height: float = 0.0
    """z of the ground's surface, m."""
    objects: tuple[WorldObject, ...] = ()

    @property
    def empty(self) -> bool:
        """Nothing to collide with."""
        return not self.ground and not self.objects


@dataclass(frozen=True, kw_only=True)
class Expectation:
    """A claim about a run, as data: `quantity` of `joint` under `measure` compares with `value`."""

    quantity: str
    measure: str
    """A name from the metrics registry: steady_state, overshoot, maximum, rmse, amplitude, frequency, ..."""
    comparison: str
    """One of `==`, `<`, `<=`, `>`, `>=`; `==` within `tolerance`."""
    value: float
    tolerance: float = 0.0
    joint: str | None = None
    body: str | None = None
    """World object instead of a joint, for poses and contacts."""
    variant: str | None = None
    """Only in this variant; None: in every one."""
    against: Path | None = None
    """File of a recording to compare with, for measures of a difference."""
    options: Mapping[str, Any] = field(default_factory=dict)
    line: int | None = field(default=None, compare=False)


@dataclass(frozen=True, kw_only=True)
class CartesianPose:
    """A waypoint of a Cartesian task."""

    time: float
    """s at which the pose is reached."""
    position: Vector
    """m, world frame."""
    rpy: Vector | None = None
    """rad; None: orientation free."""


@dataclass(frozen=True, kw_only=True)
class CartesianTask:
    """A path of a link's point, turned into equilibrium references by closed-loop inverse kinematics."""

    link: str
    poses: tuple[CartesianPose, ...]
    point: Vector = (0.0, 0.0, 0.0)
    """m in the link's frame."""
    joints: tuple[str, ...] = ()
    """Joints that move; empty: all actuated ones up the chain."""
    gain: float = 10.0
    """1/s, of the closed loop."""
    damping: float = 1e-3
    """m (or rad), of damped least squares."""
    interpolation: str = "minimum_jerk"
    gravity_compensation: bool = False
    """Add the springs' deflection under gravity to the equilibrium."""
    motor_droop: bool = False
    """Compensate the motors' steady-state error under load too."""
    preset: Mapping[str, float] = field(default_factory=dict)
    """Stiffness preset per joint or "*"."""
    tolerance: float = 1e-3
    """m by which the path may be missed before it counts as unreachable."""


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """One variant of a scenario, resolved: what one run needs."""

    name: str
    robot: Path
    path: Path | None = None
    text: str = ""
    """The file as read, all variants."""
    variant: str = "default"
    xacro_arguments: Mapping[str, str] = field(default_factory=dict)
    package_paths: Mapping[str, Path] = field(default_factory=dict)
    base_position: Vector = (0.0, 0.0, 0.0)
    base_rpy: Vector = (0.0, 0.0, 0.0)
    fixed_base: bool = True
    gravity: Vector = (0.0, 0.0, -9.81)
    """m/s^2."""
    initial_positions: Mapping[str, float] = field(default_factory=dict)
    duration: float = 1.0
    """s."""
    step: float = 1e-3
    """s."""
    log_every: int = 1
    """Steps between logged samples (from the log rate)."""
    seed: int = 0
    stepping: str = "leapfrog"
    """leapfrog (second order), euler (first order), toolbox (the released code's order of a step)."""
    substeps: int | None = None
    """World steps a step; None: automatic."""
    motor_substeps: int | None = None
    """Motor-and-spring steps a world step; None: automatic."""
    substep_cap: int = 100
    engine: str = "bullet"
    motion: Mapping[str, Signal] = field(default_factory=dict)
    """Bench engine: prescribed link positions per joint or "*"; joints without one are locked."""
    compiled: bool | None = None
    """True: force the compiled loop, False: forbid it, None: when it pays."""
    modes: Mapping[str, int] = field(default_factory=dict)
    """Operation modes that replace the URDF's, per joint or "*"."""
    parameters: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Joint name or "*" -> parameter (our name or the toolbox's tag) -> value."""
    joint_order: tuple[str, ...] = ()
    """Order of the robot-level arrays (manager YAML); empty: order of the URDF."""
    namespace: str | None = None
    """Replaces the blocks' namespace (manager YAML)."""
    references: Mapping[str, Mapping[str, Signal]] = field(default_factory=dict)
    """Joint or "*" -> reference by the mode's name (see asrsim.actuators.MODES) -> signal. Absent ones rest at their start."""
    inverse_dynamics: Mapping[str, bool] = field(default_factory=dict)
    """Joint or "*" -> whether its first reference is a desired motion of the link, whose input is computed."""
    external_torques: Mapping[str, Signal] = field(default_factory=dict)
    wrenches: tuple[Wrench, ...] = ()
    command_effects: Mapping[str, Effects] = field(default_factory=dict)
    """On the references, per joint or "*"."""
    sensor_effects: Mapping[str, Effects] = field(default_factory=dict)
    """On what the PID controllers read, per joint or "*"."""
    link_damping: Mapping[str, LinkDamping] = field(default_factory=dict)
    """Per joint or "*"."""
    world: World = field(default_factory=World)
    task: CartesianTask | None = None
    expect: tuple[Expectation, ...] = ()
    learning: Mapping[str, Any] = field(default_factory=dict)
    """The `ilc:` block, validated by asrsim.scenario, consumed by asrsim.learning."""
    attachments: Mapping[str, Path] = field(default_factory=dict)
    """Files that the scenario names (playbacks, manager YAML), to be attached to the log."""
    resolved: Mapping[str, Any] = field(default_factory=dict)
    """This variant as plain JSON values with overrides applied: parsing it again gives this scenario."""
    lines: Mapping[str, int] = field(default_factory=dict, compare=False, repr=False)
    """Dotted key -> line in `path`, for messages of later checks."""

    def references_of(self, joint: str) -> dict[str, Signal]:
        """Reference by name of one joint: those given for all, and its own, which win."""
        return {**self.references.get("*", {}), **self.references.get(joint, {})}


@overload
def for_joint(table: Mapping[str, T], joint: str) -> T | None: ...


@overload
def for_joint(table: Mapping[str, T], joint: str, default: T) -> T: ...


def for_joint(table: Mapping[str, T], joint: str, default: T | None = None) -> T | None:
    """The entry of a joint in a per-joint table: its own, else that of `"*"`, else `default`."""
    return table.get(joint, table.get("*", default))
