"""Roots of many increasing functions at once: the laws of springs inverted over a whole motion."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from asrsim.samples import Array

MOST_STEPS = 120
"""Evaluations at most; some fifteen are usual."""
TOLERANCE = 1e-11
"""rad or m, width of the bracket at which a root is found."""


def increasing_roots(function: Callable[[Array], Array], low: Array, high: Array) -> Array:
    """(n,) places in [low, high] (n,) each at which `function`, elementwise and increasing, is 0.

    Where it has no root there, the end that is nearer to one. Regula falsi (Illinois), with a bisection in every third step.
    """
    low, high = np.array(low, dtype=float), np.array(high, dtype=float)
    with np.errstate(all="ignore"):
        f_low, f_high = function(low), function(high)
        # A missing root is closed in on at the end that it lies beyond.
        high = np.where(f_low >= 0.0, low, high)
        low = np.where((f_high <= 0.0) & (f_low < 0.0), high, low)
        for step in range(MOST_STEPS):
            middle = 0.5 * (low + high)
            if step % 3 != 2:
                secant = (low * f_high - high * f_low) / (f_high - f_low)
                middle = np.where(np.isfinite(secant) & (secant > low) & (secant < high), secant, middle)
            value = function(middle)
            above = value >= 0.0
            # Illinois: the end that stays counts half, so that both ends move.
            f_low, f_high = np.where(above, 0.5 * f_low, value), np.where(above, value, 0.5 * f_high)
            high = np.where(above, middle, high)
            low = np.where((value <= 0.0), middle, low)
            if np.all(high - low <= TOLERANCE):
                break
    return 0.5 * (low + high)
