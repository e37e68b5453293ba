"""Series of samples: their noise from fine structure, an encoder's quantum, models that whiten; how they begin."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from asrsim.samples import Array

if TYPE_CHECKING:
    from asrsim.identification.data import Channel

ORDER = 12
"""Largest order of the autoregressive models."""
NOTHING = 0.5
"""Fraction of the estimated noise below which residuals count as zero: white noise leaves all of it, correlated noise more."""
CLIPPED = 4.0
"""Robust standard deviations beyond which a residual counts as this large."""
AROUND, WIDTH = 25, 3
"""Frequencies on each side that give the local level of a spectrum; frequencies of a spectral line."""
SELDOM, SWING = 1e-4, 0.03
"""Probability that noise alone has such a line; least fraction of the residuals' power that a reported line has."""
STILL, FINE = 0.15, 0.5
"""Share of samples that stand still on an encoder's steps; noise in these steps that they make, and little else."""
LEVELS = 20_000
"""Different numbers in a record, at most, of an encoder whose steps count."""
BENT = 0.4
"""Share of the change of a start's slope over its samples by which the slope may be off."""
FIRST, LONG = 15, 10
"""Samples, at most, from which the start of a link is read, and of these, at least, whose mean says more than the first."""


def fine_noise(values: Array, quantum: float = 0.0) -> float:
    """Standard deviation of white noise on a smooth record (n,), from its third differences, by their median.

    At least what rounding to `quantum` makes, and a millionth of the range: a noiseless record has rounding of its own.
    """
    third = np.diff(values, 3)
    sigma = float(np.median(np.abs(third))) / 0.6745 / np.sqrt(20.0) if len(third) else 0.0
    least = max(quantum / np.sqrt(12.0), 1e-6 * float(np.ptp(values)) if len(values) else 0.0)
    return float(max(sigma, least))


def quantum_of(values: Array) -> float:
    """The step of which all changes of a record (n,) are multiples; 0 where there is none, or steps are too fine to count."""
    steps = np.abs(np.diff(np.unique(values)))
    if len(steps) < 2 or len(steps) > LEVELS:
        return 0.0
    least = float(np.median(steps[steps <= 1.5 * steps.min()]))
    multiples = steps / least
    whole = np.abs(multiples - np.round(multiples)) < 0.02 * np.maximum(1.0, np.round(multiples))
    # Every record is quantised by its file's digits; it counts where the record stands still on its steps, or in motion has
    # no more noise than these make.
    counts = float(np.mean(np.diff(values) == 0.0)) > STILL or fine_noise(values) < FINE * least
    return least if whole.mean() > 0.98 and counts else 0.0


def lag_correlation(residuals: Array, lag: int = 1) -> float:
    """Autocorrelation of residuals (n,) about 0 at a lag: what is off by a constant is no noise either."""
    size = float(np.dot(residuals, residuals))
    return float(np.dot(residuals[lag:], residuals[:-lag]) / size) if size > 0.0 and len(residuals) > lag + 2 else 0.0


def independent_samples(residuals: Array) -> float:
    """As how many independent samples residuals (n,) tell, by the correlation of neighbours."""
    correlation = min(max(lag_correlation(residuals), 0.0), 1.0 - 1e-6)
    return len(residuals) * (1.0 - correlation) / (1.0 + correlation)


def beyond_steps(left: Array, values: Array, quantum: float) -> tuple[Array, float]:
    """Residuals (n,) of recorded values less what an encoder's zero, anywhere within a step, makes of them, and the correlation
    of neighbours that its steps make of the predicted motion.
    """
    if not quantum or not len(left):
        return left, 0.0
    beyond = left - np.clip(float(np.mean(left)), -0.5 * quantum, 0.5 * quantum)
    predicted = (beyond + values - values[0]) / quantum
    steps = quantum * (predicted - np.round(predicted))
    size = float(np.dot(beyond, beyond))
    share = min(float(np.dot(steps, steps)) / size, 1.0) if size > 0.0 else 0.0
    return beyond, max(share * lag_correlation(steps), 0.0)


def size_of(residuals: Array) -> float:
    """Root mean square of residuals (n,), of which single outliers count little and a stretch that is off counts much."""
    typical = float(np.median(np.abs(residuals))) / 0.6745
    return float(np.sqrt(np.mean(np.minimum(np.abs(residuals), CLIPPED * typical) ** 2)))


def is_nothing(size: float, noise: float) -> bool:
    """Whether residuals of a root mean square are so few that what was taken for noise is explained, too: there is none."""
    return size < NOTHING * noise


def swing(residuals: Array) -> float:
    """Frequency, in cycles per sample, of a line that stands out of the spectrum of residuals (n,); 0: there is none.

    The line is compared with the median of the frequencies around it, so that coloured noise has no lines.
    """
    from scipy.special import gammaincc

    n = len(residuals)
    if n < 4 * AROUND or not np.any(residuals):
        return 0.0
    centred = residuals - residuals.mean()
    power = np.abs(np.fft.rfft(whiten(centred, np.array([lag_correlation(centred)]))))[1:] ** 2
    around = np.lib.stride_tricks.sliding_window_view(np.pad(power, AROUND, mode="reflect"), 2 * AROUND + 1)
    # Powers of noise are exponentially distributed: the median is log 2 times the mean.
    height = power * np.log(2.0) / np.maximum(np.median(around, axis=-1), 1e-300)
    band = np.convolve(height, np.ones(WIDTH), "same")
    most = int(np.argmax(band))
    fraction = float(np.sum(power[max(most - 1, 0) : most + 2])) / float(np.sum(power)) - WIDTH / len(power)
    stands_out = float(gammaincc(WIDTH, band[most])) * len(power) < SELDOM and fraction > SWING
    return (most + 1) / n if stands_out else 0.0


def autocovariances(residuals: Array) -> Array:
    """(p + 1,) of residuals (n,) about 0, from lag 0 on; p is the largest order of a model that so many samples allow."""
    n = len(residuals)
    lags = range(min(ORDER, n // 20) + 1)
    return np.array([float(residuals[lag:] @ residuals[: n - lag]) for lag in lags]) / n


def autoregression(covariances: Array, samples: int) -> tuple[Array, float]:
    """Coefficients (p,) of e_k = sum c_i e_(k-i) + white noise, and the variance of that noise, from autocovariances.

    By Levinson's recursion; the order by Schwarz's criterion for so many samples, 0 for white noise.
    """
    coefficients, power = np.empty(0), max(float(covariances[0]), 1e-300)
    chosen, best = (coefficients, power), samples * np.log(power)
    for order in range(1, len(covariances)):
        reflection = float(covariances[order] - coefficients @ covariances[order - 1 : 0 : -1]) / power
        reflection = min(max(reflection, -0.9999), 0.9999)
        coefficients = np.append(coefficients - reflection * coefficients[::-1], reflection)
        power *= 1.0 - reflection**2
        criterion = samples * np.log(power) + np.log(samples) * order
        if criterion < best:
            best, chosen = criterion, (coefficients, power)
    return chosen


def whiten(values: Array, coefficients: Array) -> Array:
    """Values (n,) or (n, m) through the model's inverse; the first p rows, of which the past is not known, are 0."""
    p = len(coefficients)
    if not p:
        return values
    result = values.copy()
    for i, c in enumerate(coefficients, start=1):
        result[p:] -= c * values[p - i : len(values) - i]
    result[:p] = 0.0
    return result


def first_samples(channel: Channel, soon: float) -> tuple[float, float, float, float] | None:
    """Value and slope at 0 of a channel's first samples, by a parabola, with their standard errors; None where it begins later
    than `soon` s.
    """
    if len(channel.time) < 6 or channel.time[0] > soon:
        return None
    count = max(6, min(FIRST, int(np.sum(channel.time <= channel.time[0] + 0.03))))
    time, values = channel.time[:count], channel.values[:count]
    inverse = np.linalg.pinv(np.column_stack([np.ones(count), time, time**2]))
    errors = max(channel.noise, channel.quantum) * np.sqrt(np.sum(inverse**2, axis=1))
    place, slope, bend = (inverse @ values).tolist()
    # What is pushed at once is bent, and more with time: it begins elsewhere than a parabola.
    off, extent = BENT * abs(bend), float(time[-1])
    return place, slope, float(errors[0]) + 0.1 * off * extent**2, float(errors[1]) + off * extent


def at_rest(channel: Channel) -> tuple[float, float]:
    """Value at 0 of a channel that may move at once, and its error: of the first sample, or of many before it moves."""
    moved = np.abs(channel.values - np.median(channel.values[:5])) > 4.0 * max(channel.noise, channel.quantum)
    still = int(np.argmax(moved)) // 2 if moved.any() else len(moved)
    count = still if still >= LONG else 1
    return float(np.mean(channel.values[:count])), float(np.hypot(channel.noise / np.sqrt(count), channel.quantum))


def smoothed(values: Array, cutoff: float) -> Array:
    """Series (n,) without what is faster than the cutoff, a share of half its rate: Butterworth's fourth order, to and fro."""
    n, line = len(values), np.linspace(values[0], values[-1], len(values))
    # Odd about both ends, so that it begins and ends where the series does; scipy.signal takes half a second to import.
    odd = np.concatenate([values - line, (line - values)[::-1]])
    ratio = np.tan(np.pi * np.fft.rfftfreq(2 * n)) / np.tan(0.5 * np.pi * cutoff)
    return np.asarray(np.fft.irfft(np.fft.rfft(odd) / (1.0 + ratio**8), 2 * n)[:n] + line)
