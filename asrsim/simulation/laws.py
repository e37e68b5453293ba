"""Functions that the kernel calls by address, in their Python version: the address is the function object itself.

In compiled code, `asrsim.simulation.native` replaces these functions by calls through C pointers. It finds them by their names.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any

from asrsim.actuators.vectorised import energy_law
from asrsim.simulation.layout import LAW_ENERGY, STIFFNESS

MOTOR_NUMBERS = 16
"""Number of parameters that the law of a motor takes."""
UNDEFINED = (ZeroDivisionError, OverflowError, ValueError)
"""Errors that `math` raises if a law has no finite value."""


def call(address: Any, *arguments: Any) -> None:
    """Call the function at an address."""
    address(*arguments)


spring_law = call
"""Arguments: address, s, thetas, torques, p, law, q, whole. Stores the torques of a joint's springs in N m in s[torques:]. The
link is at q rad, the motors are at s[thetas:], and the parameters are p[law:]. whole: 1 to also store the stiffness in N m/rad
and the energy in J in s[STIFFNESS:]."""
joint_step = call
"""Arguments: address, s, p, k, u, h, note. Advances a joint by the function of its stepping, which replaces
`asrsim.simulation.kernel.advance` and sets s[TORQUE]."""
engine_step = call
"""Arguments: address, record, x, exchange, wrenches, lengths, pieces. Advances the engine by one step (`asrsim.engines.base`).
pieces: number of pieces of the kick."""


def row(table: Any, j: int) -> Any:
    """Row j of a table. In compiled code, the row is a pointer: its indices must not be negative."""
    return table[j]


def numbers(p: Any, at: int) -> Any:
    """Parameters of a motor, beginning at column `at` of its row, in the order of the motor's law."""
    return p[at : at + MOTOR_NUMBERS]


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

    def laws(s: Any, thetas: int, result: int, p: Any, law: int, q: float, whole: int) -> None:
        positions, parameters = s[thetas : thetas + motors], tuple(p[law : law + count])
        try:
            found = torques(q, *positions, parameters)
            if whole:
                s[STIFFNESS], s[LAW_ENERGY] = stiffness(q, *positions, parameters), energy(q, *positions, parameters)
            s[result : result + motors] = found
        except UNDEFINED:
            s[result] = math.nan

    return laws
