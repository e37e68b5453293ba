"""How sure estimates are: least squares under the noise that residuals show, held against the spread between blocks.

The covariance of least squares is H S H: H is the inverse of J'J, S the covariance of J'r. S follows from the noise of each
channel: from its spectrum, by an autoregression of what is left, and from the steps of its encoder. Samples that correlate
tell less than as many independent ones, and give fewer degrees of freedom.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from asrsim.identification.data import Channel
from asrsim.identification.inverse import InverseTrack
from asrsim.identification.noise import autoregression, whiten
from asrsim.identification.played import Draw
from asrsim.identification.problem import Part, Problem, Weights, errors, jacobian, residuals, solve
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
PLAYED, PLACES = 8, 4
"""Draws of noise of the played commands, and pairs of draws of noise of places whose bias is taken off."""


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

    @property
    def of_a_block(self) -> Uncertainty:
        """With deviations as those of an estimate from one block alone: how far the estimates of a model that does not fit
        differ from part to part.
        """
        count = max(len(self.scores), 1)
        spread = np.sqrt(np.sum((self.scores @ self.inverse) ** 2, axis=0) * count)
        return self.with_deviation(np.fmax(self.deviation, spread), self.quantile)


def whitened(problem: Problem, x: Array) -> tuple[tuple[Weights, ...], ...]:
    """Noise and autoregression of each channel, from what is left at x."""
    found = [*problem.weights]
    for track in problem.fitted:
        left = errors(problem, x, track) or []
        found[track] = tuple(_weights(*pair) for pair in zip(problem.tracks[track].channels, left, strict=True))
    return tuple(found)


def _weights(channel: Channel, left: Array) -> Weights:
    middle = left - np.median(left)
    scale = max(float(np.median(np.abs(middle))) / 0.6745, 1e-300)
    # What an outlier left over must not shape the model of the noise.
    model = autoregression(np.clip(middle, -6.0 * scale, 6.0 * scale))
    # Whitening pays where fast noise is louder than slow; of slow noise, least squares are as exact without. The steps of an
    # encoder go with the motion: no autoregression whitens them.
    if channel.quantum or float(np.sum(model)) > 0.0:
        model = np.empty(0)
    return Weights(channel.noise if channel.given and not len(model) else _innovation(left, model), model)


def _innovation(left: Array, model: Array) -> float:
    """Root mean square of the whitened residuals without outliers; an offset of all of them is no outlier, and counts."""
    white = whiten(left, model)[len(model) :]
    away = np.abs(white - np.median(white))
    scale = float(np.median(away)) / 0.6745
    kept = white[away <= 6.0 * scale] if scale > 0.0 else white
    return max(float(np.sqrt(np.mean(kept**2))) if len(kept) else 0.0, 1e-12)


def noise_of(problem: Problem, left: Array, slopes: Array) -> tuple[Array, float]:
    """(n, n) covariance of J'r as the channels' noise makes it, and how many independent samples tell that.

    left: (m,) residuals; slopes: (m, n).
    """
    n = slopes.shape[1]
    total, count = np.zeros((n, n)), 0.0
    for part in problem.parts:
        found, independent = _noise_of_part(part, left[part.rows], slopes[part.rows])
        total, count = total + found, count + independent
    # What the parameters took from the residuals is of the slow part that they follow.
    freedom = max(count - n, 1.0)
    return total * (count / freedom), freedom


def _noise_of_part(part: Part, left: Array, slopes: Array) -> tuple[Array, float]:
    """Of one channel."""
    if not len(left):
        return np.zeros((slopes.shape[1],) * 2), 0.0
    model, power = autoregression(left), float(np.mean(left**2))
    innovation = float(np.mean(whiten(left, model)[len(model) :] ** 2))
    slow = innovation / max(1.0 - float(np.sum(model)), 1e-6) ** 2
    independent = len(left) * min(power / slow, 1.0) if slow > 0.0 else float(len(left))
    if part.channel.quantum:
        scores = slopes.T @ _encoder_noise(part, left, power)
        return scores @ scores.T / DRAWS, independent
    # J' C J with the covariance C of the autoregression, by its spectrum.
    size = 2 * len(left)
    spectrum = innovation / np.abs(np.fft.rfft(np.append(1.0, -model), size)) ** 2
    spectrum[1:-1] *= 2.0
    waves = np.fft.rfft(slopes, size, axis=0)
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


def uncertainty(problem: Problem, x: Array, at_bound: Sequence[bool], *, foreseen: bool = False) -> Uncertainty:
    """At x; what an entry at a bound leaves open is so for the others, too. foreseen: as if nothing but the noise were left."""
    n = len(x)
    left = residuals(problem, x)
    slopes = jacobian(problem, x, CORNER, base=left, central=True)
    # Outliers count as the fit counts them.
    left = np.clip(left, -4.0, 4.0) if np.mean(np.abs(left) > 6.0) < 0.05 else left
    slopes = with_faint_directions(problem, x, slopes)
    _, singular, vectors = np.linalg.svd(np.linalg.qr(slopes, mode="r")) if n else (None, np.empty(0), np.empty((0, 0)))
    kept = singular > GONE * singular.max(initial=0.0)
    inverse = (vectors[kept].T / singular[kept] ** 2) @ vectors[kept]
    scores, firsts = np.zeros((0, n)), np.zeros(0, np.intp)
    if not foreseen:
        numbers = problem.blocks(BLOCKS)
        scores = np.zeros((int(numbers.max()) + 1, n))
        np.add.at(scores, numbers, slopes * left[:, None])
        empty = ~np.any(scores != 0.0, axis=1)
        of_recording = np.repeat(np.arange(len(scores) // BLOCKS + 1), BLOCKS)[: len(scores)][~empty]
        scores, firsts = scores[~empty], np.flatnonzero(np.diff(of_recording, prepend=-1))
        # At a bound the whole has a slope.
        bound = np.asarray(at_bound, dtype=bool)
        scores[:, bound] -= scores[:, bound].mean(axis=0)
    noise, freedom = (slopes.T @ slopes, float(len(left))) if foreseen else noise_of(problem, left, slopes)
    variance = float(np.sum(inverse * noise)) / max(int(np.sum(kept)), 1)
    found = Uncertainty(inverse, inverse, np.empty(0), slopes, np.empty(0), variance, noise, freedom, scores, firsts)
    deviation, quantile = found.deviations(inverse)
    # What lies in a direction that is gone is not known, whatever the pseudo-inverse says.
    lost = np.sum(vectors[~kept] ** 2, axis=0) > 1e-6
    return found.with_deviation(np.where(lost, np.nan, deviation), quantile)


def with_faint_directions(problem: Problem, x: Array, slopes: Array) -> Array:
    """Jacobian (m, n) by slopes along the directions of its own singular vectors, each over its deviation.

    Where joints stick, slopes have corners: one of the columns may be of the other side of it, and what is left of two that
    cancel of neither.
    """
    low, high = problem.layout.bounds
    for _ in range(ROUNDS):
        _, sizes, directions = np.linalg.svd(np.linalg.qr(slopes, mode="r"))
        moves = directions * np.minimum(1.0 / np.maximum(sizes, 1.0 / REACH), REACH)[:, None]
        inside = np.all((x - np.abs(moves) >= low) & (x + np.abs(moves) <= high), axis=1)
        agreed = True
        for i in np.flatnonzero(inside):
            slope = slopes @ directions[i]
            change = residuals(problem, x + moves[i]) - residuals(problem, x - moves[i])
            along = change / (2.0 * float(np.linalg.norm(moves[i])))
            agreed &= float(np.linalg.norm(along - slope)) < AGREES * float(np.linalg.norm(slope))
            slopes = slopes + np.outer(along - slope, directions[i])
        if agreed:
            break
    return slopes


def correlations(covariance: Array) -> Array:
    """(n, n) of a covariance; 0 where an entry has none."""
    deviation = np.sqrt(np.diag(covariance))
    with np.errstate(invalid="ignore", divide="ignore"):
        matrix = covariance / np.outer(deviation, deviation)
    return np.where(np.isfinite(matrix), matrix, 0.0)


def with_played(problem: Problem, x: Array, found: Uncertainty) -> Uncertainty:
    """The same with deviations that hold what noise as the played commands have it makes of the estimates: what it leaves is
    correlated as the robot swings, which a few blocks do not tell.
    """
    tracks = [problem.tracks[i] for i in problem.fitted]
    if any(isinstance(track, InverseTrack) for track in tracks):
        # There noise of places is all that is left.
        return found
    shifts = []
    for draw in range(PLAYED):
        change = np.zeros(len(found.jacobian))
        for number, track in enumerate(tracks):
            moved = track.shaken(problem.layout.table(x, number), problem.playing[number], draw)
            if moved is not None:
                lengths = [part.rows.stop - part.rows.start for part in problem.parts if part.track == number]
                cut = [one[:length] for one, length in zip(moved, lengths, strict=True)]
                change[problem.rows(number)] = problem.weighted(cut, number)
        if not np.any(change):
            return found
        shifts.append(found.inverse @ (found.jacobian.T @ change))
    alone = np.sqrt(np.diag(found.inverse @ found.noise @ found.inverse) + np.mean(np.square(shifts), axis=0))
    with np.errstate(invalid="ignore"):
        wider = np.maximum(1.0, 1.96 * alone / (found.deviation * found.quantile))
    return found.with_deviation(found.deviation * np.where(np.isfinite(wider), wider, 1.0), found.quantile)


def unbiased(problem: Problem, x: Array) -> Array:
    """x without what the noise of places makes of it on average (errors in variables): what as much of it once more does.

    Simulation and extrapolation, Cook and Stefanski 1994; draws in pairs of both signs, of which what is odd cancels.
    """
    driven = [i for i in problem.fitted if isinstance(problem.tracks[i], InverseTrack)]
    moved = np.zeros(len(x))
    for draw in range(PLACES if driven else 0):
        for sign in (1.0, -1.0):
            draws = [Draw(PLACES * i + draw, sign) if i in driven else None for i in range(len(problem.playing))]
            playing = tuple(replace(one, draw=noise) for one, noise in zip(problem.playing, draws, strict=True))
            moved += solve(replace(problem, playing=playing), x, rounds=10) - x
    return np.clip(x - 0.5 * moved / PLACES, *problem.layout.bounds)
