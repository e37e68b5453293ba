"""Bandwidths of a drive with its controllers, linearised at rest, without friction: behind a load, or on a locked link."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from asrsim.actuators.drive import Drive
from asrsim.actuators.vectorised import over_arrays
from asrsim.samples import Array

Complex = NDArray[np.complexfloating[Any, Any]]

NUDGE = 1e-6
"""Displacement in rad of the finite differences of the torques."""
LOWEST, HIGHEST, FREQUENCIES = 1e-3, 1e4, 8001
"""LOWEST, HIGHEST: lowest and highest frequency of the search, Hz; FREQUENCIES: number of frequencies of the search."""


@dataclass(frozen=True, kw_only=True)
class Load:
    """Load that the joint moves."""

    inertia: float
    """Inertia, kg m^2."""
    damping: float
    """Viscous damping, N m s/rad."""


def position_bandwidth(drive: Drive, preset: float, load: Load) -> float | None:
    """Frequency in Hz at which the motion of the link, in response to small motions of the equilibrium, first falls by 3 dB;
    None if the motion never falls so far.
    """
    by_q, by_motor = _slopes(drive, preset)
    references = over_arrays(drive.actuator.motor_references)
    pulled = (references(np.full(1, NUDGE), np.full(1, preset)) - references(np.zeros(1), np.full(1, preset)))[:, 0] / NUDGE
    count = drive.actuator.motors

    def response(frequency: Array) -> Complex:
        s = 2j * np.pi * frequency[:, None, None]
        matrix = np.zeros((len(frequency), count + 1, count + 1), complex)
        control, free = _motors(drive, s[:, 0, 0])
        matrix[:, 0, 0] = load.inertia * s[:, 0, 0] ** 2 + load.damping * s[:, 0, 0] - drive.actuator.on_link(by_q)
        matrix[:, 0, 1:] = -drive.actuator.on_link(by_motor[:, :count])
        matrix[:, 1:, 0] = by_q[:count]
        matrix[:, 1:, 1:] = by_motor[:count, :count]
        matrix[:, range(1, count + 1), range(1, count + 1)] += free.T
        right = np.zeros((len(frequency), count + 1, 1), complex)
        right[:, 1:, 0] = control.T * pulled[:count]
        return np.asarray(np.linalg.solve(matrix, right)[:, 0, 0])

    return _falls(response)


def preset_bandwidth(drive: Drive, preset: float) -> float | None:
    """Frequency in Hz at which the motions of the motors against each other, in response to small changes of the preset on a
    locked link, first fall by 3 dB; None if the motions never fall so far.
    """
    _, by_motor = _slopes(drive, preset)
    count = drive.actuator.motors

    def response(frequency: Array) -> Complex:
        control, free = _motors(drive, 2j * np.pi * frequency)
        matrix = np.tile(by_motor[:count, :count].astype(complex), (len(frequency), 1, 1))
        matrix[:, range(count), range(count)] += free.T
        against = np.array([1.0, -1.0] + [0.0] * (count - 2))
        found = np.linalg.solve(matrix, (control.T * against)[..., None])[:, :, 0]
        return np.asarray(found[:, 0] - found[:, 1])

    return _falls(response)


def _slopes(drive: Drive, preset: float) -> tuple[Array, Array]:
    """Derivatives of the springs' torques by the link (springs,) and by motors and adjuster (springs, positions), N m/rad."""
    rest = over_arrays(drive.actuator.motor_references)(np.zeros(1), np.full(1, preset))[:, 0]
    point = np.array([0.0, *rest])
    columns = []
    for i in range(len(point)):
        move = np.zeros_like(point)
        move[i] = NUDGE
        places = np.stack([point + move, point - move], axis=1)
        above, below = over_arrays(drive.actuator.elastic_torques)(*places, drive.elastic).T
        columns.append((above - below) / (2.0 * NUDGE))
    return columns[0], np.array(columns[1:]).T


def _motors(drive: Drive, s: Complex) -> tuple[Complex, Complex]:
    """Gains (motors, n) of each motor: from its reference to its controller's torque, and from its position to the torque that
    this motion needs."""
    control, free = [], []
    for i in range(drive.actuator.motors):
        p, integral, d = drive.proportional[i], drive.integral[i], drive.derivative[i]
        feedback = p + (integral / s if integral else 0.0 * s)
        control.append(feedback)
        free.append(drive.motor_inertia[i] * s**2 + (drive.motor_damping[i] + d) * s + feedback)
    return np.array(control), np.array(free)


def _falls(response: Callable[[Array], Complex]) -> float | None:
    frequencies = np.geomspace(LOWEST, HIGHEST, FREQUENCIES)
    gains = np.abs(response(frequencies))
    limit = gains[0] / math.sqrt(2.0)
    if not np.isfinite(gains[0]) or gains[0] == 0.0 or not (gains < limit).any():
        return None
    after = int(np.argmax(gains < limit))
    low, high = frequencies[after - 1], frequencies[after]
    for _ in range(60):
        middle = math.sqrt(low * high)
        low, high = (low, middle) if abs(response(np.array([middle]))[0]) < limit else (middle, high)
    return float(low)
