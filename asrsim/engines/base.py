"""The interface of an engine: it steps a robot under joint torques. It knows nothing of springs.

A step is a kick (velocities change by what pushes) and a drift (positions follow the new velocities). In a staggered run
velocities live at half steps, half a step before the positions beside them, and the first kick is half a one. With mass matrix
M, viscous damping C, implicitness w and kick = fraction * h a step of h is

    (M + w kick C) dv = kick (torque - bias(q, v_whole) - C v) + impulses of friction and stops + h wrenches
    v += dv,  q += h v

where v_whole = 1.5 v - 0.5 v_before is the velocity at the whole step, in a run that is not staggered v. So the damping torque
is -C (v + w dv): w = 1/2 is the midpoint rule.
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
    """Kinematics and dynamics of the robot alone, at any state. Arrays are in the order of `joints`."""

    joints: tuple[str, ...]
    links: tuple[str, ...]

    def mass_matrix(self, positions: Sequence[float] | Array) -> Array:
        """(n, n) kg m^2 (kg) mass matrix of the moving joints; of a floating robot, the one with a free base."""

    def bias(self, positions: Sequence[float] | Array, velocities: Sequence[float] | Array) -> Array:
        """(n,) N m of gravity, Coriolis and centrifugal forces, on a fixed base: these torques give no acceleration."""

    def inverse_dynamics(
        self, positions: Sequence[float] | Array, velocities: Sequence[float] | Array, accelerations: Sequence[float] | Array
    ) -> Array:
        """(n,) N m that give `accelerations`, on a fixed base; inputs (n,)."""

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
    """The robot's numbers and work space of a native step. It serves one thread at a time."""

    address: int
    memory: Any
    """Keeps the memory at the address alive; the engine must live as well."""


class Native(NamedTuple):
    """A step of an engine as a C function, for any number of states."""

    address: int
    """Of void step(void *record, double *state, double *exchange, const double *wrenches, double fraction)."""
    size: int
    """Numbers of a state."""
    make_record: Callable[[], Record]


class Engine(Protocol):
    """A world with one robot (or prescribed motion), stepped at a fixed step by the rule above."""

    joints: tuple[str, ...]
    """Moving joints; arrays and sequences below are in this order."""
    version: str
    """Library and version, for the log."""
    model: Model | None
    """None if the motion of the links is prescribed."""
    state: Any
    """A copy of the whole state. Set: the engine continues from it, to the bit."""

    def start(
        self, positions: Sequence[float], velocities: Sequence[float], *, step: float, staggered: bool, implicitness: float
    ) -> tuple[Sequence[float], Sequence[float]]:
        """Begin a run in steps of `step` s, with these positions and velocities of the joints and everything else at its start.

        Returns positions and velocities: an engine that prescribes the motion decides them itself.
        """

    def step(self, exchange: Array, wrenches: Array, fraction: float = 1.0) -> None:
        """One step. exchange: see :data:`POSITION`; C-contiguous; wrenches: (w, 6) force (N) and torque (N m) of each of the
        scenario's wrenches, means over the whole step; fraction: of the kick, 1/2 in the first step of a staggered run."""

    def scene(self) -> Scene:
        """Bodies and contacts now."""

    def vary(self, robot: Robot) -> bool:
        """Take over the inertials of a robot of the same structure before the next start. False: a new engine is needed."""

    @property
    def native(self) -> Native | None:
        """The step of a started run as a C function, or None."""

    def close(self) -> None:
        """Release everything."""


@dataclass(frozen=True, kw_only=True)
class EngineEntry:
    """A registered engine."""

    make: Callable[..., tuple[Engine, tuple[Any, ...]]]
    """(scenario, robot) -> engine and warnings; robot: with the scenario's modes and parameters in it."""
    doc: str
    module: str = ""
    """Module that must be importable; empty: none."""
    prescribed: bool = False
    """The scenario's `motion` prescribes the motion of the links."""
    faster: str = ""
    """A registered engine that gives the same motion many times faster in a world without contacts; empty: none."""

    @property
    def available(self) -> bool:
        """Whether its module is installed."""
        from importlib.util import find_spec

        return not self.module or find_spec(self.module) is not None


ENGINES: Registry[EngineEntry] = Registry("engine", entry_point_group="asrsim.engines", instance=EngineEntry)
