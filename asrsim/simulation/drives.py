"""A joint made ready to run: its kind of step, constants for any step length, initial state."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from asrsim.actuators import Actuator, Mode
from asrsim.actuators.detailed_motor import Electric
from asrsim.actuators.drive import Drive
from asrsim.robot import drive_of
from asrsim.robot.model import ActuatorBlock, Joint, Robot
from asrsim.samples import Array
from asrsim.scenario.data import LinkDamping, for_joint
from asrsim.simulation import kernels, toolbox
from asrsim.simulation.kernels import Advance
from asrsim.simulation.steppings import Stepping


@dataclass(frozen=True, kw_only=True)
class SteppedJoint:
    """One moving joint with what drives it, if anything does, and its kind of step."""

    joint: Joint
    drive: Drive | None
    """None: without plugin."""
    stepping: Stepping
    initial_position: float
    motor_positions: tuple[float, ...] | None = None
    """rad at the start; None: where the unloaded link rests, so that a run does not begin with a jerk."""
    motor_velocities: tuple[float, ...] | None = None
    """rad/s at the start; None: at rest."""
    integrals: tuple[float, ...] = ()
    """N m that the controllers' integral action gives at the start; none: 0."""
    link_damping: LinkDamping | None = None
    block: ActuatorBlock | None = None
    advance: Advance = field(init=False)
    initial_state: tuple[float, ...] = field(init=False)

    def __post_init__(self) -> None:
        advance, state = self._kind()
        object.__setattr__(self, "advance", advance)
        object.__setattr__(self, "initial_state", state)

    @property
    def name(self) -> str:
        """Name of the joint."""
        return self.joint.name

    @property
    def actuator(self) -> type[Actuator] | None:
        """None without plugin, as `mode` is."""
        return self.drive.actuator if self.drive else None

    @property
    def mode(self) -> Mode | None:
        """Of operation."""
        return self.drive.mode if self.drive else None

    @property
    def values(self) -> Mapping[str, float]:
        """Parameter values by name."""
        return self.drive.values if self.drive else {}

    @property
    def elastic(self) -> tuple[float, ...]:
        """Parameters of the spring in the order of its laws."""
        return self.drive.elastic if self.drive else ()

    @property
    def link_brake(self) -> float:
        """Derivative gain of the link's controller (mode 1) in N m s/rad; it acts in the loop, implicitly, as damping does."""
        if self.mode is None or self.mode.number != 1 or self.stepping.released:
            return 0.0
        return self.values["controller_1_derivative"]

    @property
    def constant_damping(self) -> float:
        """N m s/rad of the link, but for what depends on the stiffness."""
        return self.joint.damping + (self.link_damping.constant if self.link_damping else 0.0)

    @property
    def elastic_of(self) -> Callable[[Any], Any]:
        """Constants of `advance` -> parameters of the spring."""
        if self.stepping.released or (self.hysteresis and not self.dynamic_motors):
            return _first
        return _third if self.dynamic_motors else _all

    @property
    def derivative_gains(self) -> tuple[float, ...]:
        """N m s/rad of the controllers of motors or link, 0 where there is none."""
        if self.mode is None or not self.mode.controller:
            return (0.0, 0.0)
        gains = [self.values.get(f"controller_{index}_derivative", 0.0) for index in (1, 2)]
        return (gains[0], gains[1] if self.dynamic_motors > 1 else 0.0)

    @property
    def hysteresis(self) -> tuple[float, float] | None:
        """Level (N m) and length (rad) of the springs' hysteresis; None where there is none. The released code knows none."""
        return self.drive.hysteresis if self.drive and not self.stepping.released else None

    @property
    def detailed(self) -> bool:
        """The motors have more than the toolbox's: see :mod:`asrsim.actuators.detailed_motor`."""
        return self.drive is not None and self.drive.detailed and not self.stepping.released

    def electric(self, index: int) -> Electric:
        """How motor `index` (1 or 2), which has dynamics, makes torque of its command."""
        assert self.drive is not None
        return self.drive.electric[index - 1]

    @property
    def electric_motors(self) -> tuple[int, ...]:
        """Numbers of the motors that have a torque constant."""
        motors = 0 if self.stepping.released else self.dynamic_motors
        return tuple(i for i in range(1, motors + 1) if self.values[f"motor_{i}_torque_constant"] > 0.0)

    @property
    def dynamic_motors(self) -> int:
        """Motors with dynamics in this mode."""
        return self.drive.dynamic_motors if self.drive else 0

    def _kind(self) -> tuple[Advance, tuple[float, ...]]:
        drive = self.drive
        if self.stepping.released:
            advance, idle = toolbox.make_toolbox_advance(self.actuator, self.mode)
            asked = self.motor_positions or self.motor_velocities
            start = self.integrals if len(idle) == 1 else [x for motor in self._motors() for x in motor] if asked else ()
            return advance, (*start, *idle[len(start) :])[: len(idle)]
        if drive is None:
            return kernels.advance_passive, ()
        if drive.mode.number == 0:
            return kernels.advance_torque, ()
        if drive.mode.number == 1:
            return kernels.advance_link_controller, (self.integrals or (0.0,))[:1]
        law, springs = drive.actuator.elastic_torques, drive.actuator.motors
        bristles: tuple[float, ...] = ()
        if self.hysteresis:
            law = kernels.make_hysteretic_torques(law, springs)
            bristles = (0.0, math.nan) * springs
        if not drive.mode.motor:
            ideal = kernels.make_advance_ideal(law)
            return (kernels.make_hysteretic_ideal(ideal) if bristles else ideal), bristles
        state = tuple(number for motor in self._motors()[:springs] for number in motor) + bristles
        if springs == 1:
            one = kernels.make_advance_one_motor(law, drive.motor_kick)
            return (kernels.make_hysteretic_one_motor(one) if bristles else one), state
        two = kernels.make_advance_two_motors(law, drive.motor_kick)
        return (kernels.make_hysteretic_two_motors(two) if bristles else two), state

    def _motors(self) -> list[tuple[float, ...]]:
        """Of each motor at the start: position, velocity, where Dahl's bristles stick, the controller's integral."""
        assert self.drive is not None
        positions = self.motor_positions or (self.initial_position,) * 2
        velocities = (*(self.motor_velocities or ()), 0.0, 0.0)
        # Integrals are in units of the command: V or A of electric motors.
        units = [electric.gain or 1.0 for electric in self.drive.electric]
        integrals = [*(torque / unit for torque, unit in zip(self.integrals, units, strict=False)), 0.0, 0.0]
        return list(zip(positions, velocities, positions, integrals, strict=False))

    def goals(self, reference_1: Array, reference_2: Array) -> tuple[Array, Array]:
        """What `advance` takes for references, arrays (n,): through the reference map in modes 3 and 6."""
        return self.drive.goals(reference_1, reference_2) if self.drive else (reference_1, reference_2)

    def constants(self, step: float) -> Any:
        """Constants of `advance` for a step of `step` s of motors and controllers."""
        drive = self.drive
        if drive is None or drive.mode.number == 0:
            return ()
        if self.stepping.released:
            return toolbox.toolbox_constants(drive.actuator, drive.values, drive.mode, step)
        if drive.mode.number == 1:
            return drive.proportional[0], drive.integral[0] * step
        bristles = self.hysteresis or ()
        if not drive.mode.motor:
            return (drive.elastic, *bristles) if bristles else drive.elastic
        before = self.stepping.first_drift * step
        constants: list[Any] = [before, step - before, drive.elastic]
        for index, ends in enumerate(drive.motor_ranges, start=1):
            coefficients = drive.motor_coefficients(index, step=step, implicitness=self.stepping.implicitness)
            constants += [coefficients, *ends, self.values[f"motor_{index}_max_velocity"]]
        return (*constants, *bristles)

    @property
    def kind(self) -> tuple[str, bool, bool]:
        """What a loop is built for, beside numbers: joints of other kinds need a loop of their own."""
        return self.advance.__qualname__, self.detailed, self.hysteresis is not None


def _all(constants: Any) -> Any:
    return constants


def _first(constants: Any) -> Any:
    return constants[0]


def _third(constants: Any) -> Any:
    return constants[2]


def make_drives(
    robot: Robot,
    stepping: Stepping,
    *,
    initial_positions: Mapping[str, float],
    link_damping: Mapping[str, LinkDamping],
    motor_positions: Mapping[str, tuple[float, ...]] | None = None,
    motor_velocities: Mapping[str, tuple[float, ...]] | None = None,
) -> tuple[SteppedJoint, ...]:
    """Each moving joint of `robot` with its drive, in its order."""
    blocks = {block.joint: block for block in robot.actuators}
    drives = []
    for joint in robot.moving_joints:
        block = blocks.get(joint.name)
        drives.append(
            SteppedJoint(
                joint=joint,
                drive=drive_of(block) if block else None,
                stepping=stepping,
                initial_position=float(for_joint(initial_positions, joint.name, 0.0)),
                motor_positions=for_joint(motor_positions or {}, joint.name),
                motor_velocities=for_joint(motor_velocities or {}, joint.name),
                link_damping=for_joint(link_damping, joint.name) if block else None,
                block=block,
            )
        )
    return tuple(drives)
