"""Loops over the joints of a twin and its copies in a step: observed torques and thresholds. They run as Python or compiled.

All arrays are those of `TwinTables`, since a step must not create arrays: for few joints, creation takes longer than the
computation.
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
    """Arrays of a twin with n joints, in w simulations: the twin itself, and its copies with other parameters."""

    integral: Any
    """State of the observer, (w, n) each."""
    lagged: Any
    torques: Any
    """Torques that pull the links, (w, n), N m."""
    masses: Any
    """Mass matrix (n, n), kg m^2."""
    stiffness: Any
    """Stiffness (n,) of the twin's joints, N m/rad; NaN: unknown."""
    rows: Any
    """Regression after both filters, (2, kinds + 3, n); see `asrsim.twin.mismatch`."""
    before: Any
    """Positions (2, n) that were measured in the last two steps."""
    missing: Any
    """Number of steps (n,) without a measured position."""
    variance: Any
    """Variance (n,) of the noise of the measured positions, rad^2."""
    peak: Any
    """Largest recent torque of the springs of each joint, (n,), N m."""
    carried: Any
    """Largest torque of the springs of each joint so far, (n,), N m."""
    noise: Any
    """Standard deviation (n,) of the torque for alarms that noise alone causes, N m."""


class AlarmLimits(NamedTuple):
    """Numbers of the thresholds of alarms."""

    forgotten: float
    """Fraction by which the springs' largest recent torque decays in a step."""
    noise_gain: float
    """Standard deviation of the torque divided by that of the position, for links of inertia 1, s^-2."""
    sigmas: float
    """Number of standard deviations of the torque up to which no alarm is raised."""
    release: float
    """Fraction of the threshold at which an alarm ends."""
    slowest: float
    """Speed above which a link counts as moving, rad/s."""
    tolerance: float
    """Tolerated error of the model as a fraction of the springs' largest recent torque, after the error was estimated."""
    unlearned: float
    """Like `tolerance`, before the error was estimated."""
    friction: float
    """Multiple of the friction that is tolerated while the link moves."""
    sticking: float
    """Multiple of the friction that is tolerated while the link is at rest."""


class JointWatch(NamedTuple):
    """Numbers for the checks of measured positions."""

    share: float
    """Weight of a new value in the variance of the noise."""
    step: float
    """Time step, s."""
    gap: float
    """Time without a measurement after which the twin is set to the next measured position, s."""
    jump: float
    """Error of a position above which the twin is set to the measured position, rad (m)."""


JUMPED, LOST, MISSING = 1, 2, 4
"""Findings of a step: a joint is far from the twin; a joint is measured again after a gap; a joint is not measured."""


def tables(simulations: int, joints: int, columns: int) -> TwinTables:
    """The arrays at the start. columns: number of columns of the regression's rows."""
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
    """Compute the position errors (w, n) of the twin and its copies, and update the noise and the gaps of the measurements.

    positions: measured positions (n,), which become those that the twin can follow; links: of the simulations (w, n), rad;
    coupled: whether each joint follows another one (n,); stops: of the joints (2, n), rad. Returns the sum of those of
    `JUMPED`, `LOST` and `MISSING` that apply.
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
            # A coupled joint follows its master, so that its measured position would count twice.
            position = math.nan
        # A twin cannot follow a position beyond a stop: such a position is an error of the measurement.
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
    """Compute the torques that reduce the position errors (w, n), and the external torques (2, n) after both filters, from
    which the errors of the model are subtracted.

    velocity: velocities (n,) of the twin's links; found: coefficients (kinds, n) of the regression; shares: weights of a new
    value in the filters, and, as last number, the relative difference of the copies' parameters.
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
                # The deflections of the springs in twin and robot differ by the difference of the link positions.
                lacking = t.torques[i, j] + _known(t.stiffness[j] * error[i, j])
                rows[i, j] += share * ((lacking - own) / shares[2] - rows[i, j])
                total += rows[i, j] * found[i - 1, j]
            external[f, j] = rows[last, j] - total


def judge(
    t: TwinTables, limits: AlarmLimits, rows: Any, springs: Any, stiffness: int, learned: Any, friction: Any, external: Any,
    ready: bool, error: Any, alarm: Any, found: Any,
) -> bool:  # fmt: skip
    """Compute the external torques, thresholds and alarms of each joint. Returns whether a joint's threshold, from noise alone,
    exceeds the largest torque that its springs have carried in motion.

    rows: recorded values of the simulations (w, n, columns); springs: columns (n, k) with the torques of the springs on each
    link, N m, -1 without spring; stiffness: column with the joints' stiffness, -1 without springs; learned: whether the model's
    errors are estimated (n,); friction: of the model (n,), N m; external: torques (2, n) after both filters, N m; ready:
    whether alarms are raised; error: of the twin's positions (n,); alarm: of the last step on entry; found: receives external
    torques and thresholds (2, n), N m.
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
        # Noise and errors of the model are independent, so their thresholds are added as root sum of squares.
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
    """The functions that a twin calls in a step."""

    compare: Callable[..., int] = compare
    pull: Callable[..., None] = pull
    judge: Callable[..., bool] = judge
    learn: Callable[..., None] = learn


def compiled_loops(t: TwinTables, mismatch: Mismatch, watch: JointWatch, gains: Gains, limits: AlarmLimits) -> TwinLoops:
    """The loops, compiled for arrays of any size."""
    one, two, flags, columns = np.zeros(1), np.zeros((1, 1)), np.zeros(1, dtype=bool), np.zeros((1, 1), dtype=np.int64)
    examples = (
        (t, watch, one, two, flags, two, two),
        (t, gains, two, one, two, one, two),
        (t, limits, np.zeros((1, 1, 1)), columns, 0, flags, one, two, True, one, flags, two),
        (mismatch, two, one, flags),
    )
    return TwinLoops(*(compile_function(law, given) for law, given in zip(TwinLoops(), examples, strict=True)))
