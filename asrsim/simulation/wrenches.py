"""Forces and torques on links by signals, as hooks of the loop: each step feels the mean over its kick, jumps included."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from asrsim.engines.base import Engine
from asrsim.scenario.data import Wrench
from asrsim.signals import Constant
from asrsim.signals.base import Signal
from asrsim.simulation.loop import Hook


def wrench_hook(wrench: Wrench, engine: Engine, *, substep: float, staggered: bool) -> Hook:
    """Applies `wrench` before each substep. staggered: kicks go from half step to half step, the first from the start on."""
    signals = (*wrench.force, *wrench.torque)

    def hook(k: int, joints: Sequence[Any], states: Sequence[Any]) -> None:
        values = [0.0 if signal is None else kick_mean(signal, k, substep, staggered=staggered) for signal in signals]
        engine.apply_wrench(wrench.link, values[:3], values[3:], wrench.point, wrench.frame)

    return hook


def kick_mean(signal: Signal, k: int, substep: float, *, staggered: bool) -> float:
    """What acts over substep `k` as a constant over a whole step: the signal's value, or its mean where it jumps."""
    now = round(k * substep, 12)
    if not staggered:
        return float(signal.values(np.array([now]))[0])
    start, end = max(now - 0.5 * substep, 0.0), now + 0.5 * substep
    jumps = np.empty(0) if type(signal) is Constant else signal.jumps(start, end)
    edges = [start, *(jump for jump in jumps.tolist() if start < jump < end), end]
    if len(edges) == 2:
        return float(signal.values(np.array([now]))[0]) * (end - start) / substep
    middles = np.array([0.5 * (a + b) for a, b in pairwise(edges)])
    lengths = np.diff(edges)
    return float(signal.values(middles) @ lengths) / substep
