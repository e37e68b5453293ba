"""What an engine is: joints with positions and velocities that take torques and step. It never hears of springs.

A step is a kick (velocities change by what pushes) and a drift (positions follow the new velocities). An engine corrects its
own lags: with `staggered` set, velocities live at half steps, and velocity-dependent torques of the links (Coriolis,
centrifugal) count at the velocity of the whole step.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

from asrsim.registry import Registry
from asrsim.samples import Array

if TYPE_CHECKING:
    from asrsim.robot.model import Robot

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

    def link_point(self, link: str, point: Point, positions: Sequence[float] | Array) -> tuple[Array, Array, Array]:
        """Forward kinematics of a point of a link: position (3,) m, rotation (3, 3), Jacobian (6, n), world frame."""


@dataclass(frozen=True, kw_only=True)
class EngineKernel:
    """A step of an engine as ordinary code on arrays, which a compiled loop runs for a whole stretch without the
    interpreter; or, where the engine is stepped from Python, what it adds to the torques before."""

    move: Callable[..., None]
    """move(world): one step under `world.forces`, mean torques in N m; or changes them, from `world.positions` and
    `world.velocities`."""
    look: Callable[..., None] | None = None
    """look(world): fills in `world.positions` and `world.velocities` of the joints; before every move. None: `move` takes no
    step."""
    advance: Callable[[Sequence[float]], None] | None = None
    """Where `move` takes no step: one step from Python under the forces that it left."""
    world: Any
    """A named tuple of arrays and numbers: the engine's live state; (n,) arrays `positions`, `velocities`, `forces`, and
    `friction` (N m, Coulomb) where joints whose friction varies are to run compiled."""
    compiled: Mapping[str, Any]
    """Names that the code of look and move mentions -> what stands for them in compiled code; symbols are known to the
    process."""
    version: str
    """Of what is called: part of a kept kernel's name."""
    inline: tuple[str, ...] = ()
    """Modules whose functions become part of their callers."""


class Engine(Protocol):
    """A world with one robot (or prescribed motion), stepped at a fixed step by semi-implicit Euler."""

    joints: tuple[str, ...]
    """Moving joints; arrays and sequences below are in this order."""
    model: Model | None
    """None where the links have no dynamics: their motion is prescribed."""
    version: str
    """Library and version, for the log."""

    def states(self) -> Any:
        """What `read` tells, as the engine has it: for the hot loop, which takes it apart by `unpack`."""

    @property
    def unpack(self) -> Callable[[Any, int], tuple[float, float]]:
        """unpack(states, j): position and velocity of joint j; ordinary code that compiles with the loop's."""

    def states_type(self) -> Any:
        """Numba's type of `states`."""

    def read(self) -> tuple[list[float], list[float]]:
        """Positions (rad, m) and velocities (rad/s, m/s) of the joints, the latter half a step late if staggered."""

    def set_friction(self, bounds: Sequence[float]) -> None:
        """Coulomb friction of the joints (N m) in the steps to come, where it varies; joints begin with that of the robot."""

    def advance(self, forces: Sequence[float], fraction: float = 1.0) -> None:
        """One step under mean torques (N m), one a joint. fraction: of the kick, less than 1 for the first of a staggered
        run."""

    def prepare(self, step: float, *, staggered: bool) -> None:
        """Before the first step: its length in s; staggered: see the module."""

    def set_state(self, positions: Sequence[float], velocities: Sequence[float]) -> None:
        """Joints there, moving so; everything else as at the start."""

    def snapshot(self) -> Any:
        """The engine's whole state, to be given to `restore`."""

    def restore(self, state: Any) -> None:
        """Continue from a snapshot of this engine, to the bit."""

    def vary(self, robot: Robot) -> bool:
        """Take over inertials, damping and friction of a robot of the same structure, exactly; False: an engine must be
        made."""

    def mechanical_energy(self) -> float | None:
        """Kinetic and gravitational energy of the robot's links in J; None where contacts or a free base exchange it."""

    def apply_wrench(self, index: int, values: Sequence[float]) -> None:
        """Force (N) and torque (N m), six numbers, of the scenario's wrench `index` for the next step."""

    def bodies(self) -> Mapping[str, tuple[float, ...]]:
        """Objects of the world, and the robot's root link if it floats: name -> (x, y, z, qx, qy, qz, qw)."""

    def contacts(self) -> Mapping[str, tuple[float, float, float]]:
        """ "object/other" -> contact force on the object in N, world frame, summed over points."""

    def accelerate(self) -> None:
        """The loop is compiled: compile what is the engine's own, too."""

    def kernel(self) -> EngineKernel | None:
        """The engine's part in compiled loops; None where it has none, and every step goes through Python."""

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
