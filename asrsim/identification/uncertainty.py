"""Intervals of the estimates, from the noise in the residuals and from the spread between blocks of the recordings.

The covariance of least squares is H S H, where J is the Jacobian of the residuals r, H the inverse of J'J, and S the covariance
of J'r. S is computed from the noise of each channel. The spectrum of this noise is estimated by an autoregression of the
residuals. For an encoder, the noise is simulated with the encoder's steps.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from asrsim.identification.extensions import presliding
from asrsim.identification.noise import CLIPPED, autocovariances, autoregression
from asrsim.identification.problem import (
    FitProblem,
    Part,
    jacobian,
    residuals,
    residuals_at,
    slopes_along,
    weigh,
    with_finer_substeps,
    with_own_substeps,
)
from asrsim.identification.track import Playing
from asrsim.samples import Array

BLOCKS = 10
"""Number of blocks into which each recording is divided. The spread of an estimate is computed from the gradients of the
blocks. With ten blocks, the 95 % interval of Student's distribution is only 15 % wider than with many blocks, and each block is
still much longer than the correlation time of a motion.
"""
CHANCE = 0.95
"""The spread between blocks is used if it exceeds this quantile of its distribution under the estimated noise. If that noise is
right, the spread is used in 5 % of fits, as often as a 95 % interval misses the true value.
"""
GONE = 1e3
"""A direction of the parameter vector is unidentifiable if its standard deviation exceeds this value, in the vector's units.
Not even the power of ten of a number is then known.
"""
REACH = 1e-3
"""Largest step of a directional derivative, in the vector's units. It is 0.1 % of a number, and residuals are nearly linear
over it.
"""
DRAWS = 100
"""Number of random draws of an encoder's quantisation. The standard deviation that they give has a standard error of 7 %."""
SMOOTH = 0.02
"""The residuals are smooth along a direction if the directional derivative changes over one standard deviation of the estimate
by at most this fraction. It is small compared with 5 %, the largest relative half width of an identified parameter's interval.
"""
AGREES, ROUNDS = 0.3, 4
"""AGREES: a corrected directional derivative is accepted if the correction changes it at most by this fraction. Corrected
derivatives are measured over one standard deviation to both sides.
ROUNDS: largest number of rounds of correction. A round may reveal directions that need a further correction.
"""
BEYOND, SINGLE = 6.0, 0.05
"""BEYOND: a sample is an outlier if its residual exceeds this number of standard deviations of the noise.
SINGLE: if at least this fraction of the samples are outliers, they are errors of the model and are not clipped.
"""
PLAYED = 8
"""Number of random draws of the commands' noise. The standard deviation that they give has a standard error of 25 %."""
STIFFER = 10.0
"""Ratio of a real pre-sliding stiffness to the toolbox's default: real bristles are mostly far stiffer."""
CORRECTIONS = 3
"""Number of rounds that correct the autocovariances of residuals for the fitted parameters. Each round multiplies the remaining
error by about the ratio of parameters to samples.
"""
STATIONARY = 1e-3
"""Lower bound of the gain of the filter that whitens the noise: 1 minus the sum of the autoregression's coefficients at
frequency 0. With this gain, the correlation time of the noise is a thousand samples.
"""


@dataclass(frozen=True)
class Uncertainty:
    """Uncertainty of the parameter vector at the estimate."""

    inverse: Array
    """Pseudo-inverse (n, n) of J'J in the identifiable directions."""
    deviation: Array
    """Standard deviations (n,), from the noise or from the spread between blocks; the larger one is used. They are nan for
    unidentifiable entries.
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
    """Gradients (blocks, n) of half the blocks' sums of squares; empty if white noise is assumed."""
    firsts: NDArray[np.intp]
    """Index of the first row of each recording in `scores`, (recordings,)."""
    at_bound: NDArray[np.bool_]
    """Whether each entry of the vector ended at a bound, (n,)."""

    @property
    def covariance(self) -> Array:
        """Covariance (n, n) of the vector: `inverse`, scaled so that its diagonal agrees with the squares of `deviation`."""
        sizes = np.sqrt(np.diag(self.inverse))
        ratio = np.nan_to_num(self.deviation / np.where(sizes > 0.0, sizes, np.inf))
        return np.asarray(self.inverse * np.outer(ratio, ratio))

    def deviations(self, directions: Array) -> tuple[Array, Array]:
        """Standard deviations (k,) of estimated quantities, and half widths (k,) of their 95 % intervals in units of these
        deviations. The deviations are from the noise or from the spread between blocks.

        directions: derivatives (k, n) of the estimated quantities with respect to J'r.
        """
        from scipy.special import chdtri, stdtrit

        ordinary = np.sum((directions @ self.noise) * directions, axis=1)
        deviation, quantile = np.sqrt(ordinary), np.full(len(ordinary), stdtrit(self.freedom, 0.975))
        # Also use the spread between whole recordings, since it may exceed the spread between the blocks of one recording.
        recordings = np.add.reduceat(self.scores, self.firsts, axis=0) if len(self.firsts) > 1 else self.scores[:0]
        for scores in (self.scores, recordings):
            count = len(scores)
            if count < 3:
                continue
            spread = np.sum((scores @ directions.T) ** 2, axis=0) * count / (count - 1)
            wide, larger = np.sqrt(spread), stdtrit(count - 1, 0.975)
            beyond = spread > ordinary * chdtri(count - 1, 1.0 - CHANCE) / (count - 1)
            beyond &= wide * larger > deviation * quantile
            deviation, quantile = np.where(beyond, wide, deviation), np.where(beyond, larger, quantile)
        return deviation, quantile

    @property
    def of_a_block(self) -> Uncertainty:
        """Uncertainty of an estimate from a single block. It shows how the estimates of a wrong model differ between parts of
        the recordings.
        """
        return replace(self, deviation=np.maximum(self.deviation, self.spread * len(self.scores) ** 0.5))

    @property
    def spread(self) -> Array:
        """Standard deviations (n,) from the spread between blocks only; nan for unidentifiable entries."""
        return np.where(np.isnan(self.deviation), np.nan, np.sqrt(np.sum((self.scores @ self.inverse) ** 2, axis=0)))


@dataclass(frozen=True, eq=False)
class _Noise:
    """Covariance C of a channel's noise, from an autoregression of its residuals (n,)."""

    basis: Array
    """Rows (n, k) of the channel in an orthonormal basis of the Jacobian's columns."""
    shown: Array
    """Autocovariance (lags,) of the residuals."""
    lost: Array
    """Autocovariance (lags,) of the noise minus autocovariance of the residuals. The residuals are smaller than the noise since
    parameters were fitted.
    """

    @cached_property
    def _model(self) -> tuple[Array, float, float]:
        """Coefficients of the autoregression, variance of its white noise, and degrees of freedom of the noise's spectral level
        at low frequencies.
        """
        covariances, samples = self.shown + self.lost, len(self.basis)
        model, power = autoregression(covariances, samples)
        total, order = float(np.sum(model)), len(model)
        # The spectral level at frequency 0 is power / (1 - total)^2. The variance of `total` is computed from the least-squares
        # fit of the coefficients.
        lags = np.abs(np.subtract.outer(np.arange(order), np.arange(order)))
        ones = np.ones(order)
        variance = power * float(ones @ np.linalg.lstsq(covariances[lags], ones)[0]) / samples if order else 0.0
        relative = 2.0 / samples + 4.0 * variance / max(1.0 - total, STATIONARY) ** 2
        return model, power, 2.0 / relative

    @property
    def freedom(self) -> float:
        """Degrees of freedom of the estimated spectral level at low frequencies."""
        return self._model[2]

    @cached_property
    def _spread(self) -> tuple[Array, Array]:
        """C times the basis, (n, k), and autocovariance (lags,) of the noise."""
        from scipy.fft import irfft, next_fast_len, rfft

        (model, power, _), n, lags = self._model, len(self.basis), len(self.shown)
        if not len(model):
            # White noise needs no Fourier transform.
            return power * self.basis, power * (np.arange(lags) == 0)
        # The transforms have at least 2 n samples. A number of samples with large prime factors would make them slow.
        length = int(next_fast_len(2 * n, real=True))
        gain = np.maximum(np.abs(rfft(np.append(1.0, -model), length)), STATIONARY)
        spectrum = power / gain**2
        spread = irfft(spectrum * rfft(self.basis.T, length), length)[:, :n]
        return np.ascontiguousarray(spread.T), irfft(spectrum, length)[:lags]

    @cached_property
    def covariance(self) -> Array:
        """Covariance (k, k) of the products of the basis' columns with the noise."""
        return np.asarray(self.basis.T @ self._spread[0])

    def corrected(self, taken: Array) -> _Noise:
        """Noise with an autocovariance that is corrected for the fitted parameters. taken: sum of the channels' `covariance`
        (k, k).
        """
        n, basis, (spread, own) = len(self.basis), self.basis, self._spread
        crossed = 2.0 * spread - basis @ taken
        lost = [
            lag * own[lag] + 0.5 * float(np.vdot(basis[: n - lag], crossed[lag:]) + np.vdot(crossed[: n - lag], basis[lag:]))
            for lag in range(len(self.shown))
        ]
        return replace(self, lost=np.array(lost) / n)


def noise_of(problem: FitProblem, left: Array, slopes: Array) -> tuple[Array, float]:
    """Covariance (n, n) of J'r due to the channels' noise, and the degrees of freedom of this covariance.

    The fit of the parameters makes the residuals smaller than the noise, especially if the noise is as slow as the motion. The
    autocovariances of the residuals are corrected for the expected reduction (Worsley et al. 2002, NeuroImage 15, 1-15). left:
    residuals (m,); slopes: Jacobian (m, n).
    """
    parts, (basis, root) = [part for part in problem.parts if len(part.time) > 1], np.linalg.qr(slopes)
    shown = [autocovariances(left[part.rows]) for part in parts]
    noises = [_Noise(basis[part.rows], own, np.zeros(len(own))) for part, own in zip(parts, shown, strict=True)]
    for _ in range(CORRECTIONS):
        taken = sum((noise.covariance for noise in noises), np.zeros((1, 1)))
        noises = [noise.corrected(taken) for noise in noises]
    total = np.zeros((slopes.shape[1],) * 2)
    for part, noise in zip(parts, noises, strict=True):
        if part.channel.quantum:
            scores = slopes[part.rows].T @ _encoder_noise(part, left[part.rows])
            total += scores @ scores.T / DRAWS
        else:
            total += root.T @ noise.covariance @ root
    return total, max(sum(noise.freedom for noise in noises) - slopes.shape[1], 1.0)


def _encoder_noise(part: Part, left: Array) -> Array:
    """Random residuals (n, draws) of an encoder that measures the predicted motion with noise. The zero of the encoder is
    random within a step.
    """
    generator = np.random.default_rng(0)
    step, size = part.channel.quantum, (len(left), DRAWS)
    power = float(np.mean(left**2)) * part.noise**2
    noise = generator.normal(scale=max(power - step**2 / 12.0, 0.0) ** 0.5, size=size)
    predicted = (part.recorded + left * part.noise)[:, None]
    zeros = step * generator.uniform(-0.5, 0.5, size=DRAWS)
    shown = step * np.round((predicted + noise + zeros) / step) - predicted
    return weigh(shown, part.noise, step)


def uncertainty(problem: FitProblem, x: Array, *, foreseen: bool = False, quick: bool = False) -> Uncertainty:
    """Uncertainty of the parameter vector x. Entries at a bound are treated as free.

    foreseen: whether x is a start vector and no search was made, so that the residuals are assumed to be white noise; quick:
    whether derivatives are computed with only one simulation for each entry.
    """
    n, left = len(x), residuals(problem, x)
    # Without a search, an entry at a bound, such as a delay of 0, only starts there.
    at_bound = problem.layout.at_bound(x) & (not foreseen)
    slopes = jacobian(problem, x, base=left)
    if not quick:
        slopes = with_faint_directions(problem, x, slopes)
    # Clip outliers, as in the fit.
    left = np.clip(left, -CLIPPED, CLIPPED) if np.mean(np.abs(left) > BEYOND) < SINGLE else left
    _, singular, vectors = np.linalg.svd(np.linalg.qr(slopes, mode="r"))
    kept = singular > max(1.0 / GONE, 1e-12 * singular.max(initial=0.0))
    inverse = (vectors[kept].T / singular[kept] ** 2) @ vectors[kept]
    scores, firsts = np.zeros((0, n)), np.zeros(0, np.intp)
    if not foreseen:
        numbers = problem.blocks(BLOCKS)
        scores = np.zeros((int(numbers.max()) + 1, n))
        np.add.at(scores, numbers, slopes * left[:, None])
        blocks = np.flatnonzero(np.any(scores != 0.0, axis=1))
        scores, firsts = scores[blocks], np.flatnonzero(np.diff(blocks // BLOCKS, prepend=-1))
        # At a bound the sum of the gradients differs from 0, so their mean is subtracted.
        scores[:, at_bound] -= scores[:, at_bound].sum(axis=0) / max(len(scores), 1)
    noise, freedom = (slopes.T @ slopes, float(len(left))) if foreseen else noise_of(problem, left, slopes)
    found = Uncertainty(inverse, np.empty(0), slopes, np.empty(0), noise, freedom, scores, firsts, at_bound)
    deviation, quantile = found.deviations(inverse)
    # Entries with a component in a discarded direction are unidentifiable, although the pseudo-inverse gives a value.
    lost = np.sum(vectors[~kept] ** 2, axis=0) > 1e-6
    return replace(found, deviation=np.where(lost, np.nan, deviation), quantile=quantile)


def with_faint_directions(problem: FitProblem, x: Array, slopes: Array) -> Array:
    """Jacobian (m, n), corrected by differences along its singular vectors. Each difference covers one standard deviation.

    Joints that stick make residuals non-smooth, so that small differences between columns are unreliable. If the derivative
    along a direction changes over one standard deviation, it is corrected by central differences. The correction is repeated
    for directions whose derivatives it changes much. If the Jacobian predicts the effect of a move along all directions
    together, directions are not checked separately. Entries near a bound have one-sided derivatives.
    """
    low, high = problem.layout.bounds
    inside = (x - REACH >= low) & (x + REACH <= high)
    basis, slopes, base = np.eye(len(x))[inside], slopes.copy(), residuals(problem, x)
    if not inside.all():
        alone = 1.0 / np.maximum(np.linalg.norm(slopes, axis=0), 1.0 / REACH)
        slopes[:, ~inside] = slopes_along(problem, x, np.flatnonzero(~inside).tolist(), alone)
    for first in (True, *(False,) * (ROUNDS - 1)):
        if not len(basis):
            break
        _, sizes, vectors = np.linalg.svd(np.linalg.qr(slopes @ basis.T, mode="r"))
        basis = vectors @ basis
        sizes = np.append(sizes, np.zeros(len(basis) - len(sizes)))
        reach = np.minimum(1.0 / np.maximum(sizes, 1.0 / REACH), REACH)[:, None]
        known = slopes @ basis.T
        if first and _predicts(problem, x, slopes, basis, sizes):
            break
        ahead = residuals_at(problem, [*(x + reach * basis)])
        bent = np.linalg.norm((ahead - base) / reach - known.T, axis=1) > SMOOTH * np.linalg.norm(known, axis=0)
        if not bent.any():
            break
        basis, reach, known, ahead = basis[bent], reach[bent], known[:, bent], ahead[bent]
        along = ((ahead - residuals_at(problem, [*(x - reach * basis)])) / (2.0 * reach)).T
        slopes = slopes + (along - known) @ basis
        basis = basis[np.linalg.norm(along - known, axis=0) > AGREES * np.linalg.norm(known, axis=0)]
    return slopes


def _predicts(problem: FitProblem, x: Array, slopes: Array, basis: Array, sizes: Array) -> bool:
    """Whether a Jacobian (m, n) predicts the effect of a move along all directions together. Each direction has an equal share
    of the effect, so that a wrong derivative along any direction shows. basis: directions (k, n); sizes: sizes (k,) of the
    Jacobian along the directions.
    """
    if not sizes.min() > 0.0:
        return False
    part = min(1.0, REACH / float(np.linalg.norm(1.0 / sizes)))
    move = (part / sizes) @ basis
    ahead, behind = residuals_at(problem, [x + move, x - move])
    return bool(np.linalg.norm(0.5 * (ahead - behind) - slopes @ move) < SMOOTH * part)


def widened(problem: FitProblem, x: Array, found: Uncertainty) -> Uncertainty:
    """Uncertainty that includes the effects of the time step, of the commands' noise and of unknown pre-sliding stiffnesses.
    The noise excites oscillations of the robot, so that the spread between a few blocks does not show its effect.
    """
    base, playing, variance = residuals(problem, x), problem.playing, found.deviation**2

    def moved(changed: Array) -> Array:
        """Change (n,) of the estimate to first order, from the residuals (m,) of another simulation."""
        return np.asarray(found.inverse @ (found.jacobian.T @ (changed - base)))

    def shift(other: Playing) -> Array:
        """Change (n,) of the estimate to first order if the recordings are simulated with other settings."""
        return moved(residuals(replace(problem, playing=other), x))

    tracks = [problem.tracks[i] for i in problem.fitted]
    if all(any(one.noise for one in track.data.commands) for track in tracks):
        variance += np.mean(np.square([shift(replace(playing, draw=draw)) for draw in range(PLAYED)]), axis=0)
    if tracks[0].door.exact_in_time:
        finer = with_finer_substeps(problem).playing
        # Double the shift. Half the substep removes only half of the time-step error, since joints that stick cause an error of
        # first order.
        variance += (2.0 * shift(finer)) ** 2
    for unknown in presliding(problem, x):
        there = np.append(x, np.log(STIFFER))
        variance += moved(residuals(with_own_substeps(unknown.added_to(problem), there), there)) ** 2
    return replace(found, deviation=np.sqrt(variance))
