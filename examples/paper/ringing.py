"""Frequency and decay rate of a damped oscillation, from its last small swings."""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass

import numpy as np

from asrsim.samples import Array

LARGEST, SMALLEST = 3e-3, 1e-7
"""Range of the fitted swings as fractions of the largest value: small enough for a linear spring, far above rounding."""


@dataclass(frozen=True, kw_only=True)
class Ringing:
    """Linear oscillation x'' + 2 decay x' + natural^2 x = 0."""

    natural: float
    """Undamped natural frequency, rad/s."""
    decay: float
    """Decay rate, 1/s."""
    samples: int
    """Number of fitted samples."""

    @property
    def frequency(self) -> float:
        """Undamped frequency, Hz."""
        return self.natural / (2.0 * math.pi)


def fit_ringing(time: Array, velocity: Array, *, start: float) -> Ringing:
    """Oscillation fitted to the tail of `velocity` (n,), evenly sampled, after `start` s; NaN if the tail is too short.

    A sampled damped oscillation satisfies x[k+1] = a x[k] - b x[k-1] exactly for any damping. Prony's method estimates a and b
    by least squares; weights cancel the decay, so early and late swings count equally. The velocity has no offset.
    """
    step = float(time[1] - time[0])
    values = velocity[time > start]
    largest = float(np.max(np.abs(values)))
    # Fit between the times at which the envelope falls below the upper and the lower limit.
    envelope = np.maximum.accumulate(np.abs(values)[::-1])[::-1]
    first = int(np.searchsorted(-envelope, -LARGEST * largest))
    last = int(np.searchsorted(-envelope, -SMALLEST * largest))
    x, scale = values[first:last], envelope[first:last]
    if len(x) < 8:
        return Ringing(natural=math.nan, decay=math.nan, samples=len(x))
    system = np.column_stack([x[1:-1], -x[:-2]]) / scale[1:-1, None]
    a, b = np.linalg.lstsq(system, x[2:] / scale[1:-1], rcond=None)[0]
    root = (a + cmath.sqrt(a * a - 4.0 * b)) / 2.0
    rate = cmath.log(root) / step
    return Ringing(natural=abs(rate), decay=-rate.real, samples=len(x))
