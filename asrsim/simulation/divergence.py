"""Divergence by physics: numbers that are not finite, and energy from nowhere.

A check for NaN alone misses a spring that is not resolved: it saturates and settles far off, finite and wrong.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from asrsim.errors import DivergenceError
from asrsim.samples import Array
from asrsim.simulation.drives import Drive
from asrsim.simulation.loop import COLUMNS
from asrsim.simulation.recorder import COLUMN

SHARE = 0.5
"""Energy from nowhere, as a share of all that went through, that no resolved run shows."""
FLOOR = 1e-2
"""J below which it is not looked at."""
FASTEST = 1e4
"""rad/s (m/s) that no spring or motor of a robot gives."""


def not_finite(raw: Array) -> int | None:
    """First row of raw (n, joints, columns) with a number that is not finite or absurd, NaN efforts at stops left out."""
    looked = raw[:, :, [i for i, name in enumerate(COLUMNS) if not name.startswith("drive")]]
    bad = ~np.isfinite(looked).all(axis=(1, 2)) | (np.abs(raw[:, :, COLUMN["engine_velocity"]]) > FASTEST).any(axis=1)
    return int(np.argmax(bad)) if bad.any() else None


def blame(raw: Array, row: int, drives: Sequence[Drive]) -> str:
    """The joint that moves fastest, in the rows before `row`, for its inertia: the one that ran away."""
    window = raw[max(row - 5, 0) : row + 1, :, COLUMN["engine_velocity"]]
    speeds = np.nanmax(np.abs(np.where(np.isfinite(window), window, 1e300)), axis=0)
    return drives[int(np.argmax(speeds))].name


def runaway(joint: str, time: float, what: str, omega_h: float) -> DivergenceError:
    """The error with likely cause and cure."""
    cause = (
        f"omega h is {omega_h:.2g} for the stiffest spring: too large a step is likely. Lower the step or raise substeps"
        if omega_h > 0.5
        else "likely an input or gain that drives the joint away, or a contact that cannot be resolved. Look at the last "
        "samples of the log; lower gains, or the step"
    )
    return DivergenceError(f"joint '{joint}' diverged at t = {time:.4f} s: {what}; {cause}", joint=joint, time=time)


class EnergyGuard:
    """Watches that the robot's links do not gain energy that nobody gave them."""

    def __init__(self, energy: float) -> None:
        self._start = energy
        self._turnover = 0.0
        self._given = 0.0

    def excess(self, energy: float, *, given: float, turnover: float) -> float:
        """Energy in J above what was given, 0 within the tolerance.

        energy: kinetic and gravitational energy of the links; given: work of actuators and external torques on them;
        turnover: sum of the absolute flows.
        """
        surplus = energy - self._start - given
        return surplus if surplus > FLOOR + SHARE * turnover else 0.0
