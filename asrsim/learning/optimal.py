"""The learning law `auto`: norm-optimal learning with several models of the arm, and with a safeguard.

A model of the arm is a lifted matrix G. It maps the coefficients of the whole input to samples of the whole motion. The input
is a cubic B-spline, whose knots limit the bandwidth of the learned input. There are three models G_i: a nominal model, a
heavier and softer model, and a lighter and stiffer model. The change du = B c of the best trial's input is computed from the
error e of this trial over the whole time,

    c = (mean G_i' G_i + rho B' B)^-1 (mean G_i)' e.

If a trial is not better than the best trial, rho is multiplied by ten, and the next trial corrects the best trial again. After
a better trial, rho is divided by three. Therefore the error of the best trial never grows, even if the models are wrong, and a
small enough change reduces it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from asrsim.kinematics.drive_inverse import knot_distance
from asrsim.learning.linear import Linearised
from asrsim.learning.trial import LearningProblem, Outcome, Trial
from asrsim.samples import Array

if TYPE_CHECKING:
    from scipy.sparse import csr_array

EVERY = 2
"""Number of samples of the motion from one row of a lifted matrix to the next."""
MODELS = ((1.0, 1.0), (1.25, 0.8), (0.8, 1.25))
"""Factors of mass and of stiffness of each model."""
RHO = 0.1
"""Smallest weight rho of the input's change relative to the error."""
TAIL = 20
"""Number of knots after the end of the motion. During this time the last inputs still act, and the last error is repeated."""
RHO_UP, RHO_DOWN = 10.0, 3.0
"""RHO_UP: factor of the weight rho after a worse trial.
RHO_DOWN: divisor of the weight rho after a better trial.
"""
REHEARSALS = 4
"""Largest number of further updates that are tried on the nonlinear model before each trial."""
PROGRESS = 0.99
"""A trial counts as progress if its error is below this fraction of the smallest error of the earlier trials."""


@dataclass(frozen=True, kw_only=True)
class InputSplines:
    """Cubic B-splines over the time of a motion, for changes of the input."""

    knots: Array
    """Knots of the splines, s; the first and the last knot are repeated."""

    @classmethod
    def over(cls, duration: float, tail: float) -> InputSplines:
        """Splines for a motion of `duration` s, and for `tail` s after the motion."""
        pieces = max(round((duration + tail) / knot_distance(duration)), 4)
        inner = np.linspace(0.0, duration + tail, pieces + 1)
        return cls(knots=np.concatenate([np.zeros(3), inner, np.full(3, inner[-1])]))

    @property
    def count(self) -> int:
        """Number of splines."""
        return len(self.knots) - 4

    def at(self, time: Array) -> csr_array:
        """Values (n, count) of the splines at `time` (n,)."""
        from scipy.interpolate import BSpline

        return BSpline.design_matrix(np.clip(time, self.knots[0], self.knots[-1]), self.knots, 3)


def lift(linear: Linearised, band: InputSplines, delays: Sequence[float], *, from_rest: bool = False) -> Array:
    """Lifted matrix (rows, m, count m): positions of m joints at every EVERY-th sample for each coefficient. Its columns are
    ordered by spline, and then by joint.

    delays: command delay of each of the first m joints, s; commands of the other joints do not change. from_rest: whether the
    motion starts at the equilibrium of the first inputs, which then determine the initial state.
    """
    states, inputs = linear.steps
    n, m = len(linear.time), len(delays)
    middle = 0.5 * (linear.time[1:] + linear.time[:-1])
    # During the initial delay the first command is in effect, as in a simulation.
    values = [band.at(middle - delay).toarray() for delay in delays]
    columns = band.count * m
    state = np.zeros((states.shape[1], columns))
    found = np.zeros((len(range(EVERY, n, EVERY)), m, columns))
    latest = 0
    if from_rest:
        # At time 0 the first spline is 1, and the other splines are 0.
        change, driven = linear.continuous
        state[:, :m], latest = -np.linalg.solve(change[0], driven[0])[:, :m], 1
    for index in range(n - 1):
        # Splines that begin at a later time have no effect yet.
        latest = max([latest, *(int(np.flatnonzero(value[index])[-1]) + 1 for value in values if value[index].any())])
        active = latest * m
        part = states[index] @ state[:, :active]
        for joint, value in enumerate(values):
            near = np.flatnonzero(value[index])
            part[:, near * m + joint] += np.outer(inputs[index][:, joint], value[index, near])
        state[:, :active] = part
        if (index + 1) % EVERY == 0:
            found[(index + 1) // EVERY - 1, :, :active] = part[:m]
    return found


class Lifted:
    """Lifted models of an arm. linear: arm linearised along the motion; delays: command delay of each learned joint, s;
    from_rest: whether the motion starts at the equilibrium of the first inputs.
    """

    def __init__(self, time: Array, linear: Linearised, delays: Sequence[float], *, from_rest: bool) -> None:
        self._time = time
        duration = float(linear.time[-1])
        tail = TAIL * knot_distance(duration)
        self._band = InputSplines.over(duration, tail)
        linear = linear.held(tail)
        self._rows = linear.time[EVERY::EVERY]
        spline = self._band.at(self._rows).toarray()
        self._effort = np.kron(spline.T @ spline, np.eye(len(delays)))
        self._basis = self._band.at(time)
        self._normal = np.zeros_like(self._effort)
        self._mean = np.zeros((len(self._rows) * len(delays), len(self._effort)))
        for mass, stiffness in MODELS:
            lifted = lift(linear.scaled(mass, stiffness), self._band, delays, from_rest=from_rest)
            flat = lifted.reshape(-1, lifted.shape[2])
            self._normal += flat.T @ flat / len(MODELS)
            self._mean += flat / len(MODELS)

    def change(self, error: Array, rho: float) -> Array:
        """Change (n, joints) of the inputs for an error (n, joints)."""
        from scipy.linalg import solve

        seen = averaged(self._time, error, self._rows)
        found = solve(self._normal + rho * self._effort, self._mean.T @ seen.ravel(), assume_a="pos")
        return np.asarray(self._basis @ found.reshape(self._band.count, -1))


@dataclass(frozen=True)
class NormOptimal:
    """The learning law `auto`: norm-optimal updates of the best trial's input."""

    problem: LearningProblem
    lifted: Lifted

    def propose(self, trials: Sequence[Trial]) -> Array:
        """Input of the best trial, corrected by its error."""
        best, rho, _ = standing(trials)
        return best.inputs + self.lifted.change(best.error, rho)

    def verdict(self, trials: Sequence[Trial], patience: int) -> tuple[Outcome, str] | None:
        """Outcome and reason if learning ends, since the simulation diverged or more than `patience` trials brought no
        progress; None to continue.
        """
        best, _, failed = standing(trials)
        if not np.isfinite(best.total):
            return "growing", f"trial {trials[-1].number} has no finite error: the simulation diverged"
        if failed <= patience:
            return None
        return "stalled", (
            f"stopped: {failed} iterations brought no progress; the largest error of the best trial, number {best.number}, is "
            f"{self.problem.worst(best)} ({self.problem.worst_place(best)})"
        )


def rehearsed(problem: LearningProblem, lifted: Lifted, best: Trial, rho: float, forecast: Callable[[Array], Array]) -> Array:
    """Input of the best trial after several updates on a nonlinear model. Unlike the lifted models, the nonlinear model has
    friction.

    forecast: function from inputs (n, joints) to the outputs (n, joints) that the nonlinear model predicts.
    """
    found, seen = best.inputs, best.outputs
    for number in range(1 + REHEARSALS):
        left = problem.reference - seen
        inputs = found + lifted.change(left, rho)
        outputs = forecast(inputs)
        if number and not np.sum((problem.reference - outputs) ** 2) < np.sum(left**2):
            break
        found, seen = inputs, outputs
    return found


def standing(trials: Sequence[Trial]) -> tuple[Trial, float, int]:
    """Best trial by its error over the whole time, weight rho for the next update, and number of trials since the last
    progress.
    """
    best, rho, failed = trials[0], RHO, 0
    for trial in trials[1:]:
        better = np.isfinite(trial.total) and not trial.total >= best.total
        failed = 0 if better and trial.total <= PROGRESS * best.total else failed + 1
        rho = max(RHO, rho / RHO_DOWN) if better else RHO_UP * rho
        best = trial if better else best
    return best, rho, failed


def averaged(time: Array, values: Array, rows: Array) -> Array:
    """Means (rows, joints) of `values` (n, joints) around the equidistant times `rows`, s. Averaging reduces noise. After the
    end, the last mean is repeated.
    """
    from scipy.ndimage import uniform_filter1d

    step = float(time[1] - time[0])
    means = uniform_filter1d(values, max(round(float(rows[1] - rows[0]) / step), 1), axis=0, mode="nearest")
    return np.asarray(means[np.minimum(np.round(rows / step).astype(int), len(time) - 1)])
