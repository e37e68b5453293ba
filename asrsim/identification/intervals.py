"""How sure estimates are: least squares under the noise that residuals show, held against the spread between blocks.

The covariance of least squares is H S H: H is the inverse of J'J, S the covariance of J'r. S follows from the noise of each
channel: from its spectrum, by an autoregression of what is left, and from the steps of its encoder. Samples that correlate
tell less than as many independent ones, and give fewer degrees of freedom.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from asrsim.identification.noise import autoregression, whiten
from asrsim.identification.residuals import Part, Residuals, Weights
from asrsim.samples import Array

BLOCKS = 10
"""Of each recording, from whose scores the spread is told."""
CHANCE = 0.95
"""The spread counts where it is larger than that which blocks of white noise have with this probability."""
GONE = 1e-12
"""Share of the largest singular value below which a direction is rounding."""
CORNER = 1e-5
"""Of differences, in the vector's units: over corners that a joint's sticking makes, small beside any deviation."""
REACH = 1e-3
"""Way over which a direction's slope is taken, at most, in the vector's units: null directions may be bent."""
DRAWS = 100
"""Of an encoder's steps."""
AGREES, ROUNDS = 0.3, 4
"""Change of slopes, as a share, that leaves directions as they are; looks at all, at most."""


@dataclass(frozen=True)
class Uncertainty:
    """Of the vector at the estimate."""

    inverse: Array
    """(n, n) of the squared Jacobian, in the directions that are known."""
    covariance: Array
    """(n, n) of the vector, likewise, with the deviations below."""
    deviation: Array
    """(n,) the larger of ordinary and spread; nan where nothing is known."""
    jacobian: Array
    """(m, n) whitened, in deviations of the noise."""
    quantile: Array
    """(n,) of the 95 % interval, in deviations."""
    variance: float
    """Of residuals that, being white, would tell as much: the mean of S in units of J'J."""
    noise: Array
    """(n, n) S, the covariance of J'r."""
    freedom: float
    """Independent samples beyond the numbers that were estimated from them."""
    scores: Array
    """(blocks, n) gradients of the blocks' sums of squares; no rows where only the noise is foreseen."""
    firsts: NDArray[np.intp]
    """(recordings,) first row of each in the scores."""

    def with_deviation(self, deviation: Array, quantile: Array) -> Uncertainty:
        """The same with other deviations (n,) and quantiles (n,), and the covariance that these give."""
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = np.nan_to_num(deviation / np.sqrt(np.diag(self.inverse)), posinf=0.0)
        covariance = self.inverse * np.outer(ratio, ratio)
        return replace(self, covariance=covariance, deviation=deviation, quantile=quantile)

    def deviations(self, directions: Array) -> tuple[Array, Array]:
        """The larger of the noise's deviation and of the blocks' spread, and how many of it the 95 % interval has.

        directions: (k, n) by which J'r moves what is estimated.
        """
        from scipy.special import chdtri, stdtrit

        ordinary = np.sum((directions @ self.noise) * directions, axis=1)
        deviation, quantile = np.sqrt(ordinary), np.full(len(ordinary), stdtrit(self.freedom, 0.975))
        # Blocks of a recording may differ less among each other than recordings do.
        recordings = np.add.reduceat(self.scores, self.firsts, axis=0) if len(self.firsts) > 1 else self.scores[:0]
        for scores in (self.scores, recordings):
            count = len(scores)
            if count < 3:
                continue
            spread = np.sum((scores @ directions.T) ** 2, axis=0) * count / (count - 1)
            with np.errstate(invalid="ignore", divide="ignore"):
                beyond = spread / ordinary > chdtri(count - 1, 1.0 - CHANCE) / (count - 1)
            wide = np.sqrt(spread)
            beyond &= wide * stdtrit(count - 1, 0.975) > deviation * quantile
            deviation, quantile = np.where(beyond, wide, deviation), np.where(beyond, stdtrit(count - 1, 0.975), quantile)
        return deviation, quantile


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
            clipped = np.clip(middle, -6.0 * scale, 6.0 * scale)
            model = autoregression(clipped)
            # Whitening pays where fast noise is louder than slow; of slow noise, least squares are as exact without. The steps
            # of an encoder go with the motion: no autoregression whitens them.
            if channel.quantum or float(np.sum(model)) > 0.0:
                model = np.empty(0)
            given = channel.given and not len(model)
            weights.append(Weights(channel.noise if given else _innovation(left, model), model))
        found.append(weights)
    return found


def _innovation(left: Array, model: Array) -> float:
    """Root mean square of the whitened residuals without outliers; an offset of all of them is no outlier, and counts."""
    white = whiten(left, model)[len(model) :]
    away = np.abs(white - np.median(white))
    scale = float(np.median(away)) / 0.6745
    kept = white[away <= 6.0 * scale] if scale > 0.0 else white
    return max(float(np.sqrt(np.mean(kept**2))) if len(kept) else 0.0, 1e-12)


def noise_of(residuals: Residuals, left: Array, jacobian: Array) -> tuple[Array, float]:
    """(n, n) covariance of J'r as the channels' noise makes it, and how many independent samples tell that.

    left: (m,) residuals; jacobian: (m, n).
    """
    parts, n = residuals.parts(), jacobian.shape[1]
    total, count = np.zeros((n, n)), 0.0
    for part in parts:
        found, independent = _noise_of_part(part, left[part.rows], jacobian[part.rows])
        total, count = total + found, count + independent
    # What the parameters took from the residuals is of the slow part that they follow.
    freedom = max(count - n, 1.0)
    return total * (count / freedom), freedom


def _noise_of_part(part: Part, left: Array, jacobian: Array) -> tuple[Array, float]:
    """Of one channel."""
    if not len(left):
        return np.zeros((jacobian.shape[1],) * 2), 0.0
    model, power = autoregression(left), float(np.mean(left**2))
    innovation = float(np.mean(whiten(left, model)[len(model) :] ** 2))
    slow = innovation / max(1.0 - float(np.sum(model)), 1e-6) ** 2
    independent = len(left) * min(power / slow, 1.0) if slow > 0.0 else float(len(left))
    if part.channel.quantum:
        drawn = _encoder_noise(part, left, power)
        scores = jacobian.T @ drawn
        return scores @ scores.T / DRAWS, independent
    # J' C J with the covariance C of the autoregression, by its spectrum.
    size = 2 * len(left)
    spectrum = innovation / np.abs(np.fft.rfft(np.append(1.0, -model), size)) ** 2
    spectrum[1:-1] *= 2.0
    waves = np.fft.rfft(jacobian, size, axis=0)
    return np.asarray((waves.conj().T * spectrum @ waves).real / size), independent


def _encoder_noise(part: Part, left: Array, power: float) -> Array:
    """(n, draws) residuals that an encoder leaves, whose zero is anywhere in a step, of the predicted motion with noise."""
    generator = np.random.default_rng(0)
    step, size = part.channel.quantum, (len(left), DRAWS)
    noise = generator.normal(scale=max(power * part.weights.noise**2 - step**2 / 12.0, 0.0) ** 0.5, size=size)
    predicted = (part.channel.values[: len(left)] + left * part.weights.noise)[:, None]
    zeros = step * generator.uniform(-0.5, 0.5, size=DRAWS)
    shown = step * np.round((predicted + noise + zeros) / step) - predicted
    return part.weights.weigh(shown, step)


def uncertainty(residuals: Residuals, x: Array, at_bound: Sequence[bool], *, foreseen: bool = False) -> Uncertainty:
    """At x; what an entry at a bound leaves open is so for the others, too. foreseen: as if nothing but the noise were left."""
    n = len(x)
    left = residuals(x)
    jacobian = residuals.jacobian(x, CORNER, base=left, central=True)
    # Outliers count as the fit counts them.
    left = np.clip(left, -4.0, 4.0) if np.mean(np.abs(left) > 6.0) < 0.05 else left
    jacobian = with_faint_directions(residuals, x, jacobian)
    _, singular, vectors = np.linalg.svd(np.linalg.qr(jacobian, mode="r")) if n else (None, np.empty(0), np.empty((0, 0)))
    kept = singular > GONE * singular.max(initial=0.0)
    inverse = (vectors[kept].T / singular[kept] ** 2) @ vectors[kept]
    scores, firsts = np.zeros((0, n)), np.zeros(0, np.intp)
    if not foreseen:
        numbers: Any = residuals.blocks(BLOCKS)
        scores = np.zeros((int(numbers.max()) + 1, n))
        np.add.at(scores, numbers, jacobian * left[:, None])
        empty = ~np.any(scores != 0.0, axis=1)
        of_recording = np.repeat(np.arange(len(scores) // BLOCKS), BLOCKS)[~empty]
        scores, firsts = scores[~empty], np.flatnonzero(np.diff(of_recording, prepend=-1))
        # At a bound the whole has a slope.
        bound = np.asarray(at_bound, dtype=bool)
        scores[:, bound] -= scores[:, bound].mean(axis=0)
    noise, freedom = (jacobian.T @ jacobian, float(len(left))) if foreseen else noise_of(residuals, left, jacobian)
    variance = float(np.sum(inverse * noise)) / max(int(np.sum(kept)), 1)
    found = Uncertainty(inverse, inverse, np.empty(0), jacobian, np.empty(0), variance, noise, freedom, scores, firsts)
    deviation, quantile = found.deviations(inverse)
    # What lies in a direction that is gone is not known, whatever the pseudo-inverse says.
    lost = np.sum(vectors[~kept] ** 2, axis=0) > 1e-6
    return found.with_deviation(np.where(lost, np.nan, deviation), quantile)


def with_faint_directions(residuals: Residuals, x: Array, jacobian: Array) -> Array:
    """Jacobian (m, n) by slopes along the directions of its own singular vectors, each over its deviation.

    Where joints stick, slopes have corners: one of the columns may be of the other side of it, and what is left of two that
    cancel of neither.
    """
    low, high = residuals.layout.bounds
    for _ in range(ROUNDS):
        _, sizes, directions = np.linalg.svd(np.linalg.qr(jacobian, mode="r"))
        moves = directions * np.minimum(1.0 / np.maximum(sizes, 1.0 / REACH), REACH)[:, None]
        inside = np.all((x - np.abs(moves) >= low) & (x + np.abs(moves) <= high), axis=1)
        agreed = True
        for i in np.flatnonzero(inside):
            slope = jacobian @ directions[i]
            along = (residuals(x + moves[i]) - residuals(x - moves[i])) / (2.0 * float(np.linalg.norm(moves[i])))
            agreed &= float(np.linalg.norm(along - slope)) < AGREES * float(np.linalg.norm(slope))
            jacobian = jacobian + np.outer(along - slope, directions[i])
        if agreed:
            break
    return jacobian


def correlations(covariance: Array) -> Array:
    """(n, n) of a covariance; 0 where an entry has none."""
    deviation = np.sqrt(np.diag(covariance))
    with np.errstate(invalid="ignore", divide="ignore"):
        matrix = covariance / np.outer(deviation, deviation)
    return np.where(np.isfinite(matrix), matrix, 0.0)
