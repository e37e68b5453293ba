"""How sure estimates are: ordinary least squares on whitened residuals, held against the spread between blocks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from asrsim.identification.noise import autoregression
from asrsim.identification.residuals import Residuals, Weights
from asrsim.samples import Array

BLOCKS = 10
"""Of each recording, from whose scores the spread is told."""
CHANCE = 0.95
"""The spread counts where it is larger than that which blocks of white noise have with this probability."""
GONE = 1e-12
"""Share of the largest singular value below which a direction is rounding."""


@dataclass(frozen=True)
class Uncertainty:
    """Of the vector at the estimate."""

    covariance: Array
    """(n, n) of the vector, ordinary, of the directions that are known."""
    deviation: Array
    """(n,) the larger of ordinary and spread; nan where nothing is known."""
    spread: Array
    """(n,) from the blocks."""
    jacobian: Array
    """(m, n) whitened, in deviations of the noise."""
    quantile: Array
    """(n,) of the 95 % interval, in deviations."""


def whitened(residuals: Residuals, x: Array) -> list[list[Weights]]:
    """Noise and autoregression of each channel, from what is left at x."""
    found = []
    for track, one in enumerate(residuals.tracks):
        raw = residuals.raw(x, track, residuals.until(track)) or []
        weights = []
        for channel, left in zip(one.channels, raw, strict=True):
            middle = left - np.median(left)
            scale = max(float(np.median(np.abs(middle))) / 0.6745, 1e-300)
            # What an outlier left over must not shape the model of the noise.
            model = autoregression(np.clip(middle, -6.0 * scale, 6.0 * scale))
            weights.append(Weights(noise=_innovation(left, model), model=model))
            if channel.given and not len(model):
                weights[-1].noise = channel.noise
        found.append(weights)
    return found


def _innovation(left: Array, model: Array) -> float:
    """Standard deviation of the whitened residuals, outliers clipped."""
    from asrsim.identification.noise import whiten

    white = whiten(left, model)[len(model) :]
    scale = float(np.median(np.abs(white - np.median(white)))) / 0.6745
    kept = white[np.abs(white) <= 6.0 * scale] if scale > 0.0 else white
    return max(float(np.sqrt(np.mean(kept**2))) if len(kept) else 0.0, 1e-12)


def uncertainty(residuals: Residuals, x: Array, at_bound: Sequence[bool], *, foreseen: bool = False) -> Uncertainty:
    """At x; entries at a bound are held there. foreseen: as if nothing but the noise were left."""
    from scipy.stats import chi2, norm, t

    n = len(x)
    jacobian = residuals.jacobian(x, central=True)
    left = residuals(x)
    # Outliers count as the fit counts them.
    left = np.clip(left, -4.0, 4.0) if np.mean(np.abs(left) > 6.0) < 0.05 else left
    free = ~np.asarray(at_bound, dtype=bool)
    inner = jacobian[:, free]
    variance = float(left @ left) / max(len(left) - n, 1)
    _, singular, vectors = np.linalg.svd(np.linalg.qr(inner, mode="r")) if inner.size else (None, np.empty(0), np.empty((0, 0)))
    kept = singular > GONE * singular.max(initial=0.0)
    inverse = (vectors[kept].T / singular[kept] ** 2) @ vectors[kept] if kept.any() else np.zeros((free.sum(), free.sum()))
    # What lies in a direction that is gone is not known, whatever the pseudo-inverse says.
    lost = np.sum(vectors[~kept] ** 2, axis=0) > 1e-6 if kept.any() else np.ones(int(free.sum()), bool)
    blocks: Any = residuals.blocks(BLOCKS)
    number = int(blocks.max()) + 1
    scores = np.zeros((number, int(free.sum())))
    np.add.at(scores, blocks, inner * left[:, None])
    scores = scores[np.any(scores != 0.0, axis=1)]
    count = max(len(scores), 2)
    spread = inverse @ (scores.T @ scores) @ inverse * count / (count - 1)
    if foreseen:
        variance = 1.0
    ordinary = variance * inverse
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = np.diag(spread) / np.diag(ordinary)
    beyond = np.zeros(len(ratio), bool) if foreseen else ratio > chi2.ppf(CHANCE, count - 1) / (count - 1)
    deviation = np.sqrt(np.maximum(np.where(beyond, np.diag(spread), np.diag(ordinary)), 0.0))
    deviation[lost] = np.nan
    quantile = np.where(beyond, t.ppf(0.975, count - 1), norm.ppf(0.975))
    covariance = np.zeros((n, n))
    covariance[np.ix_(free, free)] = ordinary
    return Uncertainty(
        covariance=covariance, deviation=_spread_out(deviation, free),
        spread=_spread_out(np.sqrt(np.maximum(np.diag(spread), 0.0)), free),
        jacobian=jacobian, quantile=_spread_out(quantile, free),
    )  # fmt: skip


def _spread_out(values: Array, free: Array) -> Array:
    result = np.full(len(free), np.nan)
    result[free] = values
    return result


def correlations(covariance: Array) -> Array:
    """(n, n) of a covariance; 0 where an entry has none."""
    deviation = np.sqrt(np.diag(covariance))
    with np.errstate(invalid="ignore", divide="ignore"):
        matrix = covariance / np.outer(deviation, deviation)
    return np.where(np.isfinite(matrix), matrix, 0.0)
