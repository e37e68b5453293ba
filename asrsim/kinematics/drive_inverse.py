"""Inverse models of one joint's drive: the input that holds a load at rest, and the input for a torque on a moving link.

The springs' law is inverted numerically, so that the inverse models work for every registered actuator. In motion, the lag of
the motors behind their references follows from the motors' motion (paper equations 7, 8 and 11), with reference r, position
theta, gains P, I and D, inertia J, damping B, friction F and spring torque tau_el:

    P (r - theta) + I int (r - theta) = J theta'' + (B + D) theta' + F tanh(theta' / 0.02) + tau_el =: P lag

The reference map takes the equilibrium e to r = rho e + c (rho = (1, 1), c = (p, -p) for two motors against each other). The
motor positions are theta = rho s + nu d, where the columns of nu are orthonormal and orthogonal to rho. The wanted torque gives
the common position s at each time. Only the preset commands the distances d between the motors: nu (theta + lag) = nu c. Here
the lag is the lag of motors without springs, plus the steady-state error under the springs. The equilibrium is
rho (theta + lag - c). An adjuster stands at the preset.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asrsim.actuators.drive import Drive
from asrsim.actuators.rest import increasing_roots, resting_motors
from asrsim.actuators.vectorised import over_arrays
from asrsim.errors import ScenarioError
from asrsim.samples import Array

SEARCH = 16.0
"""Largest distance between equilibrium and link position in the search, rad or m. This is a few turns of a motor."""
EXACT = 1e-9
"""Largest difference between the spring's torque and the load, relative to the load (or to 1 N m), at which the spring counts
as holding the load.
"""
SLOW = 0.02
"""Velocity scale of friction in the inverse models, F tanh(velocity / SLOW), rad/s."""
RESERVE = 1e-3
"""Fraction of a spring's largest torque that is kept in reserve."""
ROUNDS = 6
"""Largest number of iterations that compute in turn the distance of the motors and the torques of the springs."""
MODEL_STEP = 4e-3
"""Smallest time step between the samples of a motion for the inverse models, s."""
MODEL_SAMPLES = 2000
"""Largest number of samples of a motion: a longer motion is sampled more coarsely."""
KNOT = 0.03
"""Smallest distance between spline knots of motions and inputs, s. This distance limits the bandwidth of motions and inputs to
about 15 Hz."""
MOST_KNOTS = 200
"""Largest number of spline knots of a motion."""


# -- at rest ---------------------------------------------------------------------------------------------------------


def equilibria_for_loads(
    drive: Drive, positions: Array, loads: Array, presets: Array, *, droop: bool, time: Array | None = None
) -> Array:
    """Equilibrium positions (n,) in rad at which the springs put `loads` (n,) in N m on a link at `positions` (n,) in rad.

    presets: second references (n,): stiffness preset, or position of the adjuster in m. droop: whether to include the
    steady-state error of the motors under their load. time: times (n,) for error messages, s. Raises ScenarioError if the
    springs or the motors cannot hold a load.
    """
    law, references = over_arrays(drive.actuator.elastic_torques), over_arrays(drive.actuator.motor_references)
    on_link = drive.actuator.on_link

    def torques(equilibria: Array) -> Array:
        motors = references(equilibria, presets)
        if droop:
            return resting_motors([drive], positions[None], motors[:, None], limited=False)[1][:, 0]
        return law(positions, *motors, drive.elastic)

    found = increasing_roots(lambda equilibria: on_link(torques(equilibria)) - loads, positions, farthest=SEARCH)
    springs = torques(found)
    missing = np.abs(on_link(springs) - loads) > EXACT * np.maximum(1.0, np.abs(loads))
    limits = np.array([*drive.max_torque, *[np.inf] * len(springs)][: len(springs)])
    overloaded = np.abs(springs) > limits[:, None]
    if not (missing.any() or overloaded.any()):
        return found
    row = int(np.argmax(missing | overloaded.any(axis=0)))
    when = "" if time is None else f" at {time[row]:.4g} s"
    where = f"at position {positions[row]:.4g} rad"
    if missing[row]:
        largest = on_link(springs)[row]
        message = (
            f"the spring cannot hold {loads[row]:.4g} N m {where}: its largest torque in this direction is {largest:.4g} N m"
        )
        hint, code = "choose a stiffer preset or spring, or another posture", "spring-too-weak"
    else:
        motor = int(np.argmax(overloaded[:, row]))
        message = (
            f"motor {motor + 1} would have to hold {abs(springs[motor, row]):.4g} N m {where} under a load of "
            f"{loads[row]:.4g} N m and preset {presets[row]:.4g}, but its limit is {limits[motor]:.4g} N m"
        )
        hint, code = "raise the motor's maximum torque or lower the stiffness preset", "motor-too-weak"
    raise ScenarioError(f"gravity cannot be compensated{when}: {message}", key=f"task.{drive.joint}", hint=hint, code=code)


# -- in motion -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class DesiredMotion:
    """Positions over time with two derivatives; the columns are in the order of the model's joints."""

    time: Array
    """Equidistant times (n,), s."""
    positions: Array
    """Positions (n, joints), rad or m."""
    velocities: Array
    """Velocities (n, joints)."""
    accelerations: Array
    """Accelerations (n, joints)."""


def model_time(duration: float, step: float) -> Array:
    """Time grid (n,) of the inverse models for a motion of `duration` s that is simulated in steps of `step` s."""
    wanted = max(MODEL_STEP, duration / MODEL_SAMPLES, step)
    return np.linspace(0.0, duration, max(round(duration / wanted), 8) + 1)


def knot_distance(duration: float) -> float:
    """Time in s between spline knots for a motion of `duration` s."""
    return max(KNOT, duration / MOST_KNOTS)


def smooth_motion(time: Array, samples: Array) -> DesiredMotion:
    """Motion along quintic splines, fitted by least squares to `samples` (n, joints) at equidistant `time` (n,)."""
    from scipy.interpolate import make_lsq_spline

    duration = float(time[-1] - time[0])
    pieces = max(min(round(duration / knot_distance(duration)), (len(time) - 6) // 2), 1)
    inner = np.linspace(time[0], time[-1], pieces + 1)
    knots = np.concatenate([np.full(5, inner[0]), inner, np.full(5, inner[-1])])
    spline = make_lsq_spline(time, samples, knots, k=5)
    return DesiredMotion(time=time, positions=spline(time), velocities=spline(time, nu=1), accelerations=spline(time, nu=2))


@dataclass(frozen=True, kw_only=True)
class DriveMotion:
    """Motion and torques of a drive during the wanted motion of its link."""

    inputs: Array
    """First reference (n,) of the mode, rad."""
    motors: Array
    """Positions (n, positions) of motors and adjuster in the elastic law, rad; NaN in modes without springs."""
    motor_torques: Array
    """Motor torques (n, motors), N m; no columns for ideal motors."""
    holdable: Array
    """Largest torque (n,) of the springs in the direction of the wanted torque, N m."""


def drive_backwards(drive: Drive, time: Array, position: Array, velocity: Array, torque: Array, preset: Array) -> DriveMotion:
    """Motion and torques of the drive for the wanted motion of its link; all arrays (n,), at equidistant times in s. preset:
    second reference (n,)."""
    n, step = len(position), float(time[1] - time[0])
    if not drive.mode.spring:
        error = controller_error(torque + drive.derivative[0] * velocity, drive.proportional[0], drive.integral[0], step)
        return DriveMotion(
            inputs=position + error,
            motors=np.full((n, drive.actuator.positions()), np.nan),
            motor_torques=np.empty((n, 0)),
            holdable=np.full(n, np.inf),
        )
    rho, offsets = reference_map(drive, preset)
    moved = drive.actuator.motors
    across = np.linalg.svd(rho[None, :moved])[2][1:].T
    law, on_link = over_arrays(drive.actuator.elastic_torques), drive.actuator.on_link

    def places(s: Array, d: Array) -> Array:
        return np.concatenate([rho[:moved, None] * s + across @ d, offsets[moved:]])

    def torques(s: Array, d: Array) -> Array:
        return np.asarray(law(position, *places(s, d), drive.elastic))

    centre = position / max(rho.max(), 1e-9)
    d = across.T @ offsets[:moved]
    with np.errstate(all="ignore"):
        least, most = (on_link(torques(centre + side * SEARCH, d)) for side in (-1.0, 1.0))
    # Clip a torque that exceeds the largest torque of the springs to slightly less than this largest torque.
    given = np.clip(torque, least + RESERVE * np.abs(least), most - RESERVE * np.abs(most))

    def along(d: Array) -> Array:
        return increasing_roots(lambda s: on_link(torques(s, d)) - given, centre, farthest=SEARCH)

    s = along(d)
    if len(drive.proportional) > 1:
        # Controllers with integral action have no steady-state error.
        droop = np.where(np.array(drive.integral) > 0.0, 0.0, 1.0 / np.array(drive.proportional)) * across.T
        commanded = _lagging(drive, across, time, d)

        def apart(row: int, s: Array, d: Array) -> Array:
            """The distances d with a new value in this row: the distance that the motors' controllers hold at the common
            positions s.
            """

            def missing(value: Array) -> Array:
                trial = d.copy()
                trial[row] = value
                return np.asarray(value - commanded[row] + droop[row] @ torques(s, trial)[:moved])

            d[row] = increasing_roots(missing, commanded[row])
            return d

        for _ in range(ROUNDS * len(d)):
            before = d.copy()
            for row in range(len(d)):
                d = apart(row, s, d)
            s = along(d)
            if np.abs(d - before).max() < 1e-7:
                break
    motors = places(s, d)
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


def _lagging(drive: Drive, across: Array, time: Array, d: Array) -> Array:
    """Distances (motors - 1, n) that motors without springs keep while the distances d are commanded."""
    from scipy.signal import lsim

    def between(numbers: Array) -> Array:
        return np.asarray(across.T @ (across * (numbers / np.array(drive.proportional))[:, None]))

    size = len(d)
    inverse = np.linalg.inv(between(np.array(drive.motor_inertia)))
    drag, none, unit = between(np.add(drive.motor_damping, drive.derivative)), np.zeros((size, size)), np.eye(size)
    motion = np.block([[none, unit], [-inverse, -inverse @ drag]])
    system = motion, np.vstack([none, inverse]), np.hstack([unit, none]), none
    return np.asarray(d[:, :1] + lsim(system, (d - d[:, :1]).T, time - time[0])[1].reshape(len(time), size).T)


def reference_map(drive: Drive, preset: Array) -> tuple[Array, Array]:
    """Coefficients rho (positions,) and c (positions, n) of the reference map r = rho e + c at the presets (n,)."""
    references = over_arrays(drive.actuator.motor_references)
    offsets = references(np.zeros(len(preset)), preset)
    return references(np.ones(len(preset)), preset)[:, 0] - offsets[:, 0], offsets


def controller_error(output: Array, proportional: float, integral: float, step: float) -> Array:
    """Position error r - theta (n,) of a controller with the output P error + I int error = output (n,)."""
    if integral <= 0.0:
        return np.asarray(output / proportional)
    from scipy.signal import lfilter

    # Approximate the integral by the trapezoidal rule.
    half = 0.5 * step * integral
    ahead, behind = proportional + half, half - proportional
    return np.asarray(lfilter([1.0 / ahead, -1.0 / ahead], [1.0, behind / ahead], output))
