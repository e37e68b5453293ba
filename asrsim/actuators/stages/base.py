"""The interface of a stage: a part of an actuator beside its springs, such as a damper, with parameters, memory and laws.

The laws are static methods of numbers. They use only the module `math`, so that one source runs as Python, compiled, and on
Warp. A law receives the memory and the constants of the stage at one motor. A stage declares only the laws that it needs; laws
that it does not declare have no effect. Laws are combined when the robot is built: joints without the stage run none of its
code.

    class Slip(Stage):
        name = "slip"
        title = "Slip of the clutch"
        parameters = (Parameter(name="slip_damping", default=0.0, unit="N m s/rad", minimum=0.0, optional=True, doc="..."),)
        Constants = SlipConstants          # a dataclass with slots of `asrsim.records.constant`

        @classmethod
        def constants(cls, values, motor, mode):
            damping = values["slip_damping"]
            return SlipConstants(damping) if damping > 0.0 else None

        @staticmethod
        def torque(memory, own, deflection, velocity):
            return own.damping * velocity
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from asrsim.actuators.modes import Mode
from asrsim.actuators.parameters import Parameter
from asrsim.quantities import Quantity
from asrsim.records import value


@dataclass(slots=True)
class Kick:
    """Values that a stage receives in a kick of its motor. A kick is the change of all velocities in a substep."""

    motor_position: float = value("position of the motor", "rad")
    motor_velocity: float = value("velocity of the motor", "rad/s")
    deflection: float = value("motor position minus link position", "rad")
    velocity: float = value("rate of the deflection", "rad/s")
    motor_torque: float = value("torque of the motor after its limit; 0 without motor dynamics", "N m")
    elastic_torque: float = value(
        "torque between motor and link, of the spring and of the stages parallel to the spring", "N m"
    )
    step: float = value("time since the last kick; 0 at the first kick of a run", "s")
    next_step: float = value("time until the next kick", "s")


@dataclass(slots=True)
class NoMemory:
    """Memory of a stage that remembers nothing."""


class Stage:
    """Base of all stages. Subclasses are declarations: they have no state and are never instantiated."""

    name: ClassVar[str]
    """Name in the registry."""
    title: ClassVar[str]
    """Name for display."""
    source: ClassVar[str] = ""
    """Publication of the model."""
    parameters: ClassVar[tuple[Parameter, ...]] = ()
    """Parameters of the stage, which all motors of a joint share. While all parameters have their defaults, the stage must not
    act."""
    Memory: ClassVar[Any] = NoMemory
    """Record of the state of the stage at one motor: a dataclass with slots, whose numbers are declared by
    `asrsim.records.value`."""
    Constants: ClassVar[Any]
    """Record of the constants of the stage at one motor: a dataclass with slots, whose numbers are declared by
    `asrsim.records.constant`."""
    quantities: ClassVar[tuple[Quantity, ...]] = ()
    """Quantities that the stage adds to logs: the numbers of the memory that have a name in logs (`log=`), and `lost`."""
    lost: ClassVar[str] = ""
    """Name in logs of the energy that the stage has lost since the start, in J; empty for a stage without `loss`."""

    @classmethod
    def constants(cls, values: Mapping[str, float], motor: int, mode: Mode) -> Any:
        """Constants at motor 1, 2, ... for the values of the actuator's parameters; None where the stage does not act."""
        raise NotImplementedError

    @staticmethod
    def place(memory: Any, own: Any, deflection: float) -> float:
        """Law of a part in series with the spring, such as a play: deflection of the spring in rad for a deflection of the
        joint (motor minus link) in rad. The law must not decrease, and its slope must not exceed 1."""
        return deflection

    @staticmethod
    def torque(memory: Any, own: Any, deflection: float, velocity: float) -> float:
        """Torque in N m of a part parallel to the spring; a positive torque pulls the link towards the motor.

        deflection: motor minus link, rad; velocity: rate of the deflection, rad/s.
        """
        return 0.0

    @staticmethod
    def ground(memory: Any, own: Any, motor_position: float, motor_velocity: float, elastic_torque: float) -> float:
        """Torque in N m of a part between motor and ground. It acts on the motor only, and is positive if it brakes a positive
        velocity.

        motor_position: rad; motor_velocity: rad/s; elastic_torque: torque between motor and link, N m. The torque has no effect
        on a motor without dynamics (modes 2 and 3).
        """
        return 0.0

    @staticmethod
    def limit(memory: Any, own: Any, torque: float) -> float:
        """Largest torque of the motor in N m with the stage. torque: largest torque without the stage, N m."""
        return torque

    @staticmethod
    def remember(memory: Any, own: Any, kick: Kick) -> None:
        """Advance the memory to a kick of the motor. This law is called once per substep."""

    @staticmethod
    def energy(memory: Any, own: Any) -> float:
        """Energy in J that the stage itself stores, without the energy of the spring; called after `remember`."""
        return 0.0

    @staticmethod
    def loss(memory: Any, own: Any) -> float:
        """Energy in J that the stage has lost between the last two kicks, at least 0."""
        return 0.0

    @staticmethod
    def stiffness_bound(own: Any) -> float:
        """Largest stiffness in N m/rad that the stage adds: the slope of `torque` over the deflection."""
        return 0.0

    @staticmethod
    def damping_bound(own: Any) -> float:
        """Largest damping in N m s/rad that the stage adds: the slope of `torque` over the velocity."""
        return 0.0

    @staticmethod
    def ground_stiffness_bound(own: Any) -> float:
        """Largest slope of `ground` over the position of the motor, N m/rad."""
        return 0.0

    @staticmethod
    def ground_damping_bound(own: Any) -> float:
        """Largest slope of `ground` over the velocity of the motor, N m s/rad."""
        return 0.0

    @classmethod
    def has(cls, law: str) -> bool:
        """Whether the stage declares the law of this name."""
        return getattr(cls, law) is not getattr(Stage, law)
