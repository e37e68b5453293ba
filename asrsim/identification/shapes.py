"""A start from what a recording shows as a whole: at which frequencies it swings, how fast that dies, and how large it is.

Where a model rings at another frequency than the recording, sample by sample nothing tells which way to go. Quantiles of the
spectrum and of the energy over time move with frequency and damping, however far off these are.
"""

from __future__ import annotations

import numpy as np

from asrsim.identification.data import Channel
from asrsim.identification.problem import Problem, errors
from asrsim.samples import Array

QUANTILES = np.array([0.1, 0.3, 0.5, 0.7, 0.9])
"""Of the power over frequencies, and of the energy over time."""
ROUGHLY = 0.05
"""Difference of a logarithm of frequency or size, or of a share of the duration, that counts 1."""
STEP, ROUNDS, WEAK = 0.02, 25, 0.1
"""Of differences; steps at most; weight of the start, which holds what these numbers do not show."""


def as_it_rings(problem: Problem, x: Array) -> Array:
    """From x, the vector whose motion has the frequencies, decays and sizes of the recorded one."""
    from scipy.optimize import least_squares

    recorded = _shapes(problem, None)
    low, high = problem.layout.bounds

    def off(there: Array) -> Array:
        return np.append((_shapes(problem, there) - recorded) / ROUGHLY, WEAK * (there - x))

    begin = np.clip(x, low + 1e-6, high - 1e-6)
    found = least_squares(
        off, begin, bounds=(low, high), loss="soft_l1", x_scale=0.3, diff_step=STEP / np.maximum(np.abs(begin), 1e-3),
        max_nfev=ROUNDS, ftol=1e-3, xtol=1e-3,
    )  # fmt: skip
    return np.asarray(found.x, dtype=np.float64)


def _shapes(problem: Problem, x: Array | None) -> Array:
    """Of every channel, as predicted at x, or as recorded."""
    rows = []
    for number in problem.fitted:
        until = problem.until(number) + 1e-9
        left = None if x is None else errors(problem, x, number)
        for i, channel in enumerate(problem.tracks[number].channels):
            recorded = channel.values[channel.time <= until]
            # A motion that is not sane has no shape: it is as far off as can be.
            off = 1e6 * np.arange(len(recorded)) if left is None else left[i]
            rows.append(_shape(channel, recorded if x is None else recorded + off))
    return np.concatenate(rows)


def _shape(channel: Channel, values: Array) -> Array:
    """Logarithms of frequencies, shares of the duration, logarithm of the size of the velocity."""
    n = len(values)
    grid = np.linspace(channel.time[0], channel.time[n - 1], n)
    speed = np.diff(np.interp(grid, channel.time[:n], values))
    frequency = np.fft.rfftfreq(n - 1)[1:]
    # Noise of the places has this power in their differences.
    noise = max(channel.noise, channel.quantum) ** 2 * n * 4.0 * np.sin(np.pi * frequency) ** 2
    power = np.maximum(np.abs(np.fft.rfft(speed))[1:] ** 2 - 4.0 * noise, 0.0) + 1e-12 * noise
    energy = speed**2 + 1e-300
    return np.concatenate(
        [
            np.log(np.interp(QUANTILES, np.cumsum(power) / power.sum(), frequency)),
            np.interp(QUANTILES, np.cumsum(energy) / energy.sum(), np.linspace(0.0, 1.0, n - 1)),
            [0.5 * np.log(power.sum() + 1e-300)],
        ]
    )
