"""Intervals of the estimates, from the noise in the residuals and from the spread between blocks of the recordings.

The covariance of least squares is H S H: J is the Jacobian of the residuals r, H the inverse of J'J, and S the covariance of
J'r. S follows from the noise of each channel: from its spectrum, by an autoregression of the residuals, and from the steps of
its encoder.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from asrsim.identification.noise import autocovariances, autoregression
from asrsim.identification.problem import Part, Problem, jacobian, residuals, residuals_at, weigh
from asrsim.samples import Array

BLOCKS = 10
"""Number of blocks of each recording whose gradients give the spread."""
CHANCE = 0.95
"""The spread between blocks is used if it exceeds this quantile of its distribution under white noise."""
GONE = 1e3
"""Standard deviation, in the vector's units, above which a direction is unidentifiable."""
CORNER = 1e-5
"""Step of finite differences, in the vector's units: larger than the kinks that sticking causes, smaller than the standard
deviations.
"""
REACH = 1e-3
"""Largest step of a directional derivative, in the vector's units."""
DRAWS = 100
"""Number of random draws of an encoder's quantisation."""
AGREES, ROUNDS = 0.3, 4
"""Relative change below which corrected directional derivatives are accepted; largest number of rounds of correction."""
PLAYED = 8
"""Number of random draws of the commands' noise."""
CORRECTIONS = 3
"""Number of rounds that correct autocovariances for the fitted parameters."""
STATIONARY = 1e-3
"""Smallest allowed distance of an autoregressive model from instability."""
FINER = 4
"""Factor by which substeps are refined to estimate the time-step error."""


@dataclass(frozen=True)
class Uncertainty:
    """Uncertainty of the parameter vector at the estimate."""

    inverse: Array
    """Pseudo-inverse (n, n) of J'J in the identifiable directions."""
    covariance: Array
    """Covariance (n, n) of the vector, scaled so that its diagonal agrees with `deviation`."""
    deviation: Array
    """Standard deviations (n,), the larger of an estimate from noise and an estimate from blocks; nan for unidentifiable
    entries.
    """
    jacobian: Array
    """Derivatives (m, n) of the weighted residuals."""
    quantile: Array
    """Half width (n,) of the 95 % interval, in standard deviations."""
    noise: Array
    """Covariance S (n, n) of J'r."""
    freedom: float
    """Degrees of freedom of the noise's variance."""
    scores: Array
    """Gradients (blocks, n) of the blocks' sums of squares; empty if only white noise is assumed."""
    firsts: NDArray[np.intp]
    """First row of each recording in the scores, (recordings,)."""
    at_bound: NDArray[np.bool_]
    """Whether each entry (n,) of the vector ended at a bound."""

    def with_deviation(self, deviation: Array, quantile: Array) -> Uncertainty:
        """Uncertainty with other standard deviations (n,) and quantiles (n,), and the resulting covariance."""
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = np.nan_to_num(deviation / np.sqrt(np.diag(self.inverse)), posinf=0.0)
        covariance = self.inverse * np.outer(ratio, ratio)
        return replace(self, covariance=covariance, deviation=deviation, quantile=quantile)

    def deviations(self, directions: Array) -> tuple[Array, Array]:
        """Standard deviations (k,) from noise or from the spread between blocks, and half widths of the 95 % intervals in units
        of these deviations.

        directions: derivatives (k, n) of the estimated quantities with respect to J'r.
        """
        from scipy.special import chdtri, stdtrit

        ordinary = np.sum((directions @ self.noise) * directions, axis=1)
        deviation, quantile = np.sqrt(ordinary), np.full(len(ordinary), stdtrit(self.freedom, 0.975))
        # Recordings may differ more from each other than the blocks of a recording.
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

    @property
    def of_a_block(self) -> Uncertainty:
        """Uncertainty of an estimate from a single block, which shows how estimates of a wrong model differ between parts."""
        count = max(len(self.scores), 1)
        spread = np.sqrt(np.sum((self.scores @ self.inverse) ** 2, axis=0) * count)
        return self.with_deviation(np.maximum(self.deviation, spread), self.quantile)


@dataclass(frozen=True, eq=False)
class _Noise:
    """Covariance C of a channel's noise, from an autoregression of its residuals (n,)."""

    spectrum: Array
    """Power spectrum (n + 1,) at the frequencies of 2 n samples."""
    freedom: float
    """Degrees of freedom of the estimated spectral level at low frequencies."""

    @staticmethod
    def of(covariances: Array, samples: int) -> _Noise:
        model, power = autoregression(covariances, samples)
        total, order = float(np.sum(model)), len(model)
        # The level is power / (1 - total)^2; the variance of `total` follows from the least-squares fit of the coefficients.
        lags = np.abs(np.subtract.outer(np.arange(order), np.arange(order)))
        ones = np.ones(order)
        variance = power * float(ones @ np.linalg.lstsq(covariances[lags], ones)[0]) / samples if order else 0.0
        relative = 2.0 / samples + 4.0 * variance / max(1.0 - total, STATIONARY) ** 2
        gain = np.maximum(np.abs(np.fft.rfft(np.append(1.0, -model), 2 * samples)), STATIONARY)
        return _Noise(power / gain**2, 2.0 / relative)

    def times(self, columns: Array) -> Array:
        """Product (n, k) of C and columns (n, k)."""
        n = len(columns)
        waves = self.spectrum[:, None] * np.fft.rfft(columns, 2 * n, axis=0)
        return np.asarray(np.fft.irfft(waves, 2 * n, axis=0)[:n])

    def lost(self, basis: Array, spread: Array, taken: Array, lags: int) -> Array:
        """Autocovariance (lags,) of the noise minus the autocovariance of the residuals, which are smaller since parameters
        were fitted.

        basis: orthonormal basis (n, k) of the Jacobian's columns; spread: C times basis; taken: basis' C basis (k, k), summed
        over the channels.
        """
        n, own = len(basis), np.fft.irfft(self.spectrum)[:lags]
        crossed = 2.0 * spread - basis @ taken
        short = [
            lag * own[lag] + 0.5 * float(np.sum(basis[: n - lag] * crossed[lag:]) + np.sum(crossed[: n - lag] * basis[lag:]))
            for lag in range(lags)
        ]
        return np.array(short) / n


def noise_of(problem: Problem, left: Array, slopes: Array) -> tuple[Array, float]:
    """Covariance (n, n) of J'r due to the channels' noise, and its degrees of freedom.

    Fitting reduces the residuals, especially if the noise is as slow as the motion. The autocovariances of the residuals are
    corrected by the expected reduction (Worsley et al. 2002, NeuroImage 15, 1-15). left: residuals (m,); slopes: Jacobian (m,
    n).
    """
    parts = [part for part in problem.parts if part.rows.stop - part.rows.start > 1]
    shown = [autocovariances(left[part.rows]) for part in parts]
    bases, lost = [np.linalg.qr(slopes)[0][part.rows] for part in parts], [np.zeros(len(one)) for one in shown]
    for _ in range(CORRECTIONS + 1):
        models = [_Noise.of(own + less, len(basis)) for own, less, basis in zip(shown, lost, bases, strict=True)]
        spreads = [model.times(basis) for model, basis in zip(models, bases, strict=True)]
        taken = sum((basis.T @ one for basis, one in zip(bases, spreads, strict=True)), np.zeros((1, 1)))
        lost = [
            model.lost(basis, spread, taken, len(own))
            for model, basis, spread, own in zip(models, bases, spreads, shown, strict=True)
        ]
    total = np.zeros((slopes.shape[1],) * 2)
    for part, model in zip(parts, models, strict=True):
        own = slopes[part.rows]
        if part.channel.quantum:
            scores = own.T @ _encoder_noise(part, left[part.rows])
            total += scores @ scores.T / DRAWS
        else:
            total += own.T @ model.times(own)
    return total, max(sum(model.freedom for model in models) - slopes.shape[1], 1.0)


def _encoder_noise(part: Part, left: Array) -> Array:
    """Random residuals (n, draws) of an encoder with a random zero within a step, for the predicted motion with noise."""
    generator = np.random.default_rng(0)
    step, size = part.channel.quantum, (len(left), DRAWS)
    power = float(np.mean(left**2)) * part.noise**2
    noise = generator.normal(scale=max(power - step**2 / 12.0, 0.0) ** 0.5, size=size)
    predicted = (part.recorded + left * part.noise)[:, None]
    zeros = step * generator.uniform(-0.5, 0.5, size=DRAWS)
    shown = step * np.round((predicted + noise + zeros) / step) - predicted
    return weigh(shown, part.noise, step)


def uncertainty(problem: Problem, x: Array, *, foreseen: bool = False, quick: bool = False) -> Uncertainty:
    """Uncertainty of the parameter vector x. Entries at a bound count as free. foreseen: no search was made, and the residuals
    are assumed to be white noise; quick: derivatives are computed with one simulation for each entry.
    """
    n, left = len(x), residuals(problem, x)
    # Without a search, an entry that starts at a bound, such as a delay of 0, did not move to the bound.
    at_bound = problem.layout.at_bound(x) & (not foreseen)
    slopes = jacobian(problem, x, CORNER, base=left)
    # Clip outliers, as the fit does.
    left = np.clip(left, -4.0, 4.0) if np.mean(np.abs(left) > 6.0) < 0.05 else left
    slopes = slopes if quick else with_faint_directions(problem, x, slopes)
    _, singular, vectors = np.linalg.svd(np.linalg.qr(slopes, mode="r")) if n else (None, np.empty(0), np.empty((0, 0)))
    kept = singular > max(1.0 / GONE, 1e-12 * singular.max(initial=0.0))
    inverse = (vectors[kept].T / singular[kept] ** 2) @ vectors[kept]
    scores, firsts = np.zeros((0, n)), np.zeros(0, np.intp)
    if not foreseen:
        numbers = problem.blocks(BLOCKS)
        scores = np.zeros((int(numbers.max()) + 1, n))
        np.add.at(scores, numbers, slopes * left[:, None])
        empty = ~np.any(scores != 0.0, axis=1)
        of_recording = np.repeat(np.arange(len(scores) // BLOCKS + 1), BLOCKS)[: len(scores)][~empty]
        scores, firsts = scores[~empty], np.flatnonzero(np.diff(of_recording, prepend=-1))
        # At a bound the sum of the gradients differs from 0, so their mean is subtracted.
        scores[:, at_bound] -= scores[:, at_bound].mean(axis=0)
    noise, freedom = (slopes.T @ slopes, float(len(left))) if foreseen else noise_of(problem, left, slopes)
    found = Uncertainty(inverse, inverse, np.empty(0), slopes, np.empty(0), noise, freedom, scores, firsts, at_bound)
    deviation, quantile = found.deviations(inverse)
    # Entries in a discarded direction are unidentifiable, although the pseudo-inverse gives a value.
    lost = np.sum(vectors[~kept] ** 2, axis=0) > 1e-6
    return found.with_deviation(np.where(lost, np.nan, deviation), quantile)


def with_faint_directions(problem: Problem, x: Array, slopes: Array) -> Array:
    """Jacobian (m, n) corrected by central differences along its singular vectors, over one standard deviation each.

    Sticking joints make residuals non-smooth, so that small differences between columns are unreliable. Directions whose
    derivatives change are corrected again. Entries near a bound keep their columns.
    """
    low, high = problem.layout.bounds
    basis = np.eye(len(x))[(x - REACH >= low) & (x + REACH <= high)]
    for _ in range(ROUNDS):
        if not len(basis):
            break
        _, sizes, vectors = np.linalg.svd(np.linalg.qr(slopes @ basis.T, mode="r"))
        basis = vectors @ basis
        sizes = np.append(sizes, np.zeros(len(basis) - len(sizes)))
        reach = np.minimum(1.0 / np.maximum(sizes, 1.0 / REACH), REACH)[:, None]
        ahead, back = np.split(residuals_at(problem, [*(x + reach * basis), *(x - reach * basis)]), 2)
        known, along = slopes @ basis.T, ((ahead - back) / (2.0 * reach)).T
        slopes = slopes + (along - known) @ basis
        basis = basis[np.linalg.norm(along - known, axis=0) > AGREES * np.linalg.norm(known, axis=0)]
    return slopes


def widened(problem: Problem, x: Array, found: Uncertainty) -> Uncertainty:
    """Uncertainty that includes the effects of the time step and of noise of the commands. A few blocks do not show the
    noise of the commands, since it excites oscillations of the robot.
    """
    shifts = [-found.inverse @ (found.jacobian.T @ change) for change in _shaken(problem, x)]
    variance = found.deviation**2 + (np.mean(np.square(shifts), axis=0) if shifts else 0.0)
    if problem.tracks[0].door.exact_in_time:
        substeps, motors = problem.playing.substeps
        finer = replace(problem.playing, substeps=(FINER * substeps, motors))
        change = residuals(replace(problem, playing=finer), x) - residuals(problem, x)
        # Extrapolate the time-step error to infinitely fine substeps; sticking joints cause an error of first order.
        variance += (found.inverse @ (found.jacobian.T @ change) / (1.0 - 1.0 / FINER)) ** 2
    return found.with_deviation(np.sqrt(variance), found.quantile)


def _shaken(problem: Problem, x: Array) -> Iterator[Array]:
    """Changes (m,) of the residuals due to noise of the commands; none if torques are compared, since recorded torques contain
    this noise.
    """
    tracks, base = [problem.tracks[i] for i in problem.fitted], residuals(problem, x)
    if not any(track.data.guides or not track.has_noisy_inputs for track in tracks):
        for draw in range(PLAYED):
            yield residuals(replace(problem, playing=replace(problem.playing, draw=draw)), x) - base
