"""The interface of an engine, which steps a robot under joint torques. The springs are not part of an engine.

A step is a kick (forces change the velocities) and a drift (positions follow the new velocities). In a staggered run
velocities belong to times half a step before the times of the positions, and the first kick lasts half a step. A kick in which
an input jumps consists of several pieces, each with its own torques, damping, friction and wrenches; other kicks are one piece.
With mass matrix M, viscous damping C, implicitness w and the lengths t of the pieces in s, a step of h s is

    for each piece: (M + w t C) dv = t (torque + wrenches - bias(q, v_whole) - C v) + impulses of friction and stops, v += dv
    q += h v

where v_whole = 1.5 v - 0.5 v_before is the velocity at the whole step; v and v_before are the velocities before this kick and
before the previous kick. In a run that is not staggered v_whole = v. So the damping torque is -C (v + w dv). With w = 1/2 this
is the midpoint rule.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np

from asrsim.samples import Array, HeldWrench

if TYPE_CHECKING:
    from asrsim.robot.model import Robot
    from asrsim.scenario.data import World

POSITION, VELOCITY, TORQUE, DAMPING, FRICTION, MIDDLE = range(6)
"""Columns of an exchange, an array (p, n, 6) with a row for each piece of the kick and each joint. A step reads torque (N m,
N), viscous damping (N m s/rad, N s/m) and level of Coulomb friction (N m, N) of each piece. The step writes position (rad, m)
and velocity (rad/s, m/s) at the end of the step into the rows of the last piece. It may also write the velocities in the middle
of the kick (`MIDDLE`) into these rows, which are then logged. Otherwise the means of the velocities before and after the kick
are logged."""
ROUNDING = 1e-9
"""Largest deviation from 1 of the sum of the lengths of a kick's pieces that counts as a rounding error."""
GROUND, ROBOT = "ground", "robot"
"""GROUND, ROBOT: names of the ground and of the robot in the names of contact forces."""
NOTHING = (0.0, 0.0, 0.0)


def whole_kick(exchange: Array, wrenches: Array, lengths: Array) -> tuple[Array, Array, float]:
    """Exchange (n, 6) and wrenches (1, w, 6), each averaged over all pieces of a kick, and the length of the kick as a fraction
    of a step. Engines that cannot divide a kick into pieces use these values."""
    total = float(lengths.sum())
    shares = lengths / total
    whole = 1.0 if abs(total - 1.0) < ROUNDING else total
    return np.tensordot(shares, exchange, 1), np.tensordot(shares, wrenches, 1)[None], whole


class Scene(NamedTuple):
    """Poses of bodies, and contact forces, of a world at one time."""

    bodies: Mapping[str, tuple[float, ...]]
    """Poses (x, y, z, qx, qy, qz, qw) of the world's objects, and of the robot's root link if this link floats, by name."""
    contacts: Mapping[str, tuple[float, float, float]]
    """Contact forces on objects in N, world frame, summed over points; the key "object/other" names the two bodies."""


def contact_forces(world: World, points: Iterable[tuple[str, str, Array]]) -> dict[str, tuple[float, float, float]]:
    """Contact forces in N, world frame, each summed over all points at which two bodies touch; 0 without contact.
    "object/other": force on the object by the other body; "robot/ground": force on the robot by the ground.

    points: for each contact point, the two bodies and the force (3,) on the first body.
    """
    others = [*(item.name for item in world.solids), ROBOT]
    total: dict[str, Any] = {
        f"{item.name}/{other}": NOTHING for item in world.objects for other in others if other != item.name
    }
    if world.ground:
        total[f"{ROBOT}/{GROUND}"] = NOTHING
    for first, second, force in points:
        for key, sign in ((f"{first}/{second}", 1.0), (f"{second}/{first}", -1.0)):
            if key in total:
                total[key] = np.add(total[key], sign * force)
    return {key: (float(x), float(y), float(z)) for key, (x, y, z) in total.items()}


class NativeRecord(NamedTuple):
    """Parameters of the robot and work space for a native step. Each thread needs a separate record."""

    address: int
    memory: Any
    """Reference that keeps the record's memory alive. The engine must be kept alive as well."""


class Native(NamedTuple):
    """A step of an engine as a C function, for any number of states."""

    address: int
    """Address of void step(void *record, double *state, double *exchange, const double *wrenches, const double *lengths,
    intptr_t pieces)."""
    size: int
    """Number of values of a state."""
    make_record: Callable[[int], NativeRecord]
    """Function that makes a record for steps of a length. Its argument is this length as a number of steps of the run."""


MEMBERS = "joints", "version", "state", "takes_wrenches", "start", "step", "scene", "vary", "native", "close"
"""Members that every engine has, whether its class is derived from `Engine` or not."""


class Engine(Protocol):
    """A world with one robot (or a prescribed motion), advanced in fixed steps by the rule in the docstring of the module.

    The defaults of `takes_wrenches`, `takes_weightless`, `holdable`, `hold`, `scene`, `native` and `close` suit a robot on a
    fixed base without contacts, in an engine that has no compiled step and nothing to release.
    """

    joints: tuple[str, ...]
    """Names of the moving joints; arrays and sequences of the methods are in this order."""
    version: str
    """Name and version of the engine's library, for the log."""
    state: Any
    """A copy of the whole state. If the state is set to such a copy, the engine continues from it with identical bits."""
    takes_wrenches: bool = True
    """Whether the wrenches of a step act on the robot. If not, scenarios with wrenches are refused."""
    takes_weightless: bool = False
    """Whether the engine keeps gravity off the mass `link.weightless` of each link. If not, such robots are refused."""

    def start(
        self, positions: Sequence[float], velocities: Sequence[float], *, step: float, staggered: bool, implicitness: float
    ) -> tuple[Sequence[float], Sequence[float]]:
        """Begin a run in steps of `step` s at the given joint positions and velocities; all other bodies begin at their initial
        poses.

        Returns positions and velocities of the joints. They differ from the given values if the engine prescribes the motion.
        """

    def step(self, exchange: Array, wrenches: Array, lengths: Array) -> None:
        """Advance the world by one step. exchange: exchange (p, n, 6), see `POSITION`. wrenches: force (N) and torque (N m) of
        each wrench of the scenario, (p, w, 6). lengths: lengths (p,) of the pieces as fractions of the step; their sum is 1, or
        1/2 in the first step of a staggered run. All arrays are C-contiguous."""

    @property
    def holdable(self) -> tuple[str, ...]:
        """Names of the links and objects on which `hold` acts."""
        return ()

    def hold(self, wrenches: Sequence[HeldWrench]) -> None:
        """Let wrenches act on bodies in all further steps, in addition to the wrenches of `step`. These wrenches replace the
        wrenches of an earlier call, and are not part of a state. wrenches: wrenches on bodies in `holdable`, at most one on
        each body."""
        return

    def scene(self) -> Scene:
        """Poses of the bodies, and contact forces, in the present state."""
        return Scene({}, {})

    def vary(self, robot: Robot) -> bool:
        """Replace the inertials by the inertials of a robot with the same structure. This method is called before `start`. It
        returns False if the engine cannot replace inertials, so that a new engine is needed."""

    @property
    def native(self) -> Native | None:
        """The step of a started run as a C function; None if the engine has no such function."""
        return None

    def close(self) -> None:
        """Release the memory and the connections of the engine, if it has any."""
        return
