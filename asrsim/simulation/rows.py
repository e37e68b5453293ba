"""Records of the joints at the start of a run, and the tables S, P and K that contain the records; see
`asrsim.simulation.fields`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from asrsim.actuators.motor import MotorConstants
from asrsim.actuators.stages import Stage
from asrsim.records import columns, numbers
from asrsim.samples import Array
from asrsim.scenario.kinds import RELEASED_MOTORS
from asrsim.simulation.drives import SteppedJoint
from asrsim.simulation.fields import JointConstants, JointKind, JointState, MotorState, Scheme, StageState, row_of_link
from asrsim.simulation.ledger import AT_STOP
from asrsim.simulation.prepared import Prepared
from asrsim.simulation.released import PHANTOM, PHANTOM_AWAS_II, PHANTOM_SEA
from asrsim.simulation.shape import RowShape

NO_MOTOR = MotorConstants(**dict.fromkeys(columns(MotorConstants), 0.0))
"""Constants that stand for a missing motor."""


def kind_of(drive: SteppedJoint, shape: RowShape, stages: Sequence[type[Stage]]) -> JointKind:
    """Kind of a joint that has the given stages; the addresses of its functions are not set yet."""
    mode, sensor = drive.mode, drive.sensor
    sprung = mode is not None and mode.spring
    controlled = mode is not None and not mode.spring and mode.controller
    return JointKind(
        sprung=int(sprung), controlled=int(controlled), direct=int(mode is not None and not (sprung or controlled)),
        positions=drive.positions, dynamic=drive.dynamic_motors, springs=drive.motors if drive.placed else 0,
        pulling=drive.pulling,
        placed=drive.placed, controllers=sensor.count if sensor else 0, on_link=int(sensor.on_link) if sensor else 0,
        ring=shape.ring, memory=shape.memory, law=shape.law, spring_law=0, joint_step=0, stages=len(stages),
        places=[shape.kept.index(stage) for stage in stages],
    )  # fmt: skip


def constants_of(
    drive: SteppedJoint, shape: RowShape, stages: Sequence[type[Stage]], *, motor_substeps: int, cutoff: bool
) -> JointConstants:
    """Constants of a joint that has the given stages."""
    joint, law, values, sensor = drive.joint, drive.link_damping, drive.values, drive.sensor
    follows = drive.mode is not None and drive.mode.spring
    low, high = joint.stops
    return JointConstants(
        effort=joint.most_effort, fastest=joint.velocity or np.inf, cutoff=float(cutoff), lowest=low + AT_STOP,
        highest=high - AT_STOP, damping=drive.constant_damping, damping_ratio=law.ratio if law and follows else 0.0,
        damping_inertia=law.inertia if law else 0.0, brake=drive.link_brake, spring=joint.spring_stiffness,
        rest=joint.spring_reference, coulomb=joint.friction, stribeck=joint.stribeck_friction,
        fade=1.0 / joint.stribeck_velocity, share=joint.load_friction,
        proportional=values.get("controller_1_proportional", 0.0), integral=values.get("controller_1_integral", 0.0),
        derivative=values.get("controller_1_derivative", 0.0),
        substeps=float(motor_substeps if drive.dynamic_motors else 1), max_deflection=values.get("max_deflection", np.inf),
        sampled=float(bool(sensor and sensor.imperfections.rate)),
        delay=sensor.delay if sensor else 0.0, quantum=sensor.imperfections.quantum if sensor else 0.0,
        drives=[_motor(drive, index) for index in range(1, shape.motors + 1)],
        law=[*map(float, drive.elastic)],
        stages=[[drive.stage_constants(stage, i) for i in range(1, drive.motors + 1)] for stage in stages],
    )  # fmt: skip


def _motor(drive: SteppedJoint, index: int) -> MotorConstants:
    """Constants of motor `index` (1, 2, ...)."""
    if index > drive.dynamic_motors:
        if drive.stepping.released and drive.dynamic_motors and drive.actuator and index <= RELEASED_MOTORS:
            return replace(NO_MOTOR, **(PHANTOM | (PHANTOM_AWAS_II if drive.actuator.adjuster else PHANTOM_SEA)))
        return NO_MOTOR
    assert drive.drive is not None
    constants = drive.drive.motor_constants(index)
    if index in drive.electric_motors:
        return constants
    return replace(constants, torque_constant=0.0, resistance=0.0)


def start_of(drive: SteppedJoint, shape: RowShape, position: float, velocity: float) -> JointState:
    """State of a joint at the start, with its link at `position` (rad) and `velocity` (rad/s)."""
    joint = JointState(position=position, engine_velocity=velocity, last_engine_velocity=velocity)
    mode = drive.mode
    if mode is not None and not mode.spring and mode.controller:
        joint.integral = (drive.integrals or (0.0,))[0]
    joint.motors = [MotorState() for _ in range(shape.motors)]
    starts = drive.motor_starts(shape.motors) if drive.dynamic_motors else []
    for motor, start in zip(joint.motors, starts, strict=False):
        motor.position, motor.velocity, motor.anchor, motor.integral = start
    sensor = drive.sensor
    for motor in joint.motors[: sensor.count] if sensor else ():
        # Fill the memory of a sensor with the position and velocity at the start.
        x, v = (position, velocity) if sensor.on_link else (motor.position, motor.velocity)  # type: ignore[union-attr]
        seen = [*[x, v] * sensor.memory, 0.0, x, v]  # type: ignore[union-attr]
        joint.memory += [*seen, *[0.0] * (shape.ring - len(seen))]
    joint.memory += [0.0] * (shape.sensors - len(joint.memory))
    joint.stages = [StageState(motors=[stage.Memory() for _ in range(shape.motors)]) for stage in shape.kept]
    return joint


def scheme_of(prepared: Prepared) -> Scheme:
    """Numbers of the stepping for the substeps of a prepared scenario."""
    stepping = prepared.stepping
    now, past = (1.5, -0.5) if stepping.staggered else (1.0, 0.0)
    return Scheme(
        step=prepared.substep,
        weight_now=now,
        weight_last=past,
        first_drift=stepping.first_drift,
        implicitness=stepping.implicitness,
        link_implicitness=prepared.resolution.link_implicitness,
        staggered=float(stepping.staggered),
    )


def kinds_of(drives: Sequence[SteppedJoint], shape: RowShape) -> list[JointKind]:
    """Kinds of the joints; the addresses of their functions are not set yet."""
    return [kind_of(drive, shape, stages) for drive, stages in zip(drives, shape.stages, strict=True)]


def constants_table(prepared: Prepared, shape: RowShape) -> Array:
    """Table P (joints, ...)."""
    substeps, cutoff = prepared.resolution.motor_substeps, prepared.velocity_cutoff
    table = np.zeros((len(prepared.drives), shape.constants))
    for j, (drive, stages) in enumerate(zip(prepared.drives, shape.stages, strict=True)):
        row = row_of_link(constants_of(drive, shape, stages, motor_substeps=substeps, cutoff=cutoff), stages)
        table[j, : len(row)] = row
    return table


def table_of_kinds(kinds: Sequence[JointKind], shape: RowShape) -> NDArray[np.int64]:
    """Table K (joints, ...) of kinds whose functions have addresses, for compiled code."""
    most = max(kind.stages for kind in kinds)
    rows = []
    for kind in kinds:
        places = [shape.place(shape.kept[place]) for place in kind.places]
        rows.append((*numbers(kind), *places, *[0] * (most - len(places))))
    return np.array(rows, dtype=np.int64)
