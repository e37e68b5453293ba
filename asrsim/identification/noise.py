"""Statistics of sampled series: noise level, encoder steps, autoregressive models, and bandwidths of motions."""

from __future__ import annotations

import math

import numpy as np

from asrsim.samples import Array

ORDER = 12
"""Largest order of the autoregressive models. Schwarz's criterion selects the order, which is mostly 0 to 4."""
STATIONARY = 0.9999
"""Largest partial correlation of an autoregressive model. Noise with this partial correlation has a correlation time of ten
thousand samples. The partial correlations of a stationary process are below 1.
"""
NOTHING = 0.5
"""Residuals count as negligible if they are below this multiple of the estimated noise. If the recording has noise, the
residuals of the right model are as large as the noise. Without noise, the estimated noise is the rounding error of the file,
and the residuals are smaller.
"""
ORDERS, SAMPLES_EACH = (3, 8), 20
"""ORDERS: lowest and highest order of the differences from which the noise is estimated. For example, a motion with an
amplitude of 0.4 rad and a frequency of 5 Hz, recorded at 50 Hz, looks like noise of 20 mrad in differences of order 3, but like
noise of 0.08 mrad in differences of order 8. SAMPLES_EACH: number of samples for each order. With fewer samples, the medians
are unreliable.
"""
CLIPPED = 4.0
"""Residuals are clipped to this multiple of their robust standard deviation. Noise exceeds it once in 16,000 samples."""
AROUND, WIDTH = 25, 3
"""AROUND: number of neighbouring frequencies on each side of a frequency. The median power of all of them is the local level of
the spectrum.
WIDTH: number of frequencies in a spectral line, since its power leaks to the neighbouring frequencies.
"""
SELDOM, SWING = 1e-4, 0.03
"""A spectral line is reported if pure noise has a line of this power with a probability below SELDOM, and if the line has more
than the fraction SWING of the total power. In a long recording, a line may stand out from the noise and still be negligible.
"""
STILL, FINE = 0.15, 0.5
"""A record is from an encoder if more than the fraction STILL of its samples equal the sample before, or if the standard
deviation of its noise is below the fraction FINE of the encoder step. More noise would hide the steps.
"""
LEVELS = 20_000
"""Largest number of different values of a record that counts as quantised. A 16-bit encoder shows 20,000 different values over
a third of a turn.
"""
MOVES = 8.0
"""A recorded channel counts as moving if its range exceeds this multiple of the standard deviation of its noise. The range of
4,000 samples of noise alone is 7 standard deviations.
"""
WITHIN = 0.99
"""Fraction of a motion's power below the frequency that is called its bandwidth. The rest corresponds to a tenth of the
amplitude. The bandwidths `LEVELS` of the search were chosen with this fraction.
"""
LOUD = 30.0
"""A frequency counts as part of the motion if the recorded power at this frequency exceeds this multiple of the noise power.
The power of white noise is exponentially distributed, and exceeds this multiple at a given frequency once in 10^13 times.
"""

PROVEN, RARE = 200, 0.01
"""PROVEN: smallest number of residuals that can pass the test for first-order noise. Residuals of wrong models were tested in
pieces: one of 154 pieces of 150 samples passed the test, and none of 78 pieces of 300 samples.
RARE: probability that the test rejects first-order noise.
"""


def fine_noise(values: Array, quantum: float = 0.0, time: Array | None = None) -> float:
    """Standard deviation of white noise on a smooth record (n,), from the medians of its differences of several orders.

    Each difference is divided by the size that white noise of standard deviation 1 would give it. A motion enlarges
    the differences, mostly the differences of low order, so the smallest estimate is the best. time: times (n,) of the
    samples, s; None: the samples are evenly spaced. The result is at least the rounding error of
    `quantum`, and at least a millionth of the range.
    """
    at = None
    if time is not None and len(time) > 1:
        steps = np.diff(time)
        usual = max(float(np.median(steps)), 1e-12)
        # Treat steps that differ by less than a millionth as equal: the error is less than a millionth of the motion within a
        # step.
        at = time / usual if float(np.ptp(steps)) > 1e-6 * usual else None
    orders = range(ORDERS[0], max(ORDERS[0], min(ORDERS[1], len(values) // SAMPLES_EACH)) + 1)
    found = [_difference_noise(at, values, order) for order in orders if len(values) > order]
    least = max(quantum / 12.0**0.5, 1e-6 * float(np.ptp(values)) if len(values) else 0.0)
    return float(max(min(found, default=0.0), least))


def _difference_noise(at: Array | None, values: Array, order: int) -> float:
    """Standard deviation of white noise from the median of divided differences, which are 0 for a polynomial of lower order.
    at: times (n,) of the samples; None: the samples are evenly spaced.
    """
    if at is None:
        # The sum of the squares of the binomial coefficients is the central binomial coefficient.
        return float(np.median(np.abs(np.diff(values, order))) / math.sqrt(math.comb(2 * order, order))) / 0.6745
    count, total, power = len(values) - order, 0.0, 0.0
    times = [at[i : i + count] for i in range(order + 1)]
    for i, own in enumerate(times):
        weight = 1.0 / np.prod([own - other for j, other in enumerate(times) if j != i], axis=0)
        total, power = total + weight * values[i : i + count], power + weight**2
    return float(np.median(np.abs(total) / np.sqrt(power))) / 0.6745


def quantum_of(values: Array) -> float:
    """Quantisation step of a record (n,). All changes of the record are multiples of this step. 0 if there is no such step, or
    if the step is negligible.
    """
    steps = np.abs(np.diff(np.unique(values)))
    if len(steps) < 2 or len(steps) > LEVELS:
        return 0.0
    least = float(np.median(steps[steps <= 1.5 * steps.min()]))
    multiples = steps / least
    whole = np.abs(multiples - np.round(multiples)) < 0.02 * np.maximum(1.0, np.round(multiples))
    # Every record is quantised, since files have a limited number of digits. The quantisation matters only if many neighbouring
    # samples are equal, or if the noise is small compared with the step.
    counts = float(np.mean(np.diff(values) == 0.0)) > STILL or fine_noise(values) < FINE * least
    return least if whole.mean() > 0.98 and counts else 0.0


def lag_correlation(residuals: Array) -> float:
    """Autocorrelation of residuals (n,) at lag 1. The mean is not subtracted, so that a constant offset counts as
    correlation.
    """
    size = float(residuals @ residuals)
    return float(residuals[1:] @ residuals[:-1]) / size if size > 0.0 and len(residuals) > 3 else 0.0


def independent_samples(residuals: Array) -> float:
    """Number of independent samples to which residuals (n,) are equivalent, from the lag-1 correlation of the residuals."""
    correlation = min(max(lag_correlation(residuals), 0.0), 1.0 - 1e-6)
    return len(residuals) * (1.0 - correlation) / (1.0 + correlation)


def is_first_order(residuals: Array) -> bool:
    """Whether residuals (n,) are white noise, or white noise behind a low-pass filter of first order, as in sensors and drives.
    The spectrum of the residuals must agree in each octave with the spectrum of an autoregression of order 1. Model errors have
    another spectrum: they are smooth, since masses integrate forces twice.
    """
    from scipy.special import gammainc, gammaincc

    if len(residuals) < PROVEN:
        return False
    power = np.abs(np.fft.rfft(residuals[1:] - lag_correlation(residuals) * residuals[:-1]))[1:] ** 2
    first = 2 ** np.arange(int(np.log2(len(power)))) - 1
    # The power of white noise at k frequencies, relative to its mean, follows the gamma distribution of order k.
    sums, counts = np.add.reduceat(power / power.mean(), first), np.diff(first, append=len(power))
    chances = 2.0 * np.minimum(gammainc(counts, sums), gammaincc(counts, sums))
    return bool(chances.min() * len(chances) > RARE)


def beyond_steps(left: Array, values: Array, quantum: float) -> tuple[Array, float]:
    """Residuals (n,) minus their mean, and the lag-1 correlation that quantisation of the predicted motion would cause. The
    subtracted mean is at most half an encoder step, since the encoder's zero within a step is unknown.
    """
    if not quantum or not len(left):
        return left, 0.0
    beyond = left - np.clip(float(np.mean(left)), -0.5 * quantum, 0.5 * quantum)
    predicted = (beyond + values - values[0]) / quantum
    steps = quantum * (predicted - np.round(predicted))
    size = float(beyond @ beyond)
    share = min(float(steps @ steps) / size, 1.0) if size > 0.0 else 0.0
    return beyond, max(share * lag_correlation(steps), 0.0)


def size_of(residuals: Array) -> float:
    """Robust root mean square of residuals (n,), in which outliers are clipped."""
    typical = float(np.median(np.abs(residuals))) / 0.6745
    return float(np.sqrt(np.mean(np.minimum(np.abs(residuals), CLIPPED * typical) ** 2)))


def is_nothing(size: float, noise: float) -> bool:
    """Whether residuals are far below the estimated noise. The recording then has no noise. size: robust root mean square of
    the residuals.
    """
    return size < NOTHING * noise


def frequency(time: Array, residuals: Array) -> float:
    """Frequency of a significant line in the spectrum of residuals (n,), Hz; 0 if there is no such line. time: times of the
    residuals, s; later times are ignored.

    The power of a line is compared with the median power at the frequencies around the line, so that coloured noise has no
    lines.
    """
    from scipy.ndimage import median_filter
    from scipy.special import gammaincc

    n = len(residuals)
    if n < 4 * AROUND or not np.ptp(residuals):
        return 0.0
    centred = residuals - residuals.mean()
    # An autoregression of order 1 whitens the noise. The first sample becomes 0, since no sample precedes it.
    white = np.append(0.0, centred[1:] - lag_correlation(centred) * centred[:-1])
    power = np.abs(np.fft.rfft(white))[1:] ** 2
    around = median_filter(power, 2 * AROUND + 1, mode="mirror")
    # The power of noise at a frequency is exponentially distributed, so its median is log 2 times its mean.
    height = power * np.log(2.0) / np.maximum(around, 1e-300)
    band = np.convolve(height, np.ones(WIDTH), "same")
    most = int(np.argmax(band))
    fraction = float(np.sum(power[max(most - 1, 0) : most + 2])) / float(np.sum(power)) - WIDTH / len(power)
    stands_out = float(gammaincc(WIDTH, band[most])) * len(power) < SELDOM and fraction > SWING
    return (most + 1) / n * (n - 1) / float(time[n - 1] - time[0]) if stands_out else 0.0


def autocovariances(residuals: Array) -> Array:
    """Autocovariances (p + 1,) of residuals (n,) at the lags 0 to p, without subtraction of the mean. p is the largest model
    order that n samples allow.
    """
    n = len(residuals)
    lags = range(min(ORDER, n // 20) + 1)
    return np.array([float(residuals[lag:] @ residuals[: n - lag]) for lag in lags]) / n


def autoregression(covariances: Array, samples: int) -> tuple[Array, float]:
    """Autoregressive model e_k = sum c_i e_(k-i) + white noise from autocovariances. Returns the coefficients c_i (p,) and the
    variance of the white noise.

    Levinson's recursion computes the coefficients. Schwarz's criterion selects the order p, which is 0 for white noise. The
    recursion ends at the first order for which no stationary noise has these autocovariances. This may happen if the
    autocovariances of a few samples were corrected.
    """
    coefficients, power = np.empty(0), max(float(covariances[0]), 1e-300)
    chosen, best = (coefficients, power), samples * np.log(power)
    for order in range(1, len(covariances)):
        unexplained = covariances[order] - coefficients @ covariances[order - 1 : 0 : -1]
        possible = abs(unexplained) < STATIONARY * power
        reflection = float(unexplained / power if possible else math.copysign(STATIONARY, unexplained))
        coefficients = np.append(coefficients - reflection * coefficients[::-1], reflection)
        power *= 1.0 - reflection**2
        criterion = samples * np.log(power) + np.log(samples) * order
        if criterion < best:
            best, chosen = criterion, (coefficients, power)
        if not possible:
            break
    return chosen


def bandwidth(step: float, positions: Array, noise: float) -> float:
    """Highest frequency at which a recorded position exceeds its white noise, Hz. step: sampling interval, s; noise: standard
    deviation.
    """
    speed = np.diff(positions)
    power, frequency = np.abs(np.fft.rfft(speed * np.hanning(len(speed)))) ** 2, np.fft.rfftfreq(len(speed), step)
    # Expected spectrum of the differences of white noise, after multiplication by the window.
    level = noise**2 * len(speed) * 0.375 * 4.0 * np.sin(np.pi * frequency * step) ** 2
    loud = np.flatnonzero(power > LOUD * level + 1e-300)
    return float(frequency[loud[-1]]) if len(loud) else 0.0


def motion_band(step: float, values: Array, noise: float) -> float:
    """Bandwidth of a motion: frequency below which 99 % of a record's power lies, rad/s. The mean and the white noise of the
    record are left out. step: sampling interval, s; values: record (n,); noise: standard deviation.
    """
    window = np.hanning(len(values))
    power = np.abs(np.fft.rfft(window * (values - values.mean()))) ** 2
    power = np.where(power > LOUD * noise**2 * np.sum(window**2), power, 0.0)
    total = np.cumsum(power)
    return float(2.0 * np.pi * np.fft.rfftfreq(len(values), step)[np.searchsorted(total, WITHIN * total[-1])])
