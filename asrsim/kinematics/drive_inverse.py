"""Inverse model of one joint's drive: the input that gives the wanted torque on a link with the wanted motion.

The deflection of the springs is found by inverting their law, so that this works for every registered actuator. The lag of
the motors behind their references follows from their own motion (paper equations 7, 8 and 11), with reference r, position
theta, gains P, I and D, inertia J, damping B, friction F and spring torque tau_el:

    P (r - theta) + I int (r - theta) = J theta'' + (B + D) theta' + F tanh(theta' / 0.02) + tau_el =: P lag

The reference map takes the equilibrium e to r = rho e + c (rho = (1, 1), c = (p, -p) for two motors against each other).
The motor positions are theta = rho s + nu d with nu orthogonal to rho. The wanted torque gives the common position s at each
time. Only the preset commands the distance d between the motors; d follows from nu (theta + lag) = nu c, a low-pass filter. The
equilibrium is rho (theta + lag - c).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from asrsim.actuators.drive import Drive
from asrsim.actuators.rest import increasing_roots
from asrsim.actuators.vectorised import over_arrays
from asrsim.kinematics.compensation import SEARCH
from asrsim.kinematics.desired import smooth_motion
from asrsim.samples import Array

SLOW = 0.02
"""Velocity scale of friction in the inverse models, F tanh(velocity / SLOW), rad/s."""
RESERVE = 1e-3
"""Fraction of a spring's largest torque that is kept in reserve."""
ROUNDS = 6
"""Largest number of iterations between the distance of the motors and the torques of the springs."""
NUDGE = 1e-6
"""Step of the central differences for slopes, rad."""


@dataclass(frozen=True, kw_only=True)
class DriveMotion:
    """Motion and torques of a drive during the wanted motion of its link."""

    inputs: Array
    """First reference (n,) of the mode, rad."""
    motors: Array
    """Motor positions (n, 2) in the elastic law, rad; NaN in modes without springs."""
    motor_torques: Array
    """Motor torques (n, motors), N m; no columns for ideal motors."""
    holdable: Array
    """Largest torque (n,) of the springs in the direction of the wanted torque, N m."""


def drive_backwards(drive: Drive, time: Array, position: Array, velocity: Array, torque: Array, preset: Array) -> DriveMotion:
    """Motion and torques of the drive for the wanted motion of its link; all arrays (n,), at equidistant times in s. preset:
    the second reference."""
    n, step = len(position), float(time[1] - time[0])
    if not drive.mode.spring:
        error = controller_error(torque + drive.derivative[0] * velocity, drive.proportional[0], drive.integral[0], step)
        return DriveMotion(
            inputs=position + error,
            motors=np.full((n, 2), np.nan),
            motor_torques=np.empty((n, 0)),
            holdable=np.full(n, np.inf),
        )
    rho, offsets = reference_map(drive, preset)
    across = np.array([rho[1], -rho[0]]) if drive.actuator.motors > 1 else np.array([0.0, -rho[0]])
    law = over_arrays(drive.actuator.elastic_torques)

    def torques(s: Array, d: Array) -> Array:
        return np.asarray(law(position, rho[0] * s + across[0] * d, rho[1] * s + across[1] * d, drive.elastic))

    centre = position / max(rho.max(), 1e-9)
    d = across @ offsets / (across @ across)
    with np.errstate(all="ignore"):
        least, most = (torques(centre + side * SEARCH, d).sum(axis=0) for side in (-1.0, 1.0))
    # A torque beyond the largest torque of the springs is clipped to slightly less than this largest torque.
    given = np.clip(torque, least + RESERVE * np.abs(least), most - RESERVE * np.abs(most))

    def along(d: Array) -> Array:
        return increasing_roots(lambda s: torques(s, d).sum(axis=0) - given, centre, farthest=SEARCH)

    s = along(d)
    if len(drive.proportional) > 1:
        for _ in range(ROUNDS):
            before = d
            d = _distance(drive, time, s, d, torques, rho, across, across @ offsets)
            s = along(d)
            if np.abs(d - before).max() < 1e-7:
                break
    motors = np.stack([rho[0] * s + across[0] * d, rho[1] * s + across[1] * d])
    references, work = motors.copy(), np.zeros((len(drive.proportional), n))
    elastic = torques(s, d)
    for motor in range(len(drive.proportional)):
        smooth = smooth_motion(time, motors[motor][:, None])
        rate = smooth.velocities[:, 0]
        work[motor] = drive.motor_inertia[motor] * smooth.accelerations[:, 0] + drive.motor_damping[motor] * rate
        work[motor] += drive.motor_friction[motor] * np.tanh(rate / SLOW) + elastic[motor]
        output = work[motor] + drive.derivative[motor] * rate
        references[motor] += controller_error(output, drive.proportional[motor], drive.integral[motor], step)
    return DriveMotion(
        inputs=rho @ (references - offsets) / (rho @ rho),
        motors=motors.T.copy(),
        motor_torques=work.T.copy(),
        holdable=np.where(torque >= 0.0, most, least),
    )


def reference_map(drive: Drive, preset: Array) -> tuple[Array, Array]:
    """Coefficients rho (2,) and c (2, n) of the reference map r = rho e + c at the presets (n,)."""
    references = over_arrays(drive.actuator.motor_references)
    offsets = references(np.zeros(len(preset)), preset)
    return references(np.ones(len(preset)), preset)[:, 0] - offsets[:, 0], offsets


def controller_error(output: Array, proportional: float, integral: float, step: float) -> Array:
    """Position error r - theta (n,) of a controller with the output P error + I int error = output (n,)."""
    if integral <= 0.0:
        return np.asarray(output / proportional)
    from scipy.signal import lfilter

    # The integral is approximated by the trapezoidal rule.
    half = 0.5 * step * integral
    ahead, behind = proportional + half, half - proportional
    return np.asarray(lfilter([1.0 / ahead, -1.0 / ahead], [1.0, behind / ahead], output))


def _distance(
    drive: Drive,
    time: Array,
    s: Array,
    d: Array,
    law: Callable[[Array, Array], Array],
    rho: Array,
    across: Array,
    commanded: Array,
) -> Array:
    """Distance d (n,) between the motors in the next iteration, from sum nu_i (theta_i + lag_i) = nu c with the slope of the
    springs at the present d."""
    gain = np.array(drive.proportional)
    # Controllers with integral action have no steady-state error.
    droop = np.where(np.array(drive.integral) > 0.0, 0.0, across / gain)
    inertia = float(across**2 @ (np.array(drive.motor_inertia) / gain))
    drag = float(across**2 @ ((np.array(drive.motor_damping) + np.array(drive.derivative)) / gain))
    slopes = (law(s, d + NUDGE) - law(s, d - NUDGE)) / (2.0 * NUDGE)
    stretch = (law(s + NUDGE, d) - law(s - NUDGE, d)) / (2.0 * NUDGE)
    with np.errstate(all="ignore"):
        # The common position s of the motors changes with their distance d, so that the torque on the link stays constant.
        share = np.nan_to_num(slopes.sum(axis=0) / stretch.sum(axis=0), posinf=0.0, neginf=0.0)
    stiffness = np.maximum(droop @ (slopes - stretch * share), 0.0)
    common = smooth_motion(time, s[:, None])
    known = commanded - droop @ law(s, d) + stiffness * d
    known -= (across * rho) @ (np.array(drive.motor_inertia) / gain) * common.accelerations[:, 0]
    known -= (across * rho) @ ((np.array(drive.motor_damping) + np.array(drive.derivative)) / gain) * common.velocities[:, 0]
    return _low_pass(inertia, drag, float(across @ across) + stiffness, known, float(time[1] - time[0]))


def _low_pass(inertia: float, drag: float, stiffness: Array, force: Array, step: float) -> Array:
    """Solution x (n,) of inertia x'' + drag x' + stiffness x = force by the midpoint rule, starting from rest."""
    position, rate = float(force[0] / stiffness[0]), 0.0
    found = [position]
    middle = (0.5 * (stiffness[1:] + stiffness[:-1])).tolist()
    pushes = (0.5 * (force[1:] + force[:-1])).tolist()
    half = 0.5 * step
    for k, push in zip(middle, pushes, strict=True):
        mean = (inertia * rate + half * (push - k * position)) / (inertia + half * (drag + half * k))
        rate = 2.0 * mean - rate
        position += step * mean
        found.append(position)
    return np.array(found)
