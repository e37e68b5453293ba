"""Numbers computed from a motion: frequencies, zero crossings, extremes, orders of convergence."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from asrsim.samples import Array


def frequency(values: Array, step: float) -> float:
    """Angular frequency of a free undamped oscillation about any mean, sampled every `step` s, rad/s.

    Exact for a sinusoid: x[k + 1] + x[k - 1] = 2 cos(omega h) x[k], solved in the least-squares sense.
    """
    return modal_frequencies(np.diff(values)[:, None], step, 1)[0]


def modal_frequencies(values: Array, step: float, modes: int) -> list[float]:
    """Ascending angular frequencies of `modes` superposed sinusoids in `values` (n, joints), rad/s.

    The samples satisfy the symmetric recurrence sum of c_m (x[k + m] + x[k - m]) = 0 over m = 0..modes with c_modes = 1. With
    y = 2 cos(omega h), the frequencies are the roots of a polynomial in y.
    """
    n = len(values)
    centre = slice(modes, n - modes)

    def pair(m: int) -> Array:
        both = values[modes + m : n - modes + m] + values[modes - m : n - modes - m]
        return both.ravel() if m else values[centre].ravel()

    system = np.column_stack([pair(m) for m in range(modes)])
    scale = np.linalg.norm(system, axis=0)
    coefficients = np.linalg.lstsq(system / scale, -pair(modes), rcond=None)[0] / scale
    # x[k + m] + x[k - m] = 2 cos(m omega h) x[k]: Chebyshev polynomials of cos(omega h).
    series = np.array([coefficients[0], *(2.0 * coefficients[1:]), 2.0])
    roots = np.sort(np.real(np.polynomial.chebyshev.chebroots(series)))[::-1]
    return [math.acos(min(1.0, max(-1.0, root))) / step for root in roots]


def crossings(time: Array, values: Array) -> Array:
    """Times at which `values` cross zero, by cubic interpolation through four samples."""
    found = []
    for k in np.nonzero(values[:-1] * values[1:] < 0.0)[0]:
        if 1 <= k < len(values) - 2:
            t, x = time[k - 1 : k + 3] - time[k], values[k - 1 : k + 3]
            roots = np.roots(np.polyfit(t, x, 3))
            real = np.real(roots[np.abs(np.imag(roots)) < 1e-9])
            found.append(time[k] + real[np.argmin(np.abs(real - 0.5 * (t[1] + t[2])))])
    return np.array(found)


def extremes(values: Array) -> Array:
    """Local extremes of a smooth motion, by a parabola through three samples. Equal neighbours give only one extreme."""
    steps = np.diff(values)
    moving = np.nonzero(steps)[0]
    middle = moving[:-1][steps[moving[:-1]] * steps[moving[1:]] < 0.0] + 1
    before, at, after = values[middle - 1], values[middle], values[middle + 1]
    return np.asarray(at - (after - before) ** 2 / (8.0 * (after - 2.0 * at + before)))


def orders(errors: Sequence[float], ratio: float = 2.0) -> list[float]:
    """Orders of convergence between consecutive errors, where each step is smaller than the last by the factor `ratio`."""
    return [math.log(a / b) / math.log(ratio) for a, b in pairwise(errors)]


def leapfrog_frequency(omega: float, step: float) -> float:
    """Angular frequency of a leapfrog with step h for the true frequency omega: omega asin(x) / x, x = omega h / 2."""
    return 2.0 / step * math.asin(0.5 * omega * step)
