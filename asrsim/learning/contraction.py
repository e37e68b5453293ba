"""Laws of a fixed gain in the frequency domain: which errors shrink, which gain learns fast, which cutoff is safe.

About a posture q = P(w) u, and an error e becomes Q (1 - P K) e in the next trial (paper equation 13 with a filter Q):
errors shrink at the frequencies where the largest singular value of |Q| (1 - P K) is below 1, and grow where it is above.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from asrsim.learning.linear import Linearised
from asrsim.samples import Array

Complex = NDArray[np.complex128]
SAFE = 0.95
"""Largest factor of an error in one update that counts as safe."""
FREQUENCIES = np.concatenate([[0.0], np.geomspace(0.05, 60.0, 240)])
"""Hz at which factors are looked at."""
POSTURES = 5
"""Postures of a motion at which they are."""
LOWER = 0.7
"""Gains fall by this factor until a cutoff makes them safe."""


def responses(linear: Linearised, row: int, frequencies: Array = FREQUENCIES) -> Complex:
    """(frequencies, m, m) complex: link positions for inputs at `frequencies` in Hz, about the motion's sample `row`."""
    change, inputs = linear.continuous
    a, b = change[row], inputs[row]
    states = 2j * np.pi * frequencies[:, None, None] * np.eye(len(a)) - a
    return np.asarray(np.linalg.solve(states, np.broadcast_to(b, (len(frequencies), *b.shape)))[:, : b.shape[1]])


def rows_of(linear: Linearised, count: int = POSTURES) -> list[int]:
    """Samples of the motion, spread over it."""
    return sorted(set(np.linspace(0, len(linear.time) - 1, count).round().astype(int).tolist()))


def factors(linear: Linearised, gains: Sequence[float], frequencies: Array = FREQUENCIES) -> Array:
    """(frequencies,) the largest factor of an error in one update, over the postures: |1 - P K|; gains: of the first joints."""
    m = len(gains)
    found = [
        np.linalg.norm(np.eye(m) - responses(linear, row, frequencies)[:, :m, :m] * np.asarray(gains), 2, axis=(1, 2))
        for row in rows_of(linear)
    ]
    return np.asarray(np.max(found, axis=0))


def learnable(linear: Linearised, gains: Sequence[float]) -> float:
    """Hz: below it every error shrinks with these gains; it says how far equation 13 reaches, not where a filter is safe."""
    growing = np.flatnonzero(factors(linear, gains) >= 1.0)
    return float(FREQUENCIES[-1] if not len(growing) else FREQUENCIES[max(growing[0] - 1, 0)])


def choose_gains(linear: Linearised, *, largest: float = 1.0) -> tuple[float, ...]:
    """Gains that make the slowest error of slow motions shrink fastest over the motion, at most `largest`.

    With S the static share of the input that arrives at the link, an update leaves 1 - S K of the error; over S
    from S_min to S_max the least of the largest is at K = 2 / (S_min + S_max). Gains above 1 learn faster where gravity
    works against soft springs, but leave no margin to resonances: hence the bound.
    """
    shares = np.array([np.diag(responses(linear, row, np.zeros(1))[0]).real for row in rows_of(linear, 41)])
    best = 2.0 / np.maximum(shares.min(axis=0) + shares.max(axis=0), 1e-9)
    return tuple(float(gain) for gain in np.minimum(best, largest))


def zero_phase_amplitude(frequencies: Array, cutoff: float, order: int) -> Array:
    """Amplitude of the learning filter: Butterworth forwards and backwards."""
    return np.asarray(1.0 / (1.0 + (frequencies / cutoff) ** (2 * order)))


def safe_filter(linear: Linearised, gains: Sequence[float], order: int) -> tuple[tuple[float, ...], float]:
    """Gains and the highest cutoff in Hz with which every error shrinks: |Q| |1 - P K| <= 0.95 at all frequencies and postures.

    The gains are lowered where no cutoff does it.
    """
    cutoffs = FREQUENCIES[1:]
    scale = 1.0
    while True:
        chosen = tuple(scale * gain for gain in gains)
        amplification = factors(linear, chosen)
        for cutoff in cutoffs[::-1]:
            if np.all(zero_phase_amplitude(FREQUENCIES, float(cutoff), order) * amplification <= max(SAFE, amplification[0])):
                if amplification[0] < 1.0:
                    return chosen, float(cutoff)
                break
        scale *= LOWER
        if scale < 0.01:
            # Errors that shrink at no gain, even slowly, are those of unstable or unmoved joints.
            return chosen, float(cutoffs[0])
