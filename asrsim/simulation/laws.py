"""Functions that the kernel calls by address, in their Python version: the address is the function object itself.

In compiled code, `asrsim.simulation.native` replaces these functions by calls through C pointers. It finds the functions by
name.
"""

from __future__ import annotations

import math
from functools import cache
from struct import Struct
from typing import Any

from asrsim.actuators.motor import MotorConstants
from asrsim.engines.base import DAMPING, FRICTION, MIDDLE, POSITION, TORQUE, VELOCITY
from asrsim.simulation.fields import JointConstants, JointKind, JointState, MotorState


def spring_law(address: Any, joint: JointState, link: JointConstants, kind: JointKind, q: float, task: int) -> None:
    """Store the torques of a joint's springs and stages in N m in the `pull` of its motors, with the link at q rad and the
    motors at their `theta`. With the task `WHOLE`, also store stiffness in N m/rad and energy in J in `stiffness` and
    `law_energy`. The other tasks are tasks of the joint's stages (`asrsim.simulation.layout`).
    """
    address(joint, link, kind, q, task)


def joint_step(address: Any, joint: JointState, link: JointConstants, kind: JointKind, u: Any, h: float, note: int) -> None:
    """Advance a joint by the function of its stepping, which replaces `asrsim.simulation.joint.advance` and sets the torque of
    the joint.
    """
    address(joint, link, kind, u, h, note)


def engine_step(address: Any, record: Any, x: Any, exchange: Any, wrenches: Any, lengths: Any, pieces: int) -> None:
    """Advance the engine by one step (`asrsim.engines.base`). pieces: number of pieces of the kick."""
    address(record, x, exchange, wrenches, lengths, pieces)


def put_load(exchange: Any, piece: int, j: int, torque: float, damping: float, friction: float) -> None:
    """Put the loads of joint j in a piece of a kick into the exchange. The velocity in the middle of the kick is NaN until the
    engine writes it.
    """
    exchange[piece, j, MIDDLE] = math.nan
    exchange[piece, j, TORQUE] = torque
    exchange[piece, j, DAMPING] = damping
    exchange[piece, j, FRICTION] = friction


def motion_of(exchange: Any, last: int, j: int) -> tuple[float, float, float]:
    """Position and velocity of joint j after a kick, and its velocity in the middle of the kick. last: number of the last piece
    of the kick."""
    return exchange[last, j, POSITION], exchange[last, j, VELOCITY], exchange[last, j, MIDDLE]


def inputs_of(table: Any, at: int, j: int) -> Any:
    """Inputs of joint j in row `at` of a table. In compiled code the result is a pointer, so that its indices must not be
    negative."""
    return table[at][j]


def joint_of(states: Any, constants: Any, kinds: Any, j: int) -> tuple[JointState, JointConstants, JointKind]:
    """State, constants and kind of joint j in the tables S and P of one world, and K."""
    return states[j], constants[j], kinds[j]


def motor_of(joint: JointState, i: int) -> MotorState:
    """State of motor i = 0, 1, ... of a joint."""
    return joint.motors[i]


def drive_of(link: JointConstants, i: int) -> MotorConstants:
    """Constants of motor i = 0, 1, ... of a joint."""
    return link.drives[i]


def memory_of(joint: JointState, kind: JointKind) -> Any:
    """Memory of the joint's sensors."""
    return joint.memory


def record(out: Any, place: int, kept: int, j: int, joint: JointState, of_state: Any, references: Any, of_inputs: Any) -> None:
    """Write a row of joint j: numbers of its state, then of its references. out, of_state, of_inputs: see
    `asrsim.simulation.kernel.run` and `asrsim.simulation.arguments.RowSelection`; place: number of the world in `out`; kept:
    number of the row of the world.
    """
    _, rows, joints, columns = out.shape
    first = ((place * rows + kept) * joints + j) * columns
    _row(columns).pack_into(out, out.itemsize * first, *of_state(joint), *of_inputs(references))


@cache
def _row(columns: int) -> Struct:
    """Format of a row in memory with this number of columns."""
    return Struct(f"{columns}d")
