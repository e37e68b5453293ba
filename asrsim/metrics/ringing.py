"""Frequency and decay of a damped oscillation, from its last small swings."""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass

import numpy as np

from asrsim.samples import Array

LARGEST, SMALLEST = 3e-3, 1e-7
"""Share of the step between which the swings are fitted: small enough for a straight spring, far above rounding."""


@dataclass(frozen=True, kw_only=True)
class Ringing:
    """A linear oscillation x'' + 2 decay x' + natural^2 x = 0."""

    natural: float
    """rad/s, of the undamped oscillation."""
    decay: float
    """1/s."""
    samples: int
    """That were fitted."""

    @property
    def frequency(self) -> float:
        """Hz, undamped."""
        return self.natural / (2.0 * math.pi)


def fit_ringing(time: Array, velocity: Array, *, start: float) -> Ringing:
    """Fit of the tail of `velocity` (n,), equidistant, after `start` s; NaN where there is too little to fit.

    A sampled damped oscillation obeys x[k+1] = a x[k] - b x[k-1] exactly, whatever its damping; a and b by least squares in
    Prony's manner, each sample weighted by the decay so that early and late swings count alike. The velocity has no offset.
    """
    step = float(time[1] - time[0])
    values = velocity[time > start]
    largest = float(np.max(np.abs(values)))
    # From where the envelope stays below the upper share to where it stays below the lower one.
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


def natural_frequency(time: Array, values: Array) -> float:
    """Frequency in Hz, without its damping, of the last small swings about 0 (of a velocity, say); samples must be even."""
    return fit_ringing(time, values, start=-math.inf).frequency


def decay_rate(time: Array, values: Array) -> float:
    """Rate at which the last small swings about 0 (of a velocity, say) decay: c / (2 I) of a joint; samples must be even."""
    return fit_ringing(time, values, start=-math.inf).decay
