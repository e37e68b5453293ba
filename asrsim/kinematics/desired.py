"""A desired motion with its derivatives: samples smoothed by splines whose knots bound the band."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asrsim.samples import Array

MODEL_STEP = 4e-3
"""s, at least, between samples of a motion as the models take it."""
MODEL_SAMPLES = 2000
"""Samples of a motion at most: longer motions are taken coarser."""
KNOT = 0.03
"""s, at least, between the knots of motions and inputs: nothing faster than some 15 Hz is asked for."""
MOST_KNOTS = 200
"""Knots of a motion, however long it is."""


@dataclass(frozen=True, kw_only=True)
class DesiredMotion:
    """Positions over time with two derivatives; columns in the order of a model's joints."""

    time: Array
    """(n,) s, equidistant."""
    positions: Array
    """(n, joints) rad or m."""
    velocities: Array
    """(n, joints)."""
    accelerations: Array
    """(n, joints)."""

    @property
    def step(self) -> float:
        """s."""
        return float(self.time[1] - self.time[0])


def model_time(duration: float, step: float) -> Array:
    """(n,) s: the grid on which models follow a motion of `duration` s that the simulation takes in steps of `step` s."""
    wanted = max(MODEL_STEP, duration / MODEL_SAMPLES, step)
    return np.linspace(0.0, duration, max(round(duration / wanted), 8) + 1)


def knot_distance(duration: float) -> float:
    """s between knots for a motion of `duration` s."""
    return max(KNOT, duration / MOST_KNOTS)


def smooth_motion(time: Array, samples: Array) -> DesiredMotion:
    """`samples` (n, joints) at `time` (n,), equidistant, as quintic splines by least squares."""
    from scipy.interpolate import make_lsq_spline

    duration = float(time[-1] - time[0])
    pieces = max(min(round(duration / knot_distance(duration)), (len(time) - 6) // 2), 1)
    inner = np.linspace(time[0], time[-1], pieces + 1)
    knots = np.concatenate([np.full(5, inner[0]), inner, np.full(5, inner[-1])])
    spline = make_lsq_spline(time, samples, knots, k=5)
    return DesiredMotion(time=time, positions=spline(time), velocities=spline(time, nu=1), accelerations=spline(time, nu=2))
