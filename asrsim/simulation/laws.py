"""Functions that the kernel calls by address. Here is what an address means in plain Python; compiled code calls through the
pointer (:mod:`asrsim.simulation.native`), which is why they are called by these names and no other.

In plain Python an address is the function itself.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any

from asrsim.actuators.vectorised import energy_law
from asrsim.simulation.layout import LAW_ENERGY, STIFFNESS

MOTOR_NUMBERS = 16
"""Numbers of a motor that its law takes."""
UNDEFINED = (ZeroDivisionError, OverflowError, ValueError)
"""What :mod:`math` raises where a law has no finite value."""


def spring_law(address: Any, q: float, s: Any, thetas: int, p: Any, law: int, torques: int, whole: int) -> None:
    """Torques of the springs in N m into s[torques:], for a link at q rad and motors at s[thetas:]; parameters: p[law:].

    whole: 1: find their stiffness in N m/rad and their energy in J, too, into s[STIFFNESS:].
    """
    address(q, s, thetas, p, law, torques, whole)


def joint_step(address: Any, s: Any, p: Any, k: Any, u: Any, h: float, note: int) -> None:
    """A stepping's own step of a joint, in place of :func:`asrsim.simulation.joint.advance`: torque into s[TORQUE]."""
    address(s, p, k, u, h, note)


def engine_step(address: Any, record: int, x: Any, exchange: Any, wrenches: Any, fraction: float) -> None:
    """One step of the engine; see :mod:`asrsim.engines.base`."""
    address(x, exchange, wrenches, fraction)


def numbers(p: Any, at: int) -> Any:
    """Parameters of a motor from place `at` of a row on, as its law takes them."""
    return p[at : at + MOTOR_NUMBERS]


@cache
def plain_law(actuator: Any, motors: int) -> Callable[..., None]:
    """An actuator's laws as :func:`spring_law` calls them in plain Python. Where one has no finite value, the result is NaN.

    motors: positions that the laws take, 2 at least.
    """
    torques, stiffness, energy = actuator.elastic_torques, actuator.stiffness, energy_law(actuator)
    count = len(actuator.parameters)

    def laws(q: float, s: Any, thetas: int, p: Any, law: int, result: int, whole: int) -> None:
        positions, parameters = s[thetas : thetas + motors], tuple(p[law : law + count])
        try:
            found = torques(q, *positions, parameters)
            if whole:
                s[STIFFNESS], s[LAW_ENERGY] = stiffness(q, *positions, parameters), energy(q, *positions, parameters)
            s[result : result + motors] = found
        except UNDEFINED:
            s[result] = math.nan

    return laws
