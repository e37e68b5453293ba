"""A joint that is ready to run, with its drive, its initial state and the ranges of its references."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from asrsim.actuators import ACTUATORS, Actuator, Mode
from asrsim.actuators.drive import Drive
from asrsim.actuators.electric import largest_command
from asrsim.actuators.stages import STAGES, Stage
from asrsim.errors import InputError
from asrsim.quantities import MOST_MOTORS
from asrsim.registry.steppings import Stepping
from asrsim.robot import drive_of
from asrsim.robot.model import ActuatorBlock, Joint, Robot
from asrsim.samples import Array
from asrsim.scenario.data import Imperfections, LinkDamping, Scenario, for_joint
from asrsim.scenario.starts import start_positions, start_velocities
from asrsim.simulation.imperfections import Noise, Sensor

EXTERNAL_TORQUE = "external_torque"
"""Name under which callers set the external torque on a link, as they set a reference."""
TURN = math.pi
"""Range in each direction of a joint without limits, rad."""
LEVER_SHARE = 0.5
"""Largest position of an adjuster, as a fraction of the lever length at which the stiffness becomes infinite."""

COMMAND_DELAY, SENSOR_DELAY = DELAYS = "command_delay", "sensor_delay"
"""Names of the delays of a joint's commands and of its sensors. A prepared scenario can vary the delays as parameters."""

Range = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class SteppedJoint:
    """One moving joint with its drive, if it has one."""

    joint: Joint
    drive: Drive | None
    """Drive of the joint; None for a joint without actuator plugin."""
    stepping: Stepping
    initial_position: float
    stated_position: float = 0.0
    """Initial position from the scenario or the robot's file, rad (m). References without a signal stay at this position."""
    initial_velocity: float = 0.0
    motor_positions: tuple[float, ...] = ()
    """Initial positions of the motors in rad; empty: the positions at which the springs are unloaded, so that runs begin
    smoothly."""
    motor_velocities: tuple[float, ...] = ()
    """Initial velocities of the motors in rad/s; empty: the motors start at rest."""
    integrals: tuple[float, ...] = ()
    """Torques in N m of the controllers' integral action at the start; empty: 0."""
    link_damping: LinkDamping | None = None
    command_imperfections: Imperfections | None = None
    """Imperfections of the joint's commands; None: the commands act as they are sent."""
    sensor: Sensor | None = None
    """Encoders of the joint's controllers; None: the controllers use the true values."""
    block: ActuatorBlock | None = None

    @property
    def name(self) -> str:
        """Name of the joint."""
        return self.joint.name

    @property
    def actuator(self) -> type[Actuator] | None:
        """Actuator of the joint; None without plugin."""
        return self.drive.actuator if self.drive else None

    @property
    def mode(self) -> Mode | None:
        """Operation mode of the joint; None without plugin."""
        return self.drive.mode if self.drive else None

    @property
    def values(self) -> Mapping[str, float]:
        """Values of the actuator's parameters, by name."""
        return self.drive.values if self.drive else {}

    @property
    def elastic(self) -> tuple[float, ...]:
        """Parameters of the spring in the order of its laws."""
        return self.drive.elastic if self.drive else ()

    @property
    def link_brake(self) -> float:
        """Derivative gain of the link's controller (mode 1) in N m s/rad; the loop applies this gain implicitly, like
        damping.
        """
        if self.mode is None or self.mode.number != 1 or self.stepping.released:
            return 0.0
        return self.values["controller_1_derivative"]

    @property
    def constant_damping(self) -> float:
        """Viscous damping of the link in N m s/rad, without the part that depends on the stiffness."""
        return self.joint.damping + (self.link_damping.constant if self.link_damping else 0.0)

    @property
    def stages(self) -> tuple[type[Stage], ...]:
        """Stages that act on the joint; no stages in the released order."""
        return tuple(map(STAGES.get, self._stages))

    def stage_constants(self, stage: type[Stage], motor: int) -> Any:
        """Constants of a stage at motor 1, 2, ...; None where the stage does not act."""
        own = self._stages.get(stage.name, ())
        return own[motor - 1] if motor <= len(own) else None

    @property
    def _stages(self) -> Mapping[str, tuple[Any, ...]]:
        return self.drive.stages if self.drive and not self.stepping.released else {}

    @property
    def electric_motors(self) -> tuple[int, ...]:
        """Numbers of the motors that have a torque constant."""
        motors = 0 if self.stepping.released else self.dynamic_motors
        return tuple(i for i in range(1, motors + 1) if self.values[f"motor_{i}_torque_constant"] > 0.0)

    @property
    def dynamic_motors(self) -> int:
        """Number of motors that have dynamics in this mode."""
        return self.drive.dynamic_motors if self.drive else 0

    @property
    def references(self) -> tuple[str, ...]:
        """Names of the joint's references, in the order of the columns of an input row."""
        return self.drive.mode.references_of(self.drive.actuator.motors) if self.drive else ()

    @property
    def acting_references(self) -> tuple[str, ...]:
        """References that have an effect: an actuator with one motor and no adjuster ignores the second reference."""
        return self.references if self.actuator and self.actuator.motors + self.actuator.adjuster > 1 else self.references[:1]

    @property
    def motors(self) -> int:
        """Number of motors of the joint's actuator."""
        return self.actuator.motors if self.actuator else 0

    @property
    def placed(self) -> int:
        """Number of motors and adjusters whose positions deflect springs."""
        return self.actuator.motors + self.actuator.adjuster if self.actuator and self.mode and self.mode.spring else 0

    @property
    def pulling(self) -> int:
        """Number of torques of the spring's law that act on the link."""
        return max(2, self.actuator.motors) - self.actuator.housed if self.placed and self.actuator else 0

    @property
    def positions(self) -> int:
        """Number of motor positions that the spring's law takes: at least two."""
        return self.actuator.positions() if self.actuator else 2

    def motor_starts(self, count: int) -> list[tuple[float, ...]]:
        """Initial values of `count` motors: position (rad), velocity (rad/s), anchor of the friction's bristles (rad), integral
        of the controller (in units of the command). Motors start at the link's position. Motors on the housing, and all motors
        in the released order, start at 0.
        """
        at = 0.0 if self.stepping.released and not (self.motor_positions or self.motor_velocities) else self.initial_position
        usual = [0.0 if self.actuator and self.actuator.is_housed(index) else at for index in range(count)]
        positions = (*self.motor_positions, *usual[len(self.motor_positions) :])[:count]
        velocities = (*self.motor_velocities, *[0.0] * count)[:count]
        units = [electric.gain or 1.0 for electric in self.drive.electric] if self.drive else []
        integrals = [*(torque / unit for torque, unit in zip(self.integrals, units, strict=False)), *[0.0] * count][:count]
        return list(zip(positions, velocities, positions, integrals, strict=True))

    def goals(self, references: Array) -> Array:
        """Goal positions of the motors or springs for the references (columns, n); modes 3 and 6 use the reference map."""
        return self.drive.goals(references) if self.drive else references


def make_drives(robot: Robot, stepping: Stepping, scenario: Scenario) -> tuple[SteppedJoint, ...]:
    """All moving joints of `robot` with their drives and the scenario's initial state, in the order of the robot."""
    blocks = {block.joint: _of_toolbox(block) if stepping.released else block for block in robot.actuators}
    positions = start_positions(scenario, robot)
    velocities = start_velocities(scenario, robot, positions)
    drives = []
    for joint in robot.moving_joints:
        block = blocks.get(joint.name)
        imperfections = for_joint(scenario.command_imperfections, joint.name)
        drives.append(
            SteppedJoint(
                joint=joint,
                drive=drive_of(block) if block else None,
                stepping=stepping,
                initial_position=positions[joint.name],
                stated_position=positions[joint.name],
                initial_velocity=velocities[joint.name],
                motor_positions=for_joint(scenario.initial_motor_positions, joint.name, ()),
                motor_velocities=for_joint(scenario.initial_motor_velocities, joint.name, ()),
                link_damping=for_joint(scenario.link_damping, joint.name) if block else None,
                command_imperfections=imperfections if imperfections is not None and imperfections.active else None,
                block=block,
            )
        )
    return tuple(drives)


def _of_toolbox(block: ActuatorBlock) -> ActuatorBlock:
    """The block without the effects that the toolbox lacks. The parameters of these effects get their defaults, which switch
    the effects off.
    """
    declared = ACTUATORS.get(block.actuator).all_parameters()
    off = {one.name: replace(block.parameters[one.name], value=one.default) for one in declared if one.optional}
    return replace(block, parameters={**block.parameters, **off})


def with_sensors(drives: Sequence[SteppedJoint], scenario: Scenario, substep: float) -> tuple[SteppedJoint, ...]:
    """The joints with the sensors of their controllers, if the sensors are imperfect. substep: length of a substep in s."""
    found = []
    for j, drive in enumerate(drives):
        imperfections, sensor = for_joint(scenario.sensor_imperfections, drive.name), None
        if imperfections is not None and imperfections.active and drive.mode is not None and drive.mode.controller:
            encoders = range(max(drive.dynamic_motors, 1))
            # The noise generators of encoders have numbers of MOST_MOTORS or more. Lower numbers belong to the commands.
            seeds = ((scenario.seed, j, MOST_MOTORS + i) for i in encoders)
            sensor = Sensor(
                imperfections=imperfections,
                step=scenario.step,
                substep=substep,
                on_link=not drive.mode.motor,
                noises=tuple(Noise(seed, imperfections.noise) if imperfections.noise else None for seed in seeds),
            )
        found.append(drive if sensor is drive.sensor else replace(drive, sensor=sensor))
    return tuple(found)


def command_delays(drives: Sequence[SteppedJoint]) -> list[float]:
    """Delay of each joint's commands, s."""
    return [drive.command_imperfections.delay if drive.command_imperfections else 0.0 for drive in drives]


def with_delays(drive: SteppedJoint, delays: Mapping[str, float]) -> SteppedJoint:
    """The joint with other delays in s, by name (`DELAYS`). Raises InputError.

    The size of the sensors' memory follows from the scenario, so that a delay cannot be longer than the scenario's delay.
    """
    for name, value in delays.items():
        commands = name == COMMAND_DELAY
        imperfections = drive.command_imperfections if commands else drive.sensor.imperfections if drive.sensor else None
        longest = imperfections.delay if imperfections else 0.0
        if imperfections is None or not 0.0 <= value <= longest:
            message = f"must be 0 to {longest:g} s, the delay that the scenario states"
            hint = f"State the longest delay under imperfections.{'commands' if commands else 'sensors'}"
            raise InputError(message, key=f"{drive.name}.{name}", value=value, hint=hint, code="parameter-range")
        other = replace(imperfections, delay=float(value))
        if commands:
            drive = replace(drive, command_imperfections=other)
        elif drive.sensor:
            drive = replace(drive, sensor=replace(drive.sensor, imperfections=other))
    return drive


def ranges_of(scenario: Scenario, drives: Sequence[SteppedJoint]) -> dict[str, dict[str, Range]]:
    """Smallest and largest value of each reference, by joint and reference. The values come from the scenario, or from the
    robot's limits if the scenario states no values. External torques are included if the robot's file subscribes to them or the
    scenario declares their range.
    """
    found: dict[str, dict[str, Range]] = {}
    for drive in drives:
        declared = scenario.ranges_of(drive.name)
        own = {name: declared.get(name) or _default(drive, slot) for slot, name in enumerate(drive.acting_references)}
        if EXTERNAL_TORQUE in declared or (drive.block is not None and drive.block.subscribe_external_torque):
            own[EXTERNAL_TORQUE] = declared.get(EXTERNAL_TORQUE) or _torque(drive)
        found[drive.name] = own
    return found


def _default(drive: SteppedJoint, slot: int) -> Range:
    mode, actuator, values = drive.mode, drive.actuator, drive.values
    if mode is None or actuator is None or mode.number == 0:
        return _torque(drive)
    if slot == 1 and actuator.adjuster:
        return 0.0, LEVER_SHARE * values.get("lever_length", math.inf)
    if mode.direct:
        most = largest_command(values, slot + 1, mode)
        return -most, most
    spread = values.get("max_deflection", 0.0) if mode.spring else 0.0
    if slot == 1 and mode.mapped:
        return -spread, spread
    joint = drive.joint
    low = -TURN if joint.lower is None else joint.lower
    high = TURN if joint.upper is None else joint.upper
    if mode.mapped or not mode.spring:
        return low, high
    if actuator.is_housed(slot):
        low = high = 0.0
    # A motor may be ahead of the link by the largest deflection of the spring, within the position limits of the motor.
    least, most = (values[f"motor_{slot + 1}_{end}_position"] for end in ("min", "max"))
    return max(low - spread, least), min(high + spread, most)


def _torque(drive: SteppedJoint) -> Range:
    return -drive.joint.most_effort, drive.joint.most_effort
