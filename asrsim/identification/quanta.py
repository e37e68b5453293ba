"""What encoders' steps do to estimates, which are no noise, for a motion that comes again meets the same; and what noise of
played commands does, which the robot's own swings carry on.
"""

from __future__ import annotations

import numpy as np

from asrsim.identification.intervals import Uncertainty
from asrsim.identification.inverse import InverseTrack
from asrsim.identification.noise import whiten
from asrsim.identification.residuals import Residuals
from asrsim.samples import Array

PHASES = (0.0, 0.25, 0.5, 0.75)
"""Where steps may lie, in steps: an encoder's zero is anywhere."""
DRAWS = 8
"""Of noise of the played commands."""


def with_quanta(residuals: Residuals, x: Array, found: Uncertainty) -> Uncertainty:
    """The same with deviations that hold what the encoders' steps, put on what x predicts, would make of the estimates."""
    if not any(channel.quantum for track in residuals.tracks for channel in track.channels):
        return found
    shifts = [found.inverse @ (found.jacobian.T @ _steps(residuals, x, phase)) for phase in PHASES]
    moved = np.mean(np.square(shifts), axis=0)
    # Those that count up to where they are, and not to the nearest, are half a step off, all of them at once.
    keys = {c.key for track in residuals.tracks for c in track.channels if c.quantum}
    moved += sum(np.abs(found.inverse @ (found.jacobian.T @ _zero(residuals, key))) for key in sorted(keys)) ** 2
    return found.with_deviation(np.hypot(found.deviation, np.sqrt(moved)), found.quantile)


def with_played(residuals: Residuals, x: Array, found: Uncertainty) -> Uncertainty:
    """The same with deviations that hold what noise as the played commands have it makes of the estimates: what it leaves is
    correlated as the robot swings, which a few blocks do not tell.
    """
    if any(isinstance(track, InverseTrack) for track in residuals.tracks):
        # There noise of places is all that is left.
        return found
    shifts = []
    for draw in range(DRAWS):
        parts, first = np.zeros(len(found.jacobian)), 0
        for number, track in enumerate(residuals.tracks):
            until = residuals.until(number)
            moved = track.shaken(residuals.layout.table(x, number), draw)
            for i, (channel, weights) in enumerate(zip(track.channels, residuals.weights[number], strict=True)):
                count = int(np.sum(channel.time <= until + 1e-9))
                if moved is not None:
                    parts[first : first + count] = whiten(moved[i][:count], weights.model) / weights.noise
                first += count
        if not np.any(parts):
            return found
        shifts.append(found.inverse @ (found.jacobian.T @ parts))
    alone = np.sqrt(found.variance * np.diag(found.inverse) + np.mean(np.square(shifts), axis=0))
    with np.errstate(invalid="ignore"):
        wider = np.maximum(1.0, 1.96 * alone / (found.deviation * found.quantile))
    return found.with_deviation(found.deviation * np.where(np.isfinite(wider), wider, 1.0), found.quantile)


def _zero(residuals: Residuals, key: str) -> Array:
    """(m,) what a zero of an encoder as far off as its steps leave it, on average, makes of the residuals."""
    parts = []
    for number, track in enumerate(residuals.tracks):
        for channel, weights in zip(track.channels, residuals.weights[number], strict=True):
            count = int(np.sum(channel.time <= residuals.until(number) + 1e-9))
            size = channel.quantum / np.sqrt(12.0) if channel.key == key else 0.0
            parts.append(whiten(np.full(count, size), weights.model) / weights.noise)
    return np.concatenate(parts)


def _steps(residuals: Residuals, x: Array, phase: float) -> Array:
    """(m,) what rounding to steps makes of the residuals."""
    parts = []
    for number, track in enumerate(residuals.tracks):
        predicted = track.predict(residuals.layout.table(x, number), residuals.until(number)) or []
        for channel, values, weights in zip(track.channels, predicted, residuals.weights[number], strict=False):
            off = np.zeros(len(values))
            if channel.quantum:
                off = channel.quantum * (np.floor(values / channel.quantum + phase) + 0.5 - phase) - values
            parts.append(whiten(off, weights.model) / weights.noise)
    return np.concatenate(parts)
