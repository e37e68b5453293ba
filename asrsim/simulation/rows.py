"""Rows of the tables S, P and K at the start of a run; `asrsim.simulation.layout` lists their columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from asrsim.samples import Array
from asrsim.simulation.drives import SteppedJoint
from asrsim.simulation.kernel import AT_STOP
from asrsim.simulation.layout import (
    ANCHOR,
    CONTROLLED,
    CONTROLLERS,
    DEFLECTION,
    DIRECT,
    DYNAMIC,
    ENGINE_VELOCITY,
    FIRST_DRIVE,
    FIRST_MOTOR,
    GOALS,
    INTEGRAL,
    KIND,
    KINDS,
    LAST_DEFLECTION,
    LAST_ENGINE_VELOCITY,
    LAW,
    MOTOR_INTEGRAL,
    MOTOR_POSITION,
    MOTOR_VELOCITY,
    MOTORS,
    ON_LINK,
    PASSIVE,
    PER_DRIVE,
    PER_MOTOR,
    PLACED,
    POSITION,
    RING,
    RINGS,
    SPRINGS,
    SPRUNG,
    THETAS,
    TORQUES,
)  # fmt: skip
from asrsim.simulation.prepare import Prepared
from asrsim.simulation.released import MOTORS as RELEASED_MOTORS
from asrsim.simulation.released import PHANTOM, PHANTOM_AWAS_II, PHANTOM_SEA


@dataclass(frozen=True)
class RowShape:
    """Sizes of the variable parts of the rows, which are the same for all joints of a robot."""

    motors: int
    """Number of motor blocks in every row."""
    ring: int
    """Number of values in the memory of one sensor."""
    parameters: int
    """Largest number of parameters of a spring's law."""

    @property
    def thetas(self) -> int:
        """Column of S at which the motor positions for the spring's law begin."""
        return FIRST_MOTOR + self.motors * PER_MOTOR

    @property
    def state(self) -> int:
        """Number of columns of S."""
        return self.thetas + 2 * self.motors + self.motors * self.ring

    @property
    def drives(self) -> int:
        """Number of columns of P before the parameters of the spring's law."""
        return FIRST_DRIVE + self.motors * PER_DRIVE

    @property
    def constants(self) -> int:
        """Number of columns of P."""
        return self.drives + self.parameters

    @property
    def goals(self) -> int:
        """Number of columns of an input row, without the columns of sensors."""
        return GOALS + self.motors


def shape_of(drives: Sequence[SteppedJoint]) -> RowShape:
    """Sizes of the rows that these joints need."""
    return RowShape(
        motors=max(drive.positions for drive in drives),
        ring=max((2 * drive.sensor.memory + 3 for drive in drives if drive.sensor), default=0),
        parameters=max(len(drive.elastic) for drive in drives),
    )


def kind_of(drive: SteppedJoint, shape: RowShape) -> list[int]:
    """Row of K for a joint, without the addresses."""
    k = [0] * KINDS
    if drive.drive is None:
        k[KIND] = PASSIVE
    else:
        mode = drive.drive.mode
        k[KIND] = SPRUNG if mode.spring else CONTROLLED if mode.controller else DIRECT
    k[DYNAMIC], k[PLACED], k[SPRINGS] = drive.dynamic_motors, drive.placed, drive.motors if drive.placed else 0
    k[MOTORS] = drive.positions
    if drive.sensor is not None:
        k[CONTROLLERS], k[ON_LINK] = drive.sensor.count, int(drive.sensor.on_link)
    k[THETAS], k[TORQUES] = shape.thetas, shape.thetas + shape.motors
    k[RINGS], k[RING] = shape.thetas + 2 * shape.motors, shape.ring
    k[LAW] = shape.drives
    return k


def constants_of(drive: SteppedJoint, shape: RowShape, *, motor_substeps: int, cutoff: bool) -> list[float]:
    """Row of P for a joint."""
    joint, law, values, sensor = drive.joint, drive.link_damping, drive.values, drive.sensor
    follows = drive.mode is not None and drive.mode.spring
    low, high = joint.stops
    level, length = drive.hysteresis or (0.0, 1.0)
    gains = ("proportional", "integral", "derivative")
    row = [
        joint.most_effort, joint.velocity or np.inf, float(cutoff), low + AT_STOP, high - AT_STOP, drive.constant_damping,
        law.ratio if law and follows else 0.0, law.inertia if law else 0.0, drive.link_brake, joint.spring_stiffness,
        joint.spring_reference,
        joint.friction, joint.stribeck_friction, 1.0 / joint.stribeck_velocity, joint.load_friction,
        *(values.get(f"controller_1_{name}", 0.0) for name in gains), motor_substeps if drive.dynamic_motors else 1,
        values.get("max_deflection", np.inf), level, length,
        float(bool(sensor and sensor.effects.rate)), sensor.delay if sensor else 0.0, sensor.effects.quantum if sensor else 0.0,
    ]  # fmt: skip
    motors = [_motor(drive, index) for index in range(1, shape.motors + 1)]
    row += [number for motor in motors for number in motor]
    row += drive.elastic
    return [float(number) for number in row] + [0.0] * (shape.constants - len(row))


def _motor(drive: SteppedJoint, index: int) -> list[float]:
    """Columns of P for motor `index` (1, 2, ...); zeros if the joint has no such motor."""
    if index > drive.dynamic_motors:
        row = [0.0] * PER_DRIVE
        if drive.stepping.released and drive.dynamic_motors and drive.actuator and index <= RELEASED_MOTORS:
            for column, value in (PHANTOM | (PHANTOM_AWAS_II if drive.actuator.adjuster else PHANTOM_SEA)).items():
                row[column] = value
        return row
    assert drive.drive is not None
    own, values, electric = drive.drive, drive.values, index in drive.electric_motors
    constant = values[f"motor_{index}_torque_constant"] * values[f"motor_{index}_gear_ratio"] if electric else 0.0
    limits = *own.motor_ranges[index - 1], own.max_velocity[index - 1], values[f"motor_{index}_max_torque"]
    return [*own.motor_numbers(index), *limits, constant, values[f"motor_{index}_resistance"] if electric else 0.0]


def start_of(drive: SteppedJoint, shape: RowShape, position: float, velocity: float) -> list[float]:
    """Row of S for a joint at the start, with its link at `position` (rad) and `velocity` (rad/s)."""
    s = [0.0] * shape.state
    s[POSITION], s[ENGINE_VELOCITY], s[LAST_ENGINE_VELOCITY] = position, velocity, velocity
    mode = drive.mode
    if mode is not None and not mode.spring and mode.controller:
        s[INTEGRAL] = (drive.integrals or (0.0,))[0]
    starts = drive.motor_starts(shape.motors) if drive.dynamic_motors else []
    for i in range(shape.motors):
        m = FIRST_MOTOR + i * PER_MOTOR
        s[m + DEFLECTION] = s[m + LAST_DEFLECTION] = np.nan
        if i < len(starts):
            s[m + MOTOR_POSITION], s[m + MOTOR_VELOCITY], s[m + ANCHOR], s[m + MOTOR_INTEGRAL] = starts[i]
    sensor = drive.sensor
    for i in range(sensor.count if sensor else 0):
        # The memory of a sensor is filled with the values at the start.
        x, v = (position, velocity) if sensor.on_link else starts[i][:2]  # type: ignore[union-attr]
        ring = shape.thetas + 2 * shape.motors + i * shape.ring
        seen = [*[x, v] * sensor.memory, 0.0, x, v]  # type: ignore[union-attr]
        s[ring : ring + len(seen)] = seen
    return s


def tables(prepared: Prepared, shape: RowShape) -> tuple[NDArray[np.int64], Array]:
    """The tables K (joints, ...), without the addresses, and P (joints, ...)."""
    kinds = np.array([kind_of(drive, shape) for drive in prepared.drives], dtype=np.int64)
    options: Any = {"motor_substeps": prepared.resolution.motor_substeps, "cutoff": prepared.velocity_cutoff}
    return kinds, np.array([constants_of(drive, shape, **options) for drive in prepared.drives])
