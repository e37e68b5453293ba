"""Loops over the joints of a twin and of its copies. In each step, they compute the observed torques and the alarm thresholds.
They run as Python code or compiled.

The loops write to the arrays of `TwinTables` and create no arrays. For few joints, creating an array takes longer than
computing its values.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from asrsim.compiled.compiling import compile_function
from asrsim.twin.mismatch import Mismatch, learn
from asrsim.twin.observer import Gains, respond


class TwinTables(NamedTuple):
    """Arrays of a twin with n joints. The twin consists of w simulations: the twin itself, and its copies with other
    parameters.
    """

    integral: Any
    """Integral (w, n) of the position error, a state of the observer, rad s."""
    lagged: Any
    """Position error (w, n) after the lag of the controller, the other state of the observer, rad s."""
    torques: Any
    """Torques that pull the simulated links towards the measured positions, (w, n), N m."""
    masses: Any
    """Mass matrix (n, n) at the twin's positions, kg m^2."""
    stiffness: Any
    """Stiffness (n,) of the twin's joints, N m/rad; NaN: unknown."""
    rows: Any
    """Present row of the regression after each of the two low-pass filters, (2, kinds + 3, n); see `asrsim.twin.mismatch`."""
    before: Any
    """Measured positions (2, n) of the last two steps."""
    missing: Any
    """Number (n,) of successive steps up to the present step without a measured position."""
    variance: Any
    """Variance (n,) of the noise of the measured positions, rad^2."""
    peak: Any
    """Largest recent torque (n,) of each joint's springs, N m. It decays with time."""
    carried: Any
    """Largest torque (n,) of each joint's springs since the twin began, N m."""
    noise: Any
    """Standard deviation (n,) of the torque for alarms due to the noise of the measured positions alone, N m."""


class AlarmLimits(NamedTuple):
    """Numbers from which the alarm thresholds are computed."""

    forgotten: float
    """Fraction by which the springs' largest recent torque decays in a step."""
    noise_gain: float
    """Ratio of two standard deviations for a link of inertia 1: torque for alarms to position noise, s^-2."""
    sigmas: float
    """Threshold for noise, as a multiple of the standard deviation of the torque due to noise alone."""
    release: float
    """An alarm ends when the torque is at or below this fraction of the threshold."""
    slowest: float
    """A link counts as moving above this speed, rad/s."""
    tolerance: float
    """Threshold for errors of the model after their estimation, as a fraction of the springs' largest recent torque."""
    unlearned: float
    """Threshold for errors of the model before their estimation, as a fraction of the springs' largest recent torque."""
    friction: float
    """Threshold for errors of the friction while the link moves, as a multiple of the friction."""
    sticking: float
    """Threshold for errors of the friction while the link is at rest, as a multiple of the friction."""


class JointWatch(NamedTuple):
    """Numbers for the checks of measured positions."""

    share: float
    """Weight of a new measurement in the moving average for the variance of the noise."""
    step: float
    """Time step, s."""
    gap: float
    """After a gap in the measurements that is longer than this time, the twin is set to the next measured position, s."""
    jump: float
    """The twin is set to the measured position if it differs from the twin's position by more than this value, rad (m)."""


JUMPED, LOST, MISSING = 1, 2, 4
"""Findings of `compare` in a step. JUMPED: a joint is far from its twin. LOST: a joint is measured again after a long gap.
MISSING: a joint is not measured.
"""


def tables(simulations: int, joints: int, columns: int) -> TwinTables:
    """Initial arrays of a twin. columns: number of entries in a row of the regression, kinds + 3."""
    shape = simulations, joints
    return TwinTables(
        integral=np.zeros(shape),
        lagged=np.zeros(shape),
        torques=np.zeros(shape),
        masses=np.eye(joints),
        stiffness=np.full(joints, np.nan),
        rows=np.zeros((2, columns, joints)),
        before=np.full((2, joints), np.nan),
        missing=np.zeros(joints, dtype=np.int64),
        variance=np.zeros(joints),
        peak=np.zeros(joints),
        carried=np.zeros(joints),
        noise=np.zeros(joints),
    )


def compare(t: TwinTables, watch: JointWatch, positions: Any, links: Any, coupled: Any, stops: Any, error: Any) -> int:
    """Compute the position errors of the twin and its copies, and update the noise and the gaps of the measurements.

    positions: measured positions (n,), rad, which are changed to positions that the twin can follow; links: link positions (w,
    n) in the simulations, rad; coupled: whether each joint is coupled to another joint, (n,); stops: lowest and highest
    positions (2, n) of the joints, rad; error: receives the position errors (w, n), rad. Returns the sum of the numbers
    `JUMPED`, `LOST` and `MISSING` whose meaning applies to at least one joint.
    """
    simulations, joints = links.shape
    jumped = lost = missing = 0
    for j in range(joints):
        position = positions[j]
        if not math.isfinite(position):
            position = math.nan
        bend = position - 2.0 * t.before[1, j] + t.before[0, j]
        # The second difference of white noise has six times the variance of the noise.
        if bend == bend:
            t.variance[j] += watch.share * (bend * bend / 6.0 - t.variance[j])
        t.before[0, j] = t.before[1, j]
        t.before[1, j] = position
        gap = t.missing[j]
        t.missing[j] = 0 if position == position else gap + 1
        if t.missing[j]:
            missing = MISSING
        if coupled[j]:
            # Do not correct a coupled joint by its own position, since the measured position of the other joint corrects the
            # two joints.
            position = math.nan
        # Move a position beyond a stop to the stop. The twin cannot reach this position, and the measurement must be wrong.
        if position < stops[0, j]:
            position = stops[0, j]
        if position > stops[1, j]:
            position = stops[1, j]
        if position == position and gap * watch.step > watch.gap:
            lost = LOST
        positions[j] = position
        for i in range(simulations):
            error[i, j] = position - links[i, j]
        if abs(error[0, j]) > watch.jump:
            jumped = JUMPED
    return jumped + lost + missing


def pull(t: TwinTables, gains: Gains, error: Any, velocity: Any, found: Any, shares: Any, external: Any) -> None:
    """Compute the torques that pull the links towards the measured positions, and the external torques after each of the two
    filters. The torques due to errors of the model, which the regression estimates, are subtracted from the external torques.

    error: position errors (w, n), rad; velocity: velocities (n,) of the twin's links, rad/s; found: coefficients (kinds, n) of
    the regression; shares: weight of a new value in each of the two filters, and fraction by which parameters are larger in the
    copies; external: receives the external torques (2, n), N m.
    """
    simulations, joints = error.shape
    t.torques[:] = 0.0
    for i in range(simulations):
        for j in range(joints):
            wanted, t.integral[i, j], t.lagged[i, j] = respond(error[i, j], t.integral[i, j], t.lagged[i, j], gains)
            for k in range(joints):
                t.torques[i, k] += wanted * t.masses[j, k]
    last = t.rows.shape[1] - 1
    for j in range(joints):
        own = t.torques[0, j] + _known(t.stiffness[j] * error[0, j])
        for f in range(2):
            rows, share = t.rows[f], shares[f]
            rows[0, j] += share * (velocity[j] - rows[0, j])
            rows[last - 1, j] += share * (1.0 - rows[last - 1, j])
            rows[last, j] += share * (own - rows[last, j])
            total = 0.0
            for i in range(1, simulations):
                # The deflections of the simulated springs and of the robot's springs differ by the position error. Add the
                # spring torque due to this difference.
                lacking = t.torques[i, j] + _known(t.stiffness[j] * error[i, j])
                rows[i, j] += share * ((lacking - own) / shares[2] - rows[i, j])
                total += rows[i, j] * found[i - 1, j]
            external[f, j] = rows[last, j] - total


def judge(
    t: TwinTables, limits: AlarmLimits, rows: Any, springs: Any, stiffness: int, learned: Any, friction: Any, external: Any,
    ready: bool, error: Any, alarm: Any, found: Any,
) -> bool:  # fmt: skip
    """Compute the reported external torque, the alarm threshold and the alarm of each joint. Returns whether noise is too
    large: for at least one joint, the threshold for noise alone exceeds the largest torque of its springs so far.

    rows: recorded values (w, n, columns) of the simulations; springs: indices (n, k) of the columns with the torques of each
    joint's springs, -1 if there is no such spring; stiffness: index of the column with the stiffness, -1 if there is no such
    column; learned: whether the errors of the model have been estimated for each joint, (n,); friction: friction (n,) in the
    model, N m; external: external torques (2, n) after the two filters, N m; ready: whether alarms may be raised; error:
    position errors (n,) of the twin, rad; alarm: alarms (n,) of the last step, which the alarms of this step replace; found:
    receives external torques and thresholds (2, n), N m.
    """
    too_noisy = False
    joints = len(alarm)
    for j in range(joints):
        spring = 0.0
        for k in springs[j]:
            spring += _known(rows[0, j, k]) if k >= 0 else 0.0
        t.stiffness[j] = rows[0, j, stiffness] if stiffness >= 0 else math.nan
        t.peak[j] = max(abs(spring), t.peak[j] * (1.0 - limits.forgotten))
        t.carried[j] = max(t.carried[j], t.peak[j])
        total = 0.0
        for k in range(joints):
            total += t.masses[j, k] * t.masses[j, k] * t.variance[k]
        t.noise[j] = limits.noise_gain * math.sqrt(total)
        # Noise is independent of the errors of the model, so add the squares of the two thresholds.
        tolerated = (limits.tolerance if learned[j] else limits.unlearned) * t.peak[j]
        tolerated += (limits.friction if abs(t.rows[0, 0, j]) > limits.slowest else limits.sticking) * friction[j]
        threshold = math.hypot(limits.sigmas * t.noise[j], tolerated)
        least = threshold * limits.release if alarm[j] else threshold
        alarm[j] = abs(external[1, j]) > least and ready
        too_noisy = too_noisy or (learned[j] and limits.sigmas * t.noise[j] > t.carried[j])
        found[0, j] = external[0, j] if error[j] == error[j] else math.nan
        found[1, j] = threshold
    return too_noisy


def _known(value: float) -> float:
    return value if value == value else 0.0


class TwinLoops(NamedTuple):
    """Functions that a twin calls in each step."""

    compare: Callable[..., int] = compare
    pull: Callable[..., None] = pull
    judge: Callable[..., bool] = judge
    learn: Callable[..., None] = learn


def compiled_loops(t: TwinTables, mismatch: Mismatch, watch: JointWatch, gains: Gains, limits: AlarmLimits) -> TwinLoops:
    """The functions of `TwinLoops`, compiled for arrays of any size."""
    one, two, flags, columns = np.zeros(1), np.zeros((1, 1)), np.zeros(1, dtype=bool), np.zeros((1, 1), dtype=np.int64)
    examples = (
        (t, watch, one, two, flags, two, two),
        (t, gains, two, one, two, one, two),
        (t, limits, np.zeros((1, 1, 1)), columns, 0, flags, one, two, True, one, flags, two),
        (mismatch, two, one, flags),
    )
    return TwinLoops(*(compile_function(law, given) for law, given in zip(TwinLoops(), examples, strict=True)))
