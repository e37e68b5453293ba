"""Norm-optimal learning over several models of the arm, with a safeguard: the law `auto`.

The joints' response is lifted: a matrix G from the coefficients of the whole input, cubic B-splines whose knots bound the
band of what is learned, to samples of the whole motion. With models G_i of masses and springs that are nominal, heavier and
softer, lighter and stiffer, the change du = B c of the best trial's input follows from its error e over the whole time,

    c = (mean G_i' G_i + rho B' B)^-1 (mean G_i)' e.

A trial that is no better goes back to the best one with ten times rho; one that is better goes on with a third. So the error
of the best trial never grows, however wrong the models are, and a step that is small enough helps.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from asrsim.kinematics.desired import knot_distance
from asrsim.learning.linear import Linearised
from asrsim.learning.trial import LearningProblem, Outcome, Trial
from asrsim.samples import Array

if TYPE_CHECKING:
    from scipy.sparse import csr_array

EVERY = 2
"""Samples of the motion for each row of a lifted matrix."""
MODELS = ((1.0, 1.0), (1.25, 0.8), (0.8, 1.25))
"""Factors of mass and stiffness."""
RHO = 0.1
"""Weight of the input's change against the error, at least."""
TAIL = 20
"""Knots behind the end of the motion through which its last error is taken to stand: what the last inputs do shows there."""
RHO_UP, RHO_DOWN = 10.0, 3.0
"""Factors on the weight of changes after a trial that was worse, and after one that was better."""
REHEARSALS = 4
"""Further updates in a model before each trial, at most."""
PROGRESS = 0.99
"""Share of the best error below which a trial counts as progress."""


@dataclass(frozen=True, kw_only=True)
class Band:
    """Cubic B-splines on a motion's time: the changes of the input that are learned."""

    knots: Array
    """With the repeated ends."""

    @classmethod
    def over(cls, duration: float, tail: float) -> Band:
        """For a motion of `duration` s, and `tail` s behind it."""
        pieces = max(round((duration + tail) / knot_distance(duration)), 4)
        inner = np.linspace(0.0, duration + tail, pieces + 1)
        return cls(knots=np.concatenate([np.zeros(3), inner, np.full(3, inner[-1])]))

    @property
    def count(self) -> int:
        """Splines."""
        return len(self.knots) - 4

    def at(self, time: Array) -> csr_array:
        """(n, count) values of the splines at `time` (n,)."""
        from scipy.interpolate import BSpline

        return BSpline.design_matrix(np.clip(time, self.knots[0], self.knots[-1]), self.knots, 3)


def lift(linear: Linearised, band: Band, delays: Sequence[float]) -> Array:
    """(rows, m, count m): positions at every EVERY-th sample for each coefficient; columns by spline, then joint.

    delays: s by which each of the first m joints' commands arrives late; the others' do not change.
    """
    states, inputs = linear.steps
    n, m = len(linear.time), len(delays)
    middle = 0.5 * (linear.time[1:] + linear.time[:-1])
    # Before a command arrives its first value stands, as it does in a run.
    values = [band.at(middle - delay).toarray() for delay in delays]
    columns = band.count * m
    state = np.zeros((states.shape[1], columns))
    found = np.zeros((len(range(EVERY, n, EVERY)), m, columns))
    latest = 0
    for index in range(n - 1):
        # Splines of later times have not acted yet.
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
    """The lifted models of an arm; linear: its joints along the motion, delays: s, of each learned joint's command."""

    def __init__(self, time: Array, linear: Linearised, delays: Sequence[float]) -> None:
        self._time = time
        duration = float(linear.time[-1])
        tail = TAIL * knot_distance(duration)
        self._band = Band.over(duration, tail)
        linear = linear.held(tail)
        self._rows = linear.time[EVERY::EVERY]
        spline = self._band.at(self._rows).toarray()
        self._effort = np.kron(spline.T @ spline, np.eye(len(delays)))
        self._basis = self._band.at(time)
        self._normal = np.zeros_like(self._effort)
        self._mean = np.zeros((len(self._rows) * len(delays), len(self._effort)))
        for mass, stiffness in MODELS:
            lifted = lift(linear.scaled(mass, stiffness), self._band, delays)
            flat = lifted.reshape(-1, lifted.shape[2])
            self._normal += flat.T @ flat / len(MODELS)
            self._mean += flat / len(MODELS)

    def change(self, error: Array, rho: float) -> Array:
        """(n, joints) change of the inputs for an error (n, joints)."""
        from scipy.linalg import solve

        seen = averaged(self._time, error, self._rows)
        found = solve(self._normal + rho * self._effort, self._mean.T @ seen.ravel(), assume_a="pos")
        return np.asarray(self._basis @ found.reshape(self._band.count, -1))


@dataclass(frozen=True)
class NormOptimal:
    """The law."""

    problem: LearningProblem
    lifted: Lifted

    def propose(self, trials: Sequence[Trial]) -> Array:
        """The best trial's input, corrected by its error."""
        best, rho, _ = standing(trials)
        return best.inputs + self.lifted.change(best.error, rho)

    def verdict(self, trials: Sequence[Trial], patience: int) -> tuple[Outcome, str] | None:
        """Gives up when more than `patience` trials in a row brought no progress."""
        best, _, failed = standing(trials)
        if not np.isfinite(best.total):
            return "growing", f"trial {trials[-1].number} has no finite error: the simulation diverged"
        if failed <= patience:
            return None
        return "stalled", (
            f"stopped: {failed} iterations brought no progress; the best trial, number {best.number}, is "
            f"{self.problem.worst(best)} off ({self.problem.worst_place(best)})"
        )


def rehearsed(problem: LearningProblem, lifted: Lifted, best: Trial, rho: float, forecast: Callable[[Array], Array]) -> Array:
    """The best trial's input after some updates in a model that knows more than the lifted ones, such as friction."""
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
    """The best trial by its error over the whole time, rho for the next update, and the trials since there was progress."""
    best, rho, failed = trials[0], RHO, 0
    for trial in trials[1:]:
        better = np.isfinite(trial.total) and not trial.total >= best.total
        failed = 0 if better and trial.total <= PROGRESS * best.total else failed + 1
        rho = max(RHO, rho / RHO_DOWN) if better else RHO_UP * rho
        best = trial if better else best
    return best, rho, failed


def averaged(time: Array, values: Array, rows: Array) -> Array:
    """(rows, joints) means of `values` (n, joints) around the equidistant times `rows`, so that noise averages out."""
    total = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    half = 0.5 * float(rows[1] - rows[0])
    step = float(time[1] - time[0])
    wide = max(round(2.0 * half / step), 1)
    # Behind the end its last mean stands.
    first = np.clip(np.round((rows - half) / step).astype(int), 0, len(time) - wide)
    last = np.clip(np.round((rows + half) / step).astype(int), first + 1, len(time))
    return np.asarray((total[last] - total[first]) / (last - first)[:, None])
