"""Frequency response of an excitation with a line spectrum (multisine): sines fitted by least squares, without leakage."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from asrsim.metrics.spectra import Spectra
from asrsim.samples import Array

_BLOCKS = 16
"""Number of parts into which the record is divided; the first parts may be omitted as a transient."""
_AS_GOOD = 1.3
"""Factor by which the error of the fit must fall without the first parts of the record, so that these parts count as a
transient."""
_ROUNDING = 1e-11
"""Relative residual below which the residual consists of rounding errors."""
_APART = 2.0
"""Smallest distance of two lines in bins of the part of the record that is used."""
_AROUND = 8
"""Number of bins on each side of a line, from whose residuals the noise at the line follows."""
_STEPS = 6
"""Number of Gauss-Newton steps for the frequencies of the lines."""
_LARGEST = 20_000_000
"""Largest number of elements in the matrix of a fit; of a longer record only the end is used."""


def by_lines(u: Array, y: Array, step: float, bins: NDArray[np.intp]) -> Spectra:
    """Response at the lines of an input (n,), whose spectrum has peaks at `bins`. The lines need no common period.

    The frequencies of the lines follow from the input. Sines of these frequencies, a mean and a drift are fitted to input
    and output. The first parts of the record, in which the output has not settled, are omitted; their number minimises the
    error of the fit. The noise at a line follows from the residuals in the bins around it.
    """
    most = _LARGEST // (3 * len(bins) + 2)
    peaks = np.asarray(bins * (min(most, len(u)) / len(u)), dtype=np.float64)
    u, y = u[-most:], y[-most:]
    n = len(u)
    time = (np.arange(n) - 0.5 * n) / n
    cycles = _refined(u, time, peaks)
    columns, both = _columns(time, cycles), np.column_stack([u, y])
    shortest = max(_APART / float(np.diff(cycles, prepend=0.0).min()), 4 * _AROUND / n)
    starts = [round(n * share) for share in np.arange(_BLOCKS) / _BLOCKS if not share or 1 - share >= shortest]
    fits = [_fit(columns[start:], both[start:]) for start in starts]
    rounding = (_ROUNDING * float(np.linalg.norm(y))) ** 2
    errors = np.array([max(float(np.sum(rest[:, 1] ** 2)), rounding) / len(rest) ** 2 for _, rest in fits])
    fit, rest = fits[int(np.flatnonzero(errors <= _AS_GOOD * errors.min())[0])]
    count = len(rest)
    line_u, line_y = (fit[: len(cycles)] - 1j * fit[len(cycles) : -2]).T
    response = line_y / line_u
    spectra = np.fft.rfft(rest, axis=0)
    middle = np.clip(np.round(cycles * count / n).astype(int), _AROUND, len(spectra) - 1 - _AROUND)
    noise_u, noise_y = np.moveaxis(spectra[middle[:, None] + np.arange(-_AROUND, _AROUND + 1)], 2, 0)
    noise = np.sum(np.abs(noise_y - response[:, None] * noise_u) ** 2, axis=1)
    # Degrees of freedom of the residual noise: number of bins minus number of fitted lines, since each fitted line removes the
    # noise power of one bin.
    freedom = 2 * _AROUND + 1 - np.sum(np.abs(middle[:, None] - middle) <= _AROUND, axis=1)
    variance = noise / freedom * (2.0 / count) ** 2 / np.abs(line_u) ** 2
    relative = variance / np.maximum(np.abs(response) ** 2, 1e-300)
    return Spectra(
        frequency=cycles / (n * step),
        response=response,
        coherence=1 / (1 + freedom * relative),
        deviation=np.sqrt(relative),
        freedom=float(freedom.min()),
    )


def _columns(time: Array, cycles: Array) -> Array:
    """Columns of a fit: cosines and sines of the lines, drift, and mean."""
    angle = 2 * np.pi * time[:, None] * cycles
    return np.concatenate([np.cos(angle), np.sin(angle), time[:, None], np.ones((len(time), 1))], axis=1)


def _fit(columns: Array, values: Array) -> tuple[Array, Array]:
    """Coefficients of the columns by least squares, and the residual."""
    fit = np.asarray(np.linalg.lstsq(columns.T @ columns, columns.T @ values, rcond=None)[0], dtype=np.float64)
    return fit, values - columns @ fit


def _refined(u: Array, time: Array, cycles: Array) -> Array:
    """Frequencies of the lines in cycles per record, by Gauss-Newton from the peaks of the spectrum."""
    count = len(cycles)
    for _ in range(_STEPS):
        columns = _columns(time, cycles)
        fit, _ = _fit(columns, u)
        cosines, sines = columns[:, :count], columns[:, count : 2 * count]
        slopes = 2 * np.pi * time[:, None] * (fit[count : 2 * count] * cosines - fit[:count] * sines)
        change = _fit(np.concatenate([columns, slopes], axis=1), u)[0][-count:]
        cycles = cycles + np.clip(change, -0.5, 0.5)
        if np.max(np.abs(change)) < 1e-9:
            break
    return cycles
