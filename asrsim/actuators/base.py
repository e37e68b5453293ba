"""The interface of an actuator: named parameters, and three laws that are functions of numbers and need no engine.

The laws are static methods that take floats and use only the module `math` and the functions of this module, so that the
interpreted and the compiled loop run the same source with identical bits. A law receives `parameters` as a tuple of floats, in
the order of the class attribute `parameters`.

    class MyVsa(Antagonistic):
        name = "my_vsa"                     # found by libmy_vsa_plugin.so
        title = "My variable-stiffness actuator"
        source = "Me et al. (2026), eq. 4"
        motors = 2
        parameters = (Parameter(name="k", default=10.0, unit="N m/rad^3", doc="cubic stiffness"), max_deflection(0.5))

        @staticmethod
        def elastic_torques(q, theta_1, theta_2, parameters):
            k, limit = parameters
            ...
            return tau_1, tau_2
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from math import copysign, exp
from typing import TYPE_CHECKING, ClassVar

from asrsim.actuators.parameters import Parameter, numbered
from asrsim.actuators.stages import STAGES

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


class Actuator:
    """Base of all actuators. Subclasses are declarations: they have no state and are never instantiated."""

    name: ClassVar[str]
    """Registry name; a URDF file refers to the actuator as `lib<name>_plugin.so`."""
    title: ClassVar[str]
    """Name for display."""
    source: ClassVar[str]
    """Paper or datasheet that publishes the law."""
    law: ClassVar[str] = ""
    """The elastic law as text, which the command `asrsim actuators` prints."""
    motors: ClassVar[int] = 2
    """Number of motors with dynamics. With three or more motors, laws also take `theta_3` and so on, and the class must define
    `elastic_energy`."""
    housed: ClassVar[int] = 0
    """Number of motors that are mounted on the housing of the actuator, such as a motor that preloads springs. They are the
    last motors. Their angles are relative to the housing, and the torques of the springs on them do not act on the link. The
    class must define `elastic_energy`."""
    adjuster: ClassVar[bool] = False
    """Whether the second reference directly sets the position of an adjuster (`theta_2` of the laws), which has no motor (paper
    section 2.3)."""
    reference_2_unit: ClassVar[str] = "rad"
    parameters: ClassVar[tuple[Parameter, ...]] = ()
    """Parameters of the spring; `all_parameters` adds the parameters of motors and controllers."""
    typical_preset: ClassVar[float] = 0.0
    """A moderate value of the second reference (preset, adjuster), for starter scenarios and checks."""
    preset_range: ClassVar[tuple[float, float] | None] = None
    """Smallest and largest second reference in a data sheet, in `reference_2_unit`; None: from 0 to the largest value that
    springs and motors allow."""

    @staticmethod
    def elastic_torques(q: float, theta_1: float, theta_2: float, parameters: tuple[float, ...]) -> tuple[float, float]:
        """Torques of the springs on motors 1 and 2 in N m; the sum of the torques, without the torques on `housed` motors, acts
        on the link. With one spring, the second torque is 0.

        q: link position in rad; theta_1, theta_2: motor positions in rad (position of an adjuster: in `reference_2_unit`). A
        spring between the motors (the term g(theta_1, theta_2) below eq. 6 of the paper) adds g to one torque and subtracts g
        from the other torque.
        """
        raise NotImplementedError

    @staticmethod
    def stiffness(q: float, theta_1: float, theta_2: float, parameters: tuple[float, ...]) -> float:
        """Stiffness -d tau_q / dq in N m/rad, where tau_q is the torque of the springs on the link. As in the toolbox, the
        stiffness does not drop to 0 beyond the deflection limit, although the torque is constant there."""
        raise NotImplementedError

    @staticmethod
    def elastic_energy(q: float, theta_1: float, theta_2: float, parameters: tuple[float, ...]) -> float:
        """Energy of the springs in J. The derivatives of the energy with respect to theta_1, theta_2 and -q are the torques.
        For a class without this law, the energy is the integral of the torques (`asrsim.actuators.vectorised`).
        """
        raise NotImplementedError

    @staticmethod
    def motor_references(equilibrium: float, preset: float) -> tuple[float, float]:
        """Motor positions in rad for an equilibrium position in rad and a stiffness preset (the reference map)."""
        return equilibrium, preset

    @staticmethod
    def equilibrium_position(theta_1: float, theta_2: float) -> float:
        """Position in rad at which the unloaded link rests: the inverse of the reference map."""
        return theta_1

    @classmethod
    def is_housed(cls, index: int) -> bool:
        """Whether motor 0, 1, ... is mounted on the housing."""
        return cls.motors - cls.housed <= index < cls.motors

    @classmethod
    def on_link(cls, torques: NDArray[np.float64]) -> NDArray[np.float64]:
        """Torque (...) on the link in N m, for the torques (springs, ...) of the springs on the motors in N m."""
        total: NDArray[np.float64] = torques[: len(torques) - cls.housed].sum(axis=0)
        return total

    @classmethod
    def positions(cls) -> int:
        """Number of motor and adjuster positions that the laws take: at least two."""
        return max(2, cls.motors + cls.adjuster)

    @classmethod
    def all_parameters(cls) -> tuple[Parameter, ...]:
        """All parameters, in the order: spring, stages, motors, controllers."""
        parts = [numbered(part, index) for part in ("motor", "controller") for index in range(1, cls.motors + 1)]
        stages = (stage.parameters for stage in STAGES.loaded())
        return (*cls.parameters, *itertools.chain(*stages, *parts))

    @classmethod
    def law_values(cls, values: Mapping[str, float]) -> tuple[float, ...]:
        """Values of the spring parameters, in the order in which the laws take them."""
        return tuple(values[parameter.name] for parameter in cls.parameters)


class Antagonistic(Actuator):
    """Base of actuators with two motors against each other: the preset moves the motors apart."""

    @staticmethod
    def motor_references(equilibrium: float, preset: float) -> tuple[float, float]:
        return equilibrium + preset, equilibrium - preset

    @staticmethod
    def equilibrium_position(theta_1: float, theta_2: float) -> float:
        return 0.5 * (theta_1 + theta_2)


def saturate(value: float, limit: float) -> float:
    """`value` clipped to [-limit, limit], as the paper clips deflections."""
    if value > limit:
        return limit
    if value < -limit:
        return -limit
    return value


def sinh(value: float) -> float:
    """Hyperbolic sine, odd to the bit, with a relative error of 1e-15 at most.

    One exponential takes half the time of `math.sinh`, and compiled code shares the exponential with `cosh`. Near 0, where the
    difference of the exponentials would lose digits, the function is a Taylor polynomial.
    """
    growing, square = exp(abs(value)), value * value
    if square < 0.0625:
        return value * (
            1 + square * (1 / 6 + square * (1 / 120 + square * (1 / 5040 + square * (1 / 362880 + square / 39916800))))
        )
    return copysign(0.5 * (growing - 1.0 / growing), value)


def cosh(value: float) -> float:
    """Hyperbolic cosine, even to the bit. Like `sinh`, this function computes one exponential."""
    growing = exp(abs(value))
    return 0.5 * (growing + 1.0 / growing)


def max_deflection(default: float) -> Parameter:
    """The parameter `max_deflection`: beyond this deflection the torque of a spring stays constant."""
    return Parameter(
        name="max_deflection",
        default=default,
        unit="rad",
        doc="largest deflection; larger deflections are clipped",
        minimum=0.0,
        exclusive_minimum=True,
    )
