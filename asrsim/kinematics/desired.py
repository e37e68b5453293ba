"""A desired motion with its derivatives: samples smoothed by splines whose knot distance limits the bandwidth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asrsim.samples import Array

MODEL_STEP = 4e-3
"""Smallest time step between the samples of a motion for the inverse models, s."""
MODEL_SAMPLES = 2000
"""Largest number of samples of a motion: a longer motion is sampled more coarsely."""
KNOT = 0.03
"""Smallest distance between spline knots of motions and inputs, s. It limits their bandwidth to about 15 Hz."""
MOST_KNOTS = 200
"""Largest number of spline knots of a motion."""


@dataclass(frozen=True, kw_only=True)
class DesiredMotion:
    """Positions over time with two derivatives; the columns are in the order of the model's joints."""

    time: Array
    """Equidistant times (n,), s."""
    positions: Array
    """Positions (n, joints), rad or m."""
    velocities: Array
    """Velocities (n, joints)."""
    accelerations: Array
    """Accelerations (n, joints)."""

    @property
    def step(self) -> float:
        """Time step in s."""
        return float(self.time[1] - self.time[0])


def model_time(duration: float, step: float) -> Array:
    """Time grid (n,) of the inverse models for a motion of `duration` s that is simulated in steps of `step` s."""
    wanted = max(MODEL_STEP, duration / MODEL_SAMPLES, step)
    return np.linspace(0.0, duration, max(round(duration / wanted), 8) + 1)


def knot_distance(duration: float) -> float:
    """Time in s between spline knots for a motion of `duration` s."""
    return max(KNOT, duration / MOST_KNOTS)


def smooth_motion(time: Array, samples: Array) -> DesiredMotion:
    """Motion along quintic splines, fitted by least squares to `samples` (n, joints) at equidistant `time` (n,)."""
    from scipy.interpolate import make_lsq_spline

    duration = float(time[-1] - time[0])
    pieces = max(min(round(duration / knot_distance(duration)), (len(time) - 6) // 2), 1)
    inner = np.linspace(time[0], time[-1], pieces + 1)
    knots = np.concatenate([np.full(5, inner[0]), inner, np.full(5, inner[-1])])
    spline = make_lsq_spline(time, samples, knots, k=5)
    return DesiredMotion(time=time, positions=spline(time), velocities=spline(time, nu=1), accelerations=spline(time, nu=2))
