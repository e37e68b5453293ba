"""The interface of an engine: it steps a robot under joint torques. The springs are not part of an engine.

A step is a kick (forces change the velocities) and a drift (positions follow the new velocities). In a staggered run
velocities belong to times half a step before the times of the positions, and the first kick lasts half a step. With mass
matrix M, viscous damping C, implicitness w and kick = fraction * h, a step of h s is

    (M + w kick C) dv = kick (torque - bias(q, v_whole) - C v) + impulses of friction and stops + h wrenches
    v += dv,  q += h v

where v_whole = 1.5 v - 0.5 v_before is the velocity at the whole step; in a run that is not staggered v_whole = v. So the
damping torque is -C (v + w dv): w = 1/2 is the midpoint rule.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from asrsim.registry import Registry
from asrsim.samples import Array

if TYPE_CHECKING:
    from asrsim.robot.model import Robot

POSITION, VELOCITY, TORQUE, DAMPING, FRICTION = range(5)
"""Columns of an exchange, an array (n, 5) with a row for each joint. A step writes position (rad, m) and velocity (rad/s, m/s);
it reads mean torque over the kick (N m, N), viscous damping (N m s/rad, N s/m) and level of Coulomb friction (N m, N)."""
Point = tuple[float, float, float]


class Model(Protocol):
    """Kinematics and dynamics of the robot without its world, at any state. Arrays are in the order of `joints`."""

    joints: tuple[str, ...]
    links: tuple[str, ...]

    def mass_matrix(self, positions: Sequence[float] | Array) -> Array:
        """(n, n) kg m^2 (kg): mass matrix of the moving joints. For a floating robot, the base is free to accelerate."""

    def bias(self, positions: Sequence[float] | Array, velocities: Sequence[float] | Array) -> Array:
        """(n,) N m: joint torques that balance gravity, Coriolis and centrifugal forces, on a fixed base."""

    def inverse_dynamics(
        self, positions: Sequence[float] | Array, velocities: Sequence[float] | Array, accelerations: Sequence[float] | Array
    ) -> Array:
        """(n,) N m: joint torques that give `accelerations`, on a fixed base; inputs (n,)."""

    def energy(self, positions: Sequence[float] | Array, velocities: Sequence[float] | Array) -> float:
        """Kinetic and gravitational energy of the links in J, on a fixed base."""

    def link_point(self, link: str, point: Point, positions: Sequence[float] | Array) -> tuple[Array, Array, Array]:
        """Forward kinematics of a point of a link: position (3,) m, rotation (3, 3), Jacobian (6, n), world frame."""


class Scene(NamedTuple):
    """Bodies and contacts of a world."""

    bodies: Mapping[str, tuple[float, ...]]
    """Objects of the world, and the robot's root link if it floats: name -> (x, y, z, qx, qy, qz, qw)."""
    contacts: Mapping[str, tuple[float, float, float]]
    """"object/other" -> contact force on the object in N, world frame, summed over points."""


class Record(NamedTuple):
    """The robot's numbers and the work space of a native step. Each thread needs a record of its own."""

    address: int
    memory: Any
    """Reference that keeps the memory at the address alive; the engine must be kept alive as well."""


class Native(NamedTuple):
    """A step of an engine as a C function, for any number of states."""

    address: int
    """Address of void step(void *record, double *state, double *exchange, const double *wrenches, double fraction)."""
    size: int
    """Number of values of a state."""
    make_record: Callable[[], Record]


class Engine(Protocol):
    """A world with one robot (or a prescribed motion), advanced in fixed steps by the rule above."""

    joints: tuple[str, ...]
    """Moving joints; arrays and sequences below are in this order."""
    version: str
    """Name and version of the engine's library, for the log."""
    model: Model | None
    """None if the motion of the links is prescribed."""
    state: Any
    """A copy of the whole state. An engine whose state is set to such a copy continues from it with identical bits."""

    def start(
        self, positions: Sequence[float], velocities: Sequence[float], *, step: float, staggered: bool, implicitness: float
    ) -> tuple[Sequence[float], Sequence[float]]:
        """Begin a run in steps of `step` s at the given joint positions and velocities; all other bodies begin at their start.

        Returns positions and velocities of the joints, which differ from the given ones if the engine prescribes the motion.
        """

    def step(self, exchange: Array, wrenches: Array, fraction: float = 1.0) -> None:
        """Advance the world by one step. exchange: see `POSITION`; C-contiguous. wrenches: (w, 6) mean force (N) and torque
        (N m) of each wrench of the scenario over the whole step. fraction: share of a full kick, 1/2 in the first step of a
        staggered run."""

    def scene(self) -> Scene:
        """Poses of the bodies and contact forces at the present state."""

    def vary(self, robot: Robot) -> bool:
        """Replace the inertials by those of a robot with the same structure, before the next start. False: the engine cannot do
        this, and a new engine is needed."""

    @property
    def native(self) -> Native | None:
        """The step of a started run as a C function; None if the engine has no such function."""

    def close(self) -> None:
        """Release the memory and the connections of the engine."""


@dataclass(frozen=True, kw_only=True)
class EngineEntry:
    """A registered engine."""

    make: Callable[..., tuple[Engine, tuple[Any, ...]]]
    """Function (scenario, robot) -> engine and warnings. The robot has the scenario's modes and parameters already."""
    doc: str
    module: str = ""
    """Python module that the engine needs; empty if it needs none."""
    prescribed: bool = False
    """The scenario's `motion` prescribes the motion of the links."""
    faster: str = ""
    """Name of an engine that gives the same motion many times faster in a world without contacts; empty if there is none."""

    @property
    def available(self) -> bool:
        """Whether the engine's module is installed."""
        from importlib.util import find_spec

        return not self.module or find_spec(self.module) is not None


ENGINES: Registry[EngineEntry] = Registry("engine", entry_point_group="asrsim.engines", instance=EngineEntry)
