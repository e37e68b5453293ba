"""Sensors that restart: after a whole turn, or when their counter is full. Finds and removes the jumps of their numbers."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from asrsim.samples import Array

_WIDEST = 1.5
"""Largest step between two samples, in periods, of a sensor that restarts after each period."""
_LARGE, _SMALL = 0.5, 0.25
"""A step is a restart if it is larger than the fraction _LARGE of the range of the numbers, and if all other steps are smaller
than the fraction _SMALL.
"""
_OFTEN = 0.35
"""Largest fraction of the steps that are restarts."""


def turn_of(numbers: Array, factor: float, scale: float) -> float | None:
    """Number after which an angle restarts, in the numbers of a file; None if neither whole turn fits the jumps.

    The sensor may be on either side of a gear: the numbers restart after a whole turn before or after the multiplication by
    `scale`. The result is the period whose jumps occur in the numbers. If both periods occur, it is the period after whose
    removal the numbers change least.

    Args:
        numbers: Numbers of the file (n,), all finite.
        factor: Factor from the unit of the numbers to rad, without the scale.
        scale: Factor that is stated in addition to the unit.
    """
    steps = np.abs(np.diff(numbers))
    candidates = {math.tau / factor, math.tau / abs(factor * scale)} if scale else set()
    if len(candidates) == 1:
        return candidates.pop()
    found = [one for one in candidates if len(steps) and 0.5 * one < steps.max() < _WIDEST * one]
    return min(found, key=lambda one: float(np.abs(np.diff(np.unwrap(numbers, period=one))).sum()), default=None)


def unwrapped(numbers: Array, period: float) -> Array:
    """Numbers (n,) without jumps by whole periods. NaN stays NaN."""
    found = np.array(numbers, dtype=np.float64)
    known = np.isfinite(found)
    found[known] = np.unwrap(found[known], period=period)
    return found


def restarts(numbers: Array) -> tuple[NDArray[np.int64], float]:
    """Indices of the samples after which a sensor seems to restart, and the mean size of a restart. No index if it seems not to
    restart.

    At a restart, the numbers jump through most of their range, against the direction in which they change before and after.
    """
    none: tuple[NDArray[np.int64], float] = np.empty(0, dtype=np.int64), 0.0
    steps, span = np.diff(numbers), float(np.ptp(numbers)) if len(numbers) else 0.0
    jumps = np.abs(steps) > _LARGE * span
    if not jumps.any() or np.mean(jumps) > _OFTEN or np.max(np.abs(steps[~jumps])) > _SMALL * span:
        return none
    places = np.flatnonzero(jumps)
    inner = places[(places > 0) & (places < len(steps) - 1)]
    inner = inner[~jumps[inner - 1] & ~jumps[inner + 1]]
    around = np.sign(steps[inner])[:, None] * np.column_stack([steps[inner - 1], steps[inner + 1]])
    if not len(inner) or np.any(around >= 0.0):
        return none
    return places, float(np.mean(np.abs(steps[inner]) - around.mean(axis=1)))
