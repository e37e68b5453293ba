"""Forces and torques that signals apply to links; in each step their mean over the kick acts."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from asrsim.samples import Array
from asrsim.scenario.data import Wrench
from asrsim.signals import Constant
from asrsim.signals.base import Signal


def wrench_table(wrench: Wrench, *, staggered: bool) -> Callable[[int, int, float], Array]:
    """Function (first substep, count, substep in s) -> forces and torques (count, 6) in N, N m.

    staggered: kicks go from half step to half step, the first from the start on.
    """
    signals = (*wrench.force, *wrench.torque)

    def table(first: int, count: int, substep: float) -> Array:
        values = np.zeros((count, 6))
        for column, signal in enumerate(signals):
            if signal is not None:
                values[:, column] = _means(signal, first, count, substep, staggered)
        return values

    return table


def _means(signal: Signal, first: int, count: int, substep: float, staggered: bool) -> Array:
    """What acts over substeps `first` .. as a constant over a whole step each: the value, or its mean where it jumps."""
    time = np.round(np.arange(first, first + count) * substep, 12)
    values = signal.values(time).astype(float)
    if not staggered:
        return values
    start, end = max((first - 0.5) * substep, 0.0), (first + count - 0.5) * substep
    jumps = np.empty(0) if type(signal) is Constant else signal.jumps(start, end)
    cut = set(np.floor(jumps / substep + 0.5).astype(int).tolist()) | ({0} if first == 0 else set())
    for k in cut:
        if first <= k < first + count:
            values[k - first] = _kick_mean(signal, k, substep)
    return values


def _kick_mean(signal: Signal, k: int, substep: float) -> float:
    now = round(k * substep, 12)
    start, end = max(now - 0.5 * substep, 0.0), now + 0.5 * substep
    jumps = np.empty(0) if type(signal) is Constant else signal.jumps(start, end)
    edges = [start, *(jump for jump in jumps.tolist() if start < jump < end), end]
    if len(edges) == 2:
        return float(signal.values(np.array([now]))[0]) * (end - start) / substep
    middles = np.array([0.5 * (a + b) for a, b in pairwise(edges)])
    return float(signal.values(middles) @ np.diff(edges)) / substep
