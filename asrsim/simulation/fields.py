"""Records of the state, the constants and the kind of a joint, of a motor and of a stepping. Each number is declared once, with
its unit and meaning.

The classes are the records that the kernel uses: `joint.now.applied`, `motor.velocity`, `drive.inertia`. In plain Python the
records are objects. In compiled code a record is an address in a table of numbers (`asrsim.simulation.native`), and the names
are places in memory. The tables S (state) and P (constants) contain a row of numbers for each joint of each world: the joint's
record, the records of its motors, and numbers whose count depends on the robot (memory of sensors, parameters of the laws).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from asrsim.actuators.motor import MotorConstants
from asrsim.actuators.stages import Kick, Stage
from asrsim.records import columns, constant, filled, numbers, record, several, value


@dataclass(slots=True)
class Pushes:
    """Torques that do work on a link."""

    applied: float = value("torque of the actuator on the link, after the effort limit", "N m", log="link_torque")
    torque: float = value("torque of the actuator on the link, before the effort limit", "N m")
    damping: float = value("torque of the link's damping", "N m", log="damping_torque")
    push: float = value("sum of the external torque and the torque of the passive spring", "N m")


@dataclass(slots=True)
class Works:
    """Work of each torque on a motor."""

    drive: float = value("work of the motor's torque", "J")
    loss: float = value("work lost to friction and damping", "J")
    spring: float = value("work against the spring", "J")


@dataclass(slots=True)
class MotorState:
    """State of a motor, or of an adjuster."""

    position: float = value("position of the motor at the beginning of the next substep", "rad")
    velocity: float = value("velocity of the motor after the last kick", "rad/s")
    anchor: float = value("position at which the bristles of the friction stick (Dahl's w)", "rad")
    integral: float = value("integral action of the motor's controller, in the unit of its command", "N m")
    theta: float = value("position at which the laws of the spring are evaluated", "rad")
    pull: float = value("torque of the motor's spring at theta", "N m")
    kick_position: float = value("position of the motor at the kick", "rad", log="motor_{}_position")
    mean_velocity: float = value("mean velocity of the motor over the kick", "rad/s", log="motor_{}_velocity")
    torque: float = value("torque of the motor after its limit", "N m", log="motor_{}_torque")
    friction: float = value("friction torque on the motor", "N m", log="friction_torque_{}")
    load: float = value("torque of the motor's spring", "N m", log="elastic_torque_{}")
    work: Works = record(Works, "since the last whole substep")
    row_work: Works = record(Works, "between the last two whole substeps")
    last_kick_position: float = value("position of the motor at the previous kick", "rad")
    kinetic: float = value("kinetic energy of the motor at its mean velocity", "J")
    at_limit: float = value("number of following energy balances that a limit affects; 2 after a kick at a limit", "")
    current: float = value("current of the winding", "A", log="motor_{}_current")
    voltage: float = value("voltage of the winding", "V", log="motor_{}_voltage")
    full_voltage: float = value("flag: 1 if the voltage of the winding was at its limit in the kick", "")
    last_power: float = value("heat loss of the winding at the previous kick", "W")
    last_velocity: float = value("velocity of the motor before the last kick", "rad/s")
    acceleration: float = value("acceleration in the last kick, for joints with stages", "rad/s^2")
    end: float = value("position of the motor-side end of the spring, after stages in series with the spring", "rad")
    parallel: float = value("part of `pull` that stages parallel to the spring cause", "N m")
    kick_parallel: float = value("torque of the stages parallel to the spring at the kick", "N m")
    last_kick_parallel: float = value("torque of the stages parallel to the spring at the previous kick", "N m")
    ground: float = value("torque of the stages between motor and ground", "N m")
    kick: Kick = record(Kick, "inputs of the stages' laws at the kick")
    limit: float = value("largest torque of the motor, for joints with stages", "N m")
    read_error: float = value("position error of the motor's sensor: measured minus true position", "rad")
    read_push: float = value("part of the command due to the error of the measured velocity", "N m")


@dataclass(slots=True)
class StageState:
    """State of a stage of a joint."""

    loss: float = value("energy that the stage has lost since the start", "J")
    motors: list[Any] = several("memory of the stage at each motor")


@dataclass(slots=True)
class JointState:
    """State of a joint."""

    position: float = value("position of the link", "rad", log="link_position")
    engine_velocity: float = value("velocity of the link in the engine: half a substep late in staggered steppings", "rad/s")
    last_engine_velocity: float = value("velocity of the link in the engine at the previous substep", "rad/s")
    velocity: float = value("velocity of the link at the whole substep", "rad/s", log="link_velocity")
    integral: float = value("integral action of the link's controller (mode 1)", "N m")
    last_position: float = value("position of the link at the previous substep", "rad")
    brake: float = value(
        "derivative gain of the link's controller that acts in this kick; 0 beyond the effort limit", "N m s/rad"
    )
    drag: float = value("viscous damping of the link in this kick", "N m s/rad")
    jumped: float = value("flag: 1 if an input jumped in the last substep, else 0", "")
    now: Pushes = record(Pushes, "values at the time of the substep", log=True)
    before: Pushes = record(Pushes, "means over the half kick before the time of the substep, if an input jumps in the kick")
    following: Pushes = record(Pushes, "means over the half kick after the time of the substep, if an input jumps in the kick")
    last: Pushes = record(Pushes, "means over the half kick after the time of the previous substep")
    free: float = value("flag: 1 if the derivative action (`brake`) acts at the time of the whole substep, else 0", "")
    free_before: float = value("fraction of the half kick before the whole substep in which the derivative action acts", "")
    free_after: float = value("fraction of the half kick after the whole substep in which the derivative action acts", "")
    link_work: float = value("work of the actuator on the link since the start", "J", log="link_work", watched=True)
    limit_loss: float = value("work that the effort limit prevented", "J", log="limit_loss", watched=True)
    damping_loss: float = value("energy lost in the link's damping", "J", log="damping_loss", watched=True)
    motor_work: float = value("work of the motors", "J", log="motor_work", watched=True)
    friction_loss: float = value(
        "energy lost by the motors' friction and damping, and at their limits", "J", log="friction_loss", watched=True
    )
    winding_loss: float = value("heat of the windings", "J", log="winding_loss", watched=True)
    stage_loss: float = value("energy lost in the stages", "J")
    stage_energy: float = value("energy stored in the stages", "J")
    stage_lost: float = value("energy lost in the stages since the previous substep", "J")
    kick_velocity: float = value("velocity of the link at the kick, estimated before the kick, for joints with stages", "rad/s")
    kick_lead: float = value("time from the velocities of the motors to their kick; after the kick: length of the substep", "s")
    kick_since: float = value("time since the last kick; 0 at the first kick, for joints with stages", "s")
    steady: float = value("number of kicks since an input jumped, at most 2, for joints with stages", "")
    spring_energy: float = value("energy stored in the springs", "J", log="spring_energy", watched=True)
    motor_energy: float = value("kinetic energy of the motors", "J")
    start_energy: float = value("energy of springs and motors at the start", "J")
    residual: float = value(
        "motor work - losses - change of the stored energy - link work", "J", log="energy_residual", watched=True
    )
    net_link_work: float = value("work of actuator and external torques on the link, minus the damping loss of the link", "J")
    turnover: float = value("sum of the magnitudes of all work at the joint", "J")
    excess: float = value("largest value so far of |residual| - SHARE * turnover", "J")
    stiffness: float = value("stiffness of the spring", "N m/rad", log="stiffness", watched=True)
    law_energy: float = value("result of the spring's energy law in its last call, without stages", "J")
    stiffest: float = value("largest stiffness so far", "N m/rad")
    effort_count: float = value("number of substeps in which the effort limit clipped the torque", "")
    velocity_count: float = value("number of substeps beyond the link's velocity limit", "")
    saturation_count: float = value("number of substeps with a motor at its largest torque, current or voltage", "")
    motor_stop_count: float = value("number of substeps with a motor at its position stop", "")
    motor_speed_count: float = value("number of substeps with a motor at its speed limit", "")
    deflection_count: float = value("number of substeps with a spring beyond its largest deflection", "")
    stop_count: float = value("number of substeps with the link at its position stop", "")
    motors: list[MotorState] = several("motors of the joint")
    memory: list[float] = several("memory of the joint's sensors")
    stages: list[StageState] = several("state of the stages")


@dataclass(slots=True)
class JointConstants:
    """Constants of a joint."""

    effort: float = constant("effort limit", "N m")
    fastest: float = constant("velocity limit", "rad/s")
    cutoff: float = constant("flag: 1 if torque that acts beyond the velocity limit is set to 0, as in Gazebo, else 0", "")
    lowest: float = constant("largest position at which the link counts as being at its lower stop", "rad")
    highest: float = constant("smallest position at which the link counts as being at its upper stop", "rad")
    damping: float = constant("constant damping of the link", "N m s/rad")
    damping_ratio: float = constant("damping ratio of a damping that varies with the stiffness (paper section 4.2.2)", "")
    damping_inertia: float = constant("inertia to which the damping ratio refers", "kg m^2")
    brake: float = constant("derivative gain of the link's controller (mode 1)", "N m s/rad")
    spring: float = constant("stiffness of the passive spring", "N m/rad")
    rest: float = constant("rest position of the passive spring", "rad")
    coulomb: float = constant("Coulomb friction of the joint", "N m")
    stribeck: float = constant("Stribeck excess: static friction of the joint minus Coulomb friction", "N m")
    fade: float = constant("reciprocal of the Stribeck velocity", "s/rad")
    share: float = constant("fraction of the actuator's torque that adds to the friction", "")
    proportional: float = constant("proportional gain of the link's controller", "N m/rad")
    integral: float = constant("integral gain of the link's controller", "N m/(rad s)")
    derivative: float = constant("derivative gain of the link's controller, for sensors", "N m s/rad")
    substeps: float = constant("number of motor substeps per substep of the engine, an odd number", "")
    max_deflection: float = constant("largest deflection of the springs", "rad")
    sampled: float = constant(
        "flag: 1 if the sensors measure at ticks and hold the measurements, 0 if they measure at all times", ""
    )
    delay: float = constant("delay of the sensors in substeps", "")
    quantum: float = constant("resolution of the sensors", "rad")
    drives: list[MotorConstants] = several("constants of the joint's motors")
    law: Sequence[float] = several("parameters of the laws of the joint's spring")
    stages: list[list[Any]] = several("constants of the joint's stages at each motor; None where a stage does not act")


@dataclass(slots=True)
class JointKind:
    """Kind of a joint. The kind also contains the columns at which the parts of the joint's rows begin whose length depends on
    the robot."""

    sprung: int = constant("flag: 1 if springs load the link", "", integer=True)
    controlled: int = constant("flag: 1 if a controller loads the rigid link (mode 1)", "", integer=True)
    direct: int = constant("flag: 1 if the reference is the torque on the link (mode 0)", "", integer=True)
    positions: int = constant("number of positions that the laws of the spring take", "", integer=True)
    dynamic: int = constant("number of positions with motor dynamics; other positions equal their references", "", integer=True)
    springs: int = constant("number of springs, one for each motor", "", integer=True)
    pulling: int = constant(
        "number of torques of the springs that act on the link; the other torques act on the housing", "", integer=True
    )
    placed: int = constant("number of positions that change the springs' energy", "", integer=True)
    controllers: int = constant("number of controllers with sensors", "", integer=True)
    on_link: int = constant("flag: 1 if the sensors measure the link", "", integer=True)
    ring: int = constant("number of values in the memory of one sensor", "", integer=True)
    memory: int = constant("column of S at which the memory of the sensors begins", "", integer=True)
    law: int = constant("column of P at which the parameters of the laws begin", "", integer=True)
    spring_law: Any = constant("address of the laws of the spring; 0: none", "", integer=True)
    joint_step: Any = constant(
        "address of the function that advances the joint instead of the kernel; 0: none", "", integer=True
    )
    stages: int = constant("number of stages in the joint's law", "", integer=True)
    places: list[int] = several("location of the state of each stage: column of S; in plain Python, index in `stages`")


@dataclass(slots=True)
class Scheme:
    """Constants of a stepping."""

    step: float = constant("length of a substep", "s")
    weight_now: float = constant("weight of the engine's velocity in the velocity at the time of the substep", "")
    weight_last: float = constant("weight of the engine's previous velocity", "")
    first_drift: float = constant("fraction of a motor's step before its kick", "")
    implicitness: float = constant("implicitness of the motors' damping", "")
    link_implicitness: float = constant("implicitness of the link's damping", "")
    staggered: float = constant("flag: 1 if velocities belong to half steps", "")


def joint_of_row(row: Sequence[float], motors: int, sensors: int, stages: Sequence[type[Stage]]) -> JointState:
    """State of a joint, from the numbers of a row of S. motors: number of motors in the row; sensors: number of values in the
    memory of the sensors; stages: stages in the row.
    """
    rest = iter(row)
    joint = filled(JointState, rest)
    joint.motors = [filled(MotorState, rest) for _ in range(motors)]
    joint.memory = [next(rest) for _ in range(sensors)]
    joint.stages = [StageState(next(rest), [filled(stage.Memory, rest) for _ in range(motors)]) for stage in stages]
    return joint


def row_of_joint(joint: JointState) -> list[float]:
    """Row of S of a joint."""
    row = [*numbers(joint), *(number for motor in joint.motors for number in numbers(motor)), *joint.memory]
    for stage in joint.stages:
        row += (stage.loss, *(number for memory in stage.motors for number in numbers(memory)))
    return row


def link_of_row(
    row: Sequence[float], motors: int, parameters: int, springs: int, stages: Sequence[type[Stage]]
) -> JointConstants:
    """Constants of a joint, from the numbers of a row of P. motors: number of motors in the row; parameters: number of
    parameters of the joint's laws; springs: number of motors of the joint; stages: stages of the joint.
    """
    rest = iter(row)
    link = filled(JointConstants, rest)
    link.drives = [filled(MotorConstants, rest) for _ in range(motors)]
    link.law = tuple(next(rest) for _ in range(parameters))
    for stage in stages:
        link.stages.append(
            [own if acts else None for acts, own in ((next(rest), filled(stage.Constants, rest)) for _ in range(springs))]
        )
    return link


def columns_of_stages(stages: Sequence[type[Stage]], motors: int) -> int:
    """Number of columns of a row of P with the constants of the stages of a joint. motors: number of motors of the joint."""
    return sum(motors * (1 + len(columns(stage.Constants))) for stage in stages)


def row_of_link(link: JointConstants, stages: Sequence[type[Stage]]) -> list[float]:
    """Row of P of a joint's constants. The constants of a stage at a motor follow a flag: 1 if the stage acts at this motor,
    else 0.
    """
    row = [*numbers(link), *(number for drive in link.drives for number in numbers(drive)), *link.law]
    for stage, motors in zip(stages, link.stages, strict=True):
        for own in motors:
            row += (0.0, *[0.0] * len(columns(stage.Constants))) if own is None else (1.0, *numbers(own))
    return row


JOINT = columns(JointState)
"""Column of S for each number of a joint's state."""


def motor_column(name: str, i: int) -> int:
    """Column of S for a number of the state of motor i = 0, 1, ..."""
    return len(JOINT) + i * len(columns(MotorState)) + columns(MotorState)[name]
