"""Functions that the kernel calls by address, in their Python version: the address is the function object itself.

In compiled code, `asrsim.simulation.native` replaces these functions by calls through C pointers. It finds them by their names.
"""

from __future__ import annotations

from typing import Any

from asrsim.actuators.motor import MotorConstants
from asrsim.simulation.fields import JointConstants, JointKind, JointState, MotorState, Scheme


def call(address: Any, *arguments: Any) -> None:
    """Call the function at an address."""
    address(*arguments)


spring_law = call
"""Arguments: address, s, p, k, q, task. Stores the torques of a joint's springs and stages in N m in the `pull` of its motors.
The link is at q rad, the motors at their `theta`. With the task `WHOLE`, also stores stiffness in N m/rad and energy in J in
`stiffness` and `law_energy`. The other tasks are those of the joint's stages (`asrsim.simulation.layout`)."""
joint_step = call
"""Arguments: address, s, p, k, u, h, note. Advances a joint by the function of its stepping, which replaces
`asrsim.simulation.kernel.advance` and sets the torque of the joint."""
engine_step = call
"""Arguments: address, record, x, exchange, wrenches, lengths, pieces. Advances the engine by one step (`asrsim.engines.base`).
pieces: number of pieces of the kick."""


def row(table: Any, j: int) -> Any:
    """Row j of a table. In compiled code, the row is a pointer: its indices must not be negative."""
    return table[j]


def joint_of(table: Any, j: int) -> JointState:
    """State of joint j in a table S of one world."""
    return table[j]  # type: ignore[no-any-return]


def link_of(table: Any, j: int) -> JointConstants:
    """Constants of joint j in a table P of one world."""
    return table[j]  # type: ignore[no-any-return]


def kind_of(table: Any, j: int) -> JointKind:
    """Kind of joint j."""
    return table[j]  # type: ignore[no-any-return]


def scheme_of(table: Any) -> Scheme:
    """Constants of the stepping."""
    return table  # type: ignore[no-any-return]


def motor_of(joint: JointState, i: int) -> MotorState:
    """State of motor i = 0, 1, ... of a joint."""
    return joint.motors[i]


def drive_of(link: JointConstants, i: int) -> MotorConstants:
    """Constants of motor i = 0, 1, ... of a joint."""
    return link.drives[i]


def memory_of(joint: JointState, kind: JointKind) -> Any:
    """Memory of the joint's sensors."""
    return joint.memory


def value_of(joint: JointState, column: Any) -> float:
    """Number in a column of the joint's row; in plain Python, the column is a function of the joint."""
    return column(joint)  # type: ignore[no-any-return]
