"""Loops over the joints of a twin and of its copies, which compute observed torques and alarm thresholds in each step. They run
as Python or compiled.

The loops write into the arrays of `TwinTables` and create no arrays of their own: for few joints, it takes longer to create an
array than to compute its values.
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
    """Arrays of a twin with n joints. It consists of w simulations: the twin itself, and its copies with other parameters."""

    integral: Any
    """Integral of the position error (w, n), a state of the observer, rad s."""
    lagged: Any
    """Lagged position error (w, n), the other state of the observer."""
    torques: Any
    """Torques that pull the simulated links towards the measured positions, (w, n), N m."""
    masses: Any
    """Mass matrix (n, n) at the twin's positions, kg m^2."""
    stiffness: Any
    """Stiffness (n,) of the twin's joints, N m/rad; NaN: unknown."""
    rows: Any
    """Present row of the regression after each of the two filters, (2, kinds + 3, n); see `asrsim.twin.mismatch`."""
    before: Any
    """Positions (2, n) that were measured in the last two steps."""
    missing: Any
    """Number of successive steps (n,) without a measured position, up to now."""
    variance: Any
    """Variance (n,) of the noise of the measured positions, rad^2."""
    peak: Any
    """Largest recent torque (n,) of each joint's springs, which decays with time, N m."""
    carried: Any
    """Largest torque (n,) of each joint's springs since the twin began, N m."""
    noise: Any
    """Standard deviation (n,) of the torque for alarms that is caused by the noise of the positions alone, N m."""


class AlarmLimits(NamedTuple):
    """Numbers from which the alarm thresholds are computed."""

    forgotten: float
    """Fraction by which the springs' largest recent torque decays in a step."""
    noise_gain: float
    """Standard deviation of the torque for alarms divided by that of the position's noise, for a link of inertia 1, s^-2."""
    sigmas: float
    """Threshold for noise, as a multiple of the standard deviation of the torque that noise alone causes."""
    release: float
    """Fraction of the threshold below which the torque must fall to end an alarm."""
    slowest: float
    """Speed above which a link counts as moving, rad/s."""
    tolerance: float
    """Threshold for errors of the model after they were estimated, as a fraction of the springs' largest recent torque."""
    unlearned: float
    """Threshold for errors of the model before they were estimated, as a fraction of the springs' largest recent torque."""
    friction: float
    """Threshold for errors of the friction while the link moves, as a multiple of the friction."""
    sticking: float
    """Threshold for errors of the friction while the link is at rest, as a multiple of the friction."""


class JointWatch(NamedTuple):
    """Numbers with which measured positions are checked."""

    share: float
    """Weight of a new measurement in the moving average that gives the variance of the noise."""
    step: float
    """Time step, s."""
    gap: float
    """Time without a measurement above which the twin is set to the next measured position, s."""
    jump: float
    """Difference between a joint's measured and twin position above which the twin is set to the measured position, rad (m)."""


JUMPED, LOST, MISSING = 1, 2, 4
"""Findings of `compare` in a step: a joint is far from its twin; is measured again after a gap; is not measured."""


def tables(simulations: int, joints: int, columns: int) -> TwinTables:
    """Arrays of a twin at its start. columns: number of entries of a row of the regression, kinds + 3."""
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

    positions: measured positions (n,), which are replaced by positions that the twin can follow, rad; links: link positions in
    the simulations (w, n), rad; coupled: whether each joint follows another joint (n,); stops: lowest and highest positions of
    the joints (2, n), rad; error: receives the position errors. Returns the sum of `JUMPED`, `LOST` and `MISSING`, each if it
    applies to any joint.
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
            # A coupled joint follows another joint, whose measured position corrects both.
            position = math.nan
        # Move a position beyond a stop to the stop: the twin cannot go there, and the measurement must be wrong.
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
    """Compute the torques that pull the links, and the external torques after each of the two filters. The torques that the
    regression ascribes to errors of the model are subtracted from the external torques.

    error: position errors (w, n); velocity: velocities (n,) of the twin's links; found: coefficients (kinds, n) of the
    regression; shares: weight of a new value in each filter, and the fraction by which the copies' parameters are larger;
    external: receives the external torques (2, n), N m.
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
                # The deflections of the simulated and the robot's springs differ by the position error. Add the torque of this
                # difference.
                lacking = t.torques[i, j] + _known(t.stiffness[j] * error[i, j])
                rows[i, j] += share * ((lacking - own) / shares[2] - rows[i, j])
                total += rows[i, j] * found[i - 1, j]
            external[f, j] = rows[last, j] - total


def judge(
    t: TwinTables, limits: AlarmLimits, rows: Any, springs: Any, stiffness: int, learned: Any, friction: Any, external: Any,
    ready: bool, error: Any, alarm: Any, found: Any,
) -> bool:  # fmt: skip
    """Compute the reported external torque, the alarm threshold and the alarm of each joint. Returns whether, for any joint,
    the threshold for noise alone exceeds the largest torque that its springs have carried so far.

    rows: recorded values of the simulations (w, n, columns); springs: indices (n, k) of the columns with the torque of each
    spring on each link, N m, -1: no such spring; stiffness: index of the column with the joints' stiffness, -1: no such column;
    learned: whether the errors of the model are estimated (n,); friction: friction in the model (n,), N m; external: external
    torques (2, n) after both filters, N m; ready: whether alarms may be raised; error: position errors (n,) of the twin; alarm:
    alarms (n,) of the last step, which are replaced by those of this step; found: receives external torques and thresholds
    (2, n), N m.
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
        # Noise is independent of the errors of the model, so the squares of both thresholds are added.
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
