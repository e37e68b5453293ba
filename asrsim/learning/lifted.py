"""The joints' response lifted: one matrix from the coefficients of the whole input to the whole motion.

The rows are samples of the positions, the columns coefficients of cubic B-splines of the inputs, whose knots bound the band
of what is learned.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from asrsim.kinematics.desired import knot_distance
from asrsim.learning.linear import Linearised
from asrsim.samples import Array

if TYPE_CHECKING:
    from scipy.sparse import csr_array

EVERY = 2
"""Samples of the motion for each row of a lifted matrix."""


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
