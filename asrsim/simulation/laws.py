"""Functions that the kernel calls by address, in their Python version: the address is the function object itself.

In compiled code, `asrsim.simulation.native` replaces these functions by calls through C pointers. It finds them by their names.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any

from asrsim.actuators.motor import MotorConstants
from asrsim.actuators.vectorised import energy_law
from asrsim.simulation.fields import JointConstants, JointKind, JointState, MotorState, Scheme

UNDEFINED = (ZeroDivisionError, OverflowError, ValueError)
"""Errors that `math` raises if a law has no finite value."""


def call(address: Any, *arguments: Any) -> None:
    """Call the function at an address."""
    address(*arguments)


spring_law = call
"""Arguments: address, s, p, law, q, whole. Stores the torques of a joint's springs in N m in the `pull` of its motors. The link
is at q rad, the motors at their `theta`, and the parameters begin at column `law` of the row of p. whole: 1 to also store
stiffness in N m/rad and energy in J in `stiffness` and `law_energy`."""
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


def bound_step(function: Callable[..., None]) -> Any:
    """The function of a stepping in the form that `joint_step` calls."""
    return function


@cache
def bound_law(actuator: Any, motors: int) -> Callable[..., None]:
    """Function that `spring_law` calls to evaluate an actuator's laws. The torque is NaN if a law has no finite value.

    motors: number of positions that the laws take, at least 2.
    """
    torques, stiffness, energy = actuator.elastic_torques, actuator.stiffness, energy_law(actuator)
    count = len(actuator.parameters)

    def laws(joint: JointState, link: JointConstants, law: int, q: float, whole: int) -> None:
        own = joint.motors[:motors]
        positions, parameters = [motor.theta for motor in own], tuple(link.law[:count])
        try:
            found = torques(q, *positions, parameters)
            if whole:
                joint.stiffness = stiffness(q, *positions, parameters)
                joint.law_energy = energy(q, *positions, parameters)
            for motor, torque in zip(own, found, strict=False):
                motor.pull = torque
        except UNDEFINED:
            own[0].pull = math.nan

    return laws
