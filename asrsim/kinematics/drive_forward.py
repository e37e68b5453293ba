"""Forward model of one joint's drive: its motor positions, from the link's recorded motion and the input."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from asrsim.actuators.drive import Drive
from asrsim.actuators.motor import motor_kick
from asrsim.actuators.vectorised import over_arrays, references_over_arrays
from asrsim.samples import Array

LONGEST = 2.5e-3
"""s, largest step in which the motion of the motors is integrated."""


class Start(NamedTuple):
    """State of both motors at the start; with one motor the second entries are not used."""

    positions: tuple[float, ...]
    """rad."""
    velocities: tuple[float, float] = (0.0, 0.0)
    """rad/s."""
    integrals: tuple[float, ...] = ()
    """N m, torque of the controllers' integral action; 0 without integral action."""


def motor_positions(
    drive: Drive, time: Array, position: Array, inputs: Array, preset: Array, start: Start | None = None
) -> Array:
    """(n, 2) rad, the motor positions of the elastic law at equidistant `time` (n,); NaN in modes without springs.

    position, inputs, preset: (n,). start: None: the motors start at rest where the link starts. Friction is neglected.
    """
    if not drive.mode.spring:
        return np.full((len(time), 2), np.nan)
    references = np.stack(references_over_arrays(drive.actuator)(inputs, preset))
    if not drive.proportional:
        return references.T.copy()
    step = float(time[1] - time[0])
    parts = max(int(np.ceil(step / LONGEST - 1e-9)), 1)
    fine = np.linspace(time[0], time[-1], (len(time) - 1) * parts + 1)
    goals = [np.interp(fine, time, reference).tolist() for reference in references]
    begun = start or Start((float(position[0]),) * 2)
    found = _follow(drive, step / parts, np.interp(fine, time, position).tolist(), goals, begun)
    return found[::parts]


def link_torque(drive: Drive, position: Array, velocity: Array, motors: Array, inputs: Array) -> Array:
    """(n,) N m, torque of the drive on its link; integral action on the link position is neglected."""
    if not drive.mode.spring:
        return np.asarray(drive.proportional[0] * (inputs - position) - drive.derivative[0] * velocity)
    torques = over_arrays(drive.actuator.elastic_torques)(position, motors[:, 0], motors[:, 1], drive.elastic)
    return np.asarray(torques.sum(axis=0))


def _follow(drive: Drive, step: float, positions: list[float], goals: list[list[float]], start: Start) -> Array:
    """Integrates by drift - kick - drift, as the simulation does for its motors."""
    drive = drive.without_friction()
    law, elastic, half = drive.actuator.elastic_torques, drive.elastic, 0.5 * step
    motors = list(zip(map(drive.motor_numbers, range(1, drive.dynamic_motors + 1)), drive.max_velocity, strict=True))
    places, rates = [*start.positions], [*start.velocities]
    units = [electric.gain or 1.0 for electric in drive.electric]
    sums = [torque / unit for torque, unit in zip(start.integrals or (0.0, 0.0), units, strict=False)]
    found = []
    for q, *wanted in zip(positions, *goals, strict=True):
        if len(motors) < 2:
            places[1] = wanted[1]
        found.append(tuple(places))
        middle = places[0] + half * rates[0], places[1] + half * rates[1]
        torques = law(q, *middle, elastic)
        for i, (numbers, most) in enumerate(motors):
            how = (wanted[i], torques[i], -most, most, step, 0.5, numbers)
            rates[i], _, _, sums[i], _, _ = motor_kick(middle[i], rates[i], 0.0, sums[i], *how)
            places[i] = middle[i] + half * rates[i]
    return np.array(found)
