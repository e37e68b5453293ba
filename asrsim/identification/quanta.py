"""What encoders' steps do to estimates: they are no noise, for a motion that comes again meets the same."""

from __future__ import annotations

import numpy as np

from asrsim.identification.intervals import Uncertainty
from asrsim.identification.noise import whiten
from asrsim.identification.residuals import Residuals
from asrsim.samples import Array

PHASES = (0.0, 0.25, 0.5, 0.75)
"""Where steps may lie, in steps: an encoder's zero is anywhere."""


def with_quanta(residuals: Residuals, x: Array, found: Uncertainty) -> Uncertainty:
    """The same with deviations that hold what the encoders' steps, put on what x predicts, would make of the estimates."""
    if not any(channel.quantum for track in residuals.tracks for channel in track.channels):
        return found
    shifts = [found.inverse @ (found.jacobian.T @ _steps(residuals, x, phase)) for phase in PHASES]
    moved = np.sqrt(np.mean(np.square(shifts), axis=0))
    return found.with_deviation(np.hypot(found.deviation, moved), found.quantile)


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
