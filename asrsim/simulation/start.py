"""Initial state of a world: the values that differ from the scenario."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from asrsim.errors import InputError, Problem, did_you_mean
from asrsim.signals.base import Signal
from asrsim.simulation.drives import SteppedJoint

Numbers = Mapping[str, Mapping[str, float]]
"""Values of parameters by joint or link, and by name, as in `Prepared.vary`."""
Signals = Mapping[str, Mapping[str, Signal]]
"""Signals by joint, and by the name of the reference or `external_torque`."""


@dataclass(frozen=True, kw_only=True)
class Start:
    """Initial state of a world. Values that are not given come from the scenario. If the scenario starts at equilibrium, a
    world starts at the equilibrium for its own parameters and references.
    """

    parameters: Numbers = field(default_factory=dict)
    references: Signals = field(default_factory=dict)
    positions: Mapping[str, float] = field(default_factory=dict)
    """Position of each joint's link, by joint, rad (m)."""
    velocities: Mapping[str, float] = field(default_factory=dict)
    """Velocity of each joint's link, by joint, rad/s (m/s)."""
    motors: Mapping[str, Sequence[float]] = field(default_factory=dict)
    """Positions of each joint's motors, by joint, rad; motors without an entry start at their link's position."""
    motor_velocities: Mapping[str, Sequence[float]] = field(default_factory=dict)
    """Velocities of each joint's motors, by joint, rad/s; motors without an entry start as the scenario states."""


def started_joints(drives: tuple[SteppedJoint, ...], start: Start) -> tuple[SteppedJoint, ...]:
    """The joints with the positions, velocities and motors of `start`; the same object if `start` contains no values. Raises
    InputError for wrong names and values.
    """
    given = {
        "initial": start.positions,
        "velocities": start.velocities,
        "motors": start.motors,
        "motor_velocities": start.motor_velocities,
    }
    if not any(given.values()):
        return drives
    joints = {drive.name: drive for drive in drives}
    problems = []
    for key, table in given.items():
        for name, value in table.items():
            if fault := _start_fault(joints.get(name), key, value):
                hint = None if name in joints else did_you_mean(name, tuple(joints))
                problems.append(Problem(fault, key=f"{key}.{name}", value=value, hint=hint, code="start"))
    if problems:
        raise InputError(problems)
    return tuple(
        replace(
            drive,
            initial_position=float(start.positions.get(drive.name, drive.initial_position)),
            initial_velocity=float(start.velocities.get(drive.name, drive.initial_velocity)),
            motor_positions=tuple(map(float, start.motors.get(drive.name, ()))) or drive.motor_positions,
            motor_velocities=tuple(map(float, start.motor_velocities.get(drive.name, ()))) or drive.motor_velocities,
        )
        for drive in drives
    )


def _start_fault(drive: SteppedJoint | None, what: str, value: Any) -> str:
    """Reason why a value cannot be an initial value of a joint; empty if the value is valid. what: name of the value in
    messages."""
    if drive is None:
        return "the robot has no moving joint of this name"
    if what.startswith("motor"):
        if np.ndim(value) != 1 or not all(map(_is_finite, value)):
            return "must be a list of finite numbers, one for each motor"
        if len(value) > drive.motors:
            return f"has {len(value)} values, but the number of motors of '{drive.name}' is {drive.motors}"
        return ""
    low, high = drive.joint.stops
    if not _is_finite(value):
        return "must be a finite number"
    if what == "initial" and not low <= value <= high:
        return f"lies outside the limits of '{drive.name}', {low:g} to {high:g}"
    return ""


def _is_finite(value: Any) -> bool:
    try:
        return math.isfinite(value)
    except TypeError:
        return False
