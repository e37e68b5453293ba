"""What an engine is: a robot whose joints take torques and step. It never hears of springs.

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
"""Columns of an exchange, an array (n, 5) with a row for each joint: where it is (rad, m) and how it moves (rad/s, m/s), which
a step writes; the mean torque on it over the kick (N m, N), its viscous damping (N m s/rad, N s/m) and the bound of its Coulomb
friction (N m, N), which a step reads."""
Point = tuple[float, float, float]


class Model(Protocol):
    """Kinematics and dynamics of the robot alone at any state, apart from stepping. Arrays are in the order of `joints`."""

    joints: tuple[str, ...]
    links: tuple[str, ...]

    def mass_matrix(self, positions: Sequence[float] | Array) -> Array:
        """(n, n) kg m^2 (kg) of the moving joints; that which torques meet while the base is free, if it floats."""

    def bias(self, positions: Sequence[float] | Array, velocities: Sequence[float] | Array) -> Array:
        """(n,) N m that give no acceleration, on a base that is held: gravity, Coriolis and centrifugal torques."""

    def inverse_dynamics(
        self, positions: Sequence[float] | Array, velocities: Sequence[float] | Array, accelerations: Sequence[float] | Array
    ) -> Array:
        """(n,) N m that give `accelerations`, on a base that is held; inputs (n,)."""

    def energy(self, positions: Sequence[float] | Array, velocities: Sequence[float] | Array) -> float:
        """Kinetic and gravitational energy of the links in J, on a base that is held."""

    def link_point(self, link: str, point: Point, positions: Sequence[float] | Array) -> tuple[Array, Array, Array]:
        """Forward kinematics of a point of a link: position (3,) m, rotation (3, 3), Jacobian (6, n), world frame."""


class Scene(NamedTuple):
    """What is around the joints."""

    bodies: Mapping[str, tuple[float, ...]]
    """Objects of the world, and the robot's root link if it floats: name -> (x, y, z, qx, qy, qz, qw)."""
    contacts: Mapping[str, tuple[float, float, float]]
    """"object/other" -> contact force on the object in N, world frame, summed over points."""


class Record(NamedTuple):
    """What a native step works on beside a state: the robot's numbers and work space. It serves one thread at a time."""

    address: int
    memory: Any
    """Holds what stands at the address; the engine must live, too."""


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
    """None where the links have no dynamics: their motion is prescribed."""
    state: Any
    """The whole state, a copy. Set: the engine continues from it, to the bit."""

    def start(
        self, positions: Sequence[float], velocities: Sequence[float], *, step: float, staggered: bool, implicitness: float
    ) -> tuple[Sequence[float], Sequence[float]]:
        """A run of steps of `step` s begins with the joints there, moving so; everything else as at the start. Returns where
        they are and how they move: an engine that prescribes motion decides that itself."""

    def step(self, exchange: Array, wrenches: Array, fraction: float = 1.0) -> None:
        """One step. exchange: see :data:`POSITION`; C-contiguous; wrenches: (w, 6) force (N) and torque (N m) of each of the
        scenario's wrenches, means over the whole step; fraction: of the kick, 1/2 in the first step of a staggered run."""

    def scene(self) -> Scene:
        """Bodies and contacts now."""

    def vary(self, robot: Robot) -> bool:
        """Take over the inertials of a robot of the same structure, exactly, before the next start; False: an engine must be
        made."""

    @property
    def native(self) -> Native | None:
        """The step as a C function, of a run that has started; None where there is none."""

    def close(self) -> None:
        """Release everything."""


@dataclass(frozen=True, kw_only=True)
class EngineEntry:
    """A registered engine."""

    make: Callable[..., tuple[Engine, tuple[Any, ...]]]
    """(scenario, robot) -> engine and warnings; robot: with the scenario's modes and parameters in it."""
    doc: str
    module: str = ""
    """What must be importable for it; empty: nothing."""
    prescribed: bool = False
    """Links move as the scenario's `motion` says."""
    faster: str = ""
    """A registered engine that gives the same motion many times faster where nothing can touch; empty: none."""

    @property
    def available(self) -> bool:
        """Whether what it needs is installed."""
        from importlib.util import find_spec

        return not self.module or find_spec(self.module) is not None


ENGINES: Registry[EngineEntry] = Registry("engine", entry_point_group="asrsim.engines", instance=EngineEntry)
