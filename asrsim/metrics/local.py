"""Frequency response by local rational fits, for excitations that are dense in frequency."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from asrsim.errors import RecordingError
from asrsim.metrics.spectra import Spectra
from asrsim.samples import Array

Complex = NDArray[np.complex128]
_HALF = (8, 16)
"""Smallest and largest number of bins on each side of a frequency in the fit: 17 to 33 complex equations for 9 unknowns."""
_AS_GOOD = 1.2
"""Largest ratio of the residuals without and with a denominator at which the fit without denominator is chosen: about the 99 %
point of the F test with 33 equations.
"""
_MOST = 1000
"""Largest number of frequencies; longer records are thinned evenly."""
_STARTS, _REFINEMENTS = 3, 3
"""_STARTS: number of linear fits for the denominator; _REFINEMENTS: number of Gauss-Newton steps after these fits."""


@dataclass(frozen=True, kw_only=True)
class _Order:
    """Numbers of coefficients of a local rational model of the output."""

    gain: int
    leak: int
    """Number of coefficients for the leakage from the record's start and end."""
    poles: int

    @property
    def unknowns(self) -> int:
        return self.gain + self.leak + self.poles


_WIDE, _NARROW = _Order(gain=3, leak=3, poles=3), _Order(gain=3, leak=2, poles=2)


def local_rational(u: Array, y: Array, step: float, low: float, high: float) -> Spectra:
    """Response by local rational fits at the transform's frequencies in the band, from the whole record without a window.

    At bin k + r, with r scaled to -1 ... 1:  Y = ((g0 + g1 r + g2 r^2) U + t0 + t1 r + t2 r^2) / (1 + d1 r + d2 r^2 + d3 r^3);
    g0 is the response. The rational function represents a lightly damped resonance exactly; the coefficients t represent the
    leakage from the record's start and end. If the fit without denominator is equally good, it is chosen.

    The residual gives the random error. The model error is estimated from a fit of lower order to half of the bins: the
    squared difference of the fits, minus the part explained by noise, is added to the variance.
    """
    n = len(u)
    transform_u = np.fft.rfft(u - np.mean(u)) / n
    transform_y = np.fft.rfft(y - np.mean(y)) / n
    f = np.fft.rfftfreq(n, step)
    last = len(f) - 1
    bins = np.flatnonzero((f >= low) & (f <= high))
    half = int(np.clip(len(bins) // 6, *_HALF))
    if last < 2 * half + 2 or not len(bins):
        raise RecordingError("the record is too short for its frequency band", code="too-short")
    if len(bins) > _MOST:
        bins = bins[np.unique(np.linspace(0, len(bins) - 1, _MOST).round().astype(int))]
    # Near the ends, the windows are shifted inwards, since bin 0 contains the removed mean. Therefore r is not centred there.
    index = np.clip(bins, half + 1, last - half)[:, None] + np.arange(-half, half + 1)
    r = (index - bins[:, None]) / half
    local_u, size_u = _scaled(transform_u[index])
    local_y, size_y = _scaled(transform_y[index])
    best = _simplest(local_u, local_y, r, _WIDE)
    inner = slice(half - max(half // 2, 6), half + max(half // 2, 6) + 1)
    other = _simplest(local_u[:, inner], local_y[:, inner], r[:, inner], _NARROW)
    response, by_chance = best.response, np.abs(other.variance - best.variance)
    variance = best.variance + np.maximum(np.abs(other.response - response) ** 2 - by_chance, 0.0)
    relative = variance / np.maximum(np.abs(response) ** 2, 1e-300)
    freedom = float(2 * half + 1 - _WIDE.unknowns)
    return Spectra(
        frequency=np.asarray(f[bins], dtype=np.float64),
        response=np.asarray(response * (size_y / size_u)[:, 0], dtype=np.complex128),
        coherence=1 / (1 + freedom * relative),
        deviation=np.sqrt(relative),
        freedom=freedom,
    )


@dataclass(frozen=True, kw_only=True)
class _Fit:
    """Local fits at k frequencies."""

    response: Complex
    """Response (k,)."""
    variance: Array
    """Variance of the response (k,) from random errors only."""
    noise: Array
    """Residual power of the output per degree of freedom (k,)."""


def _simplest(u: Complex, y: Complex, r: Array, order: _Order) -> _Fit:
    """Fit of the given order, or the fit without poles if it is equally good, since poles would then fit noise only."""
    rational, smooth = _fit(u, y, r, order), _fit(u, y, r, replace(order, poles=0))
    return _chosen(smooth.noise <= _AS_GOOD * rational.noise, smooth, rational)


def _fit(u: Complex, y: Complex, r: Array, order: _Order) -> _Fit:
    """Fits of one order to windows (k, w) of transforms; r (k, w) is the position in the window.

    Without poles the fit is linear. With poles, linear fits weighted by the previous denominator (Sanathanan and Koerner) are
    repeated, then refined by Gauss-Newton on the output error, since noise among the regressors biases the linear fit. The
    iteration with the smallest residual is used.
    """
    powers = r[..., None] ** np.arange(max(order.gain, order.leak, order.poles + 1))
    linear = np.concatenate([powers[..., : order.gain] * u[..., None], powers[..., : order.leak] + 0j], axis=-1)
    poles = powers[..., 1 : order.poles + 1]
    count, freedom = linear.shape[-1], y.shape[1] - order.unknowns
    modelled: Complex = y
    weight: Complex = np.ones(y.shape, dtype=np.complex128)
    best: _Fit | None = None
    solution = np.zeros((len(y), order.unknowns), dtype=np.complex128)
    for step in range(_STARTS + _REFINEMENTS if order.poles else 1):
        refining = step >= _STARTS
        columns = np.concatenate([linear, -poles * (modelled if refining else y)[..., None]], axis=-1)
        # Use the pseudo-inverse by singular values, which leaves out directions that unexcited frequencies do not determine.
        inverse = np.linalg.pinv(columns * weight[..., None], rcond=1e-10)
        if refining:
            solution = solution + np.einsum("kpw,kw->kp", inverse, y - modelled)
        else:
            solution = np.einsum("kpw,kw->kp", inverse, y * weight)
        denominator: Complex = 1 + np.einsum("kwp,kp->kw", poles, solution[:, count:])
        denominator = np.where(np.abs(denominator) < 1e-3, 1e-3, denominator)
        weight = np.asarray(1 / denominator, dtype=np.complex128)
        modelled = np.einsum("kwp,kp->kw", linear, solution[:, :count]) * weight
        noise = np.sum(np.abs(y - modelled) ** 2, axis=1) / freedom
        variance = np.sum(np.abs(inverse[:, 0]) ** 2, axis=1) * noise
        found = _Fit(response=solution[:, 0], variance=variance, noise=noise)
        best = found if best is None else _chosen(found.noise < best.noise, found, best)
    return best or found


def _chosen(first: NDArray[np.bool_], one: _Fit, other: _Fit) -> _Fit:
    """Fit with the values of `one` at the frequencies where `first` is true, and the values of `other` elsewhere."""
    return _Fit(
        response=np.where(first, one.response, other.response),
        variance=np.where(first, one.variance, other.variance),
        noise=np.where(first, one.noise, other.noise),
    )


def _scaled(values: Complex) -> tuple[Complex, Array]:
    """Rows scaled to a root mean square of 1, and their original sizes (k, 1)."""
    size = np.sqrt(np.mean(np.abs(values) ** 2, axis=1, keepdims=True))
    size[size == 0] = 1.0
    return values / size, size
