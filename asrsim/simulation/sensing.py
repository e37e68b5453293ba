"""Sensors of a joint: measured positions and velocities are delayed; positions are also noisy and quantised."""

from __future__ import annotations

import math
from typing import Any

from asrsim.simulation.fields import JointConstants, JointKind, JointState, Scheme
from asrsim.simulation.laws import drive_of, memory_of, motor_of
from asrsim.simulation.layout import GOALS


def remember_positions(joint: JointState, link: JointConstants, kind: JointKind, scheme: Scheme) -> None:
    """Store the present positions and velocities in the memory of the sensors.

    A ring buffer stores positions at the times of the substeps, and velocities at the times to which they belong. The buffer is
    followed by the index of its newest entry and by the last sample.
    """
    memory, size = memory_of(joint, kind), _ring_size(link)
    for i in range(kind.controllers):
        motor, ring = motor_of(joint, i), i * kind.ring
        newest = (int(memory[ring + 2 * size]) + 1) % size
        memory[ring + 2 * size] = float(newest)
        if kind.on_link:
            memory[ring + 2 * newest], memory[ring + 2 * newest + 1] = joint.position, joint.engine_velocity
        else:
            # The position of a motor is known at the beginning of the substep.
            ahead = scheme.first_drift * scheme.step * motor.velocity
            memory[ring + 2 * newest], memory[ring + 2 * newest + 1] = motor.position + ahead, motor.velocity


def _ring_size(link: JointConstants) -> int:
    """Number of entries of a sensor's ring buffer; see `asrsim.simulation.imperfections.Sensor.memory`."""
    return int(link.delay + 0.5) + 3


def read_sensors(
    joint: JointState, link: JointConstants, kind: JointKind, scheme: Scheme, u: Any, since: float, until: float
) -> None:
    """Compute the errors of the measured positions and velocities in a piece of a kick. Measurements are delayed; positions are
    also noisy and quantised.

    since, until: times at which the piece begins and ends, in substeps after the time of the substep. Sensors with ticks take
    samples at the beginning of a piece and hold them. Other sensors measure the value in the middle of the piece. If they are
    quantised, they measure the mean over the piece.
    """
    middle, size, delay, memory = 0.5 * (since + until), _ring_size(link), link.delay, memory_of(joint, kind)
    for i in range(kind.controllers):
        motor, ring, samples = motor_of(joint, i), i * kind.ring, GOALS + kind.positions + 2 * i
        sample, noise = ring + 2 * size + 1, u[samples + 1]
        lag = 0.5 * scheme.staggered if kind.on_link else scheme.first_drift
        gain = link.derivative if kind.on_link else drive_of(link, i).derivative
        if link.sampled != 0.0:
            if u[samples] != 0.0:
                place = _position_at(memory, scheme, ring, size, since - delay) + noise
                memory[sample] = _quantised(place, place, link.quantum)
                memory[sample + 1] = _velocity_at(memory, ring, size, lag, since - delay)
            place, speed = memory[sample], memory[sample + 1]
        else:
            place = _position_at(memory, scheme, ring, size, middle - delay) + noise
            speed = _velocity_at(memory, ring, size, lag, middle - delay)
            if link.quantum > 0.0:
                before = _position_at(memory, scheme, ring, size, since - delay) + noise
                place = _quantised(before, _position_at(memory, scheme, ring, size, until - delay) + noise, link.quantum)
        motor.read_error = place - (joint.position if kind.on_link else _position_at(memory, scheme, ring, size, middle))
        motor.read_push = -gain * (speed - _velocity_at(memory, ring, size, lag, middle))


def _position_at(memory: Any, scheme: Scheme, ring: int, size: int, time: float) -> float:
    """Position in rad at a time, interpolated linearly between the stored positions. time: time of the position, in substeps
    after the present substep."""
    newest = int(memory[ring + 2 * size])
    if time >= 0.0:
        return float(memory[ring + 2 * newest] + time * scheme.step * memory[ring + 2 * newest + 1])
    back = int(-time)
    later, earlier = ring + 2 * ((newest + size - back) % size), ring + 2 * ((newest + size - back - 1) % size)
    return float(memory[later] + (-time - back) * (memory[earlier] - memory[later]))


def _velocity_at(memory: Any, ring: int, size: int, lag: float, time: float) -> float:
    """Velocity in rad/s at a time, interpolated linearly. time: time of the velocity, in substeps after the present substep. A
    velocity is valid `lag` substeps before the position that is stored with it.
    """
    newest = int(memory[ring + 2 * size])
    back = int(max(-time - lag, 0.0))
    later, earlier = ring + 2 * ((newest + size - back) % size), ring + 2 * ((newest + size - back - 1) % size)
    return float(memory[later + 1] + (-time - lag - back) * (memory[earlier + 1] - memory[later + 1]))


def _quantised(first: float, last: float, quantum: float) -> float:
    """Mean of the nearest multiples of the quantum for values that change evenly from `first` to `last`."""
    if quantum <= 0.0:
        return 0.5 * (first + last)
    start, end = first / quantum + 0.5, last / quantum + 0.5
    lowest = math.floor(start)
    steps = math.floor(end) - lowest
    if steps == 0:
        return quantum * lowest
    # The integral of the staircase floor(x) from 0 to x is steps (x - (steps + 1) / 2), with steps = floor(x).
    return quantum * (lowest + steps * (end - lowest - 0.5 * (steps + 1)) / (end - start))
