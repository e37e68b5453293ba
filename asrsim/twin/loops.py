"""Loops over the joints of a twin and its copies in a step: observed torques and thresholds. They run as Python or compiled.

All arrays are those of `TwinTables`, since a step must not create arrays: for few joints, that takes longer than the numbers.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from asrsim.compiled.compiling import compile_function
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
    """Standard deviation (n,) of the torque for alarms, from noise alone, N m."""


class AlarmLimits(NamedTuple):
    """Numbers of the thresholds of alarms."""

    forgotten: float
    """Share of the springs' largest torque that is forgotten in a step."""
    noise_gain: float
    """Standard deviation of the torque for one of the position, for links of inertia 1, s^-2."""
    sigmas: float
    """Standard deviations of an alarm."""
    release: float
    """Fraction of the threshold at which an alarm ends."""
    slowest: float
    """Speed of a link that moves, rad/s."""
    tolerance: float
    """Tolerated errors of the model, estimated and not estimated, as fractions of the springs' largest torque."""
    unlearned: float
    friction: float
    """Multiples of the friction that are tolerated, in motion and at rest."""
    sticking: float


def tables(simulations: int, joints: int, columns: int) -> TwinTables:
    """The arrays at the start. columns: number of columns of the regression's rows."""
    shape = simulations, joints
    return TwinTables(
        integral=np.zeros(shape), lagged=np.zeros(shape), torques=np.zeros(shape), masses=np.eye(joints),
        stiffness=np.full(joints, np.nan), rows=np.zeros((2, columns, joints)), before=np.full((2, joints), np.nan),
        missing=np.zeros(joints, dtype=np.int64), variance=np.zeros(joints), peak=np.zeros(joints), carried=np.zeros(joints),
        noise=np.zeros(joints),
    )  # fmt: skip


def measure(t: TwinTables, positions: Any, share: float) -> None:
    """Update the noise of the measured positions (n,). share: weight of a new value."""
    for j in range(len(positions)):
        position = positions[j]
        bend = position - 2.0 * t.before[1, j] + t.before[0, j]
        # The second difference of white noise has six times the variance of the noise.
        if bend == bend:
            t.variance[j] += share * (bend * bend / 6.0 - t.variance[j])
        t.before[0, j] = t.before[1, j]
        t.before[1, j] = position
        t.missing[j] = 0 if position == position else t.missing[j] + 1


def pull(t: TwinTables, gains: Gains, error: Any, velocity: Any, found: Any, shares: Any, external: Any) -> None:
    """Compute the torques that reduce the position errors (w, n), and the external torques (2, n) after both filters without
    the errors of the model.

    velocity: velocities (n,) of the twin's links; found: coefficients (kinds, n) of the regression; shares: of a new value in
    the filters, with the difference of the copies' parameters as last number.
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
    t: TwinTables, limits: AlarmLimits, springs: Any, learned: Any, friction: Any, fast: Any, ready: bool, alarm: Any,
    threshold: Any,
) -> None:  # fmt: skip
    """Compute the threshold (n,) and the alarms (n,) of each joint.

    springs: torques (k, n) of the springs, N m; learned: whether the model's errors are estimated (n,); friction: of the model
    (n,), N m; fast: torque for alarms (n,), N m; ready: whether alarms are raised; alarm: of the last step on entry.
    """
    joints = len(threshold)
    for j in range(joints):
        spring = 0.0
        for k in range(len(springs)):
            spring += _known(springs[k, j])
        t.peak[j] = max(abs(spring), t.peak[j] * (1.0 - limits.forgotten))
        t.carried[j] = max(t.carried[j], t.peak[j])
        total = 0.0
        for k in range(joints):
            total += t.masses[j, k] * t.masses[j, k] * t.variance[k]
        t.noise[j] = limits.noise_gain * math.sqrt(total)
        # Noise and errors of the model are independent, so their thresholds are added as root sum of squares.
        tolerated = (limits.tolerance if learned[j] else limits.unlearned) * t.peak[j]
        tolerated += (limits.friction if abs(t.rows[0, 0, j]) > limits.slowest else limits.sticking) * friction[j]
        threshold[j] = math.hypot(limits.sigmas * t.noise[j], tolerated)
        least = threshold[j] * limits.release if alarm[j] else threshold[j]
        alarm[j] = abs(fast[j]) > least and ready


def _known(value: float) -> float:
    return value if value == value else 0.0


class TwinLoops(NamedTuple):
    """The functions `measure`, `pull` and `judge`."""

    measure: Callable[..., None] = measure
    pull: Callable[..., None] = pull
    judge: Callable[..., None] = judge


def compiled_loops(t: TwinTables, gains: Gains, limits: AlarmLimits) -> TwinLoops:
    """The loops, compiled for arrays of any size."""
    one, two, flags = np.zeros(1), np.zeros((1, 1)), np.zeros(1, dtype=bool)
    examples = (
        (t, one, 1.0),
        (t, gains, two, one, two, one, two),
        (t, limits, two, flags, one, one, True, flags, one),
    )
    return TwinLoops(*(compile_function(law, given) for law, given in zip(TwinLoops(), examples, strict=True)))
