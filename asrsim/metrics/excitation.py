"""Frequency band of an excitation, and the lines of its spectrum."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from asrsim.errors import RecordingError
from asrsim.samples import Array

FLOOR = 1e-2
"""Fraction of the largest input power (-20 dB) above which a frequency counts as excited."""
_FLANK = 0.35
"""The band ends where the power of a frequency falls below this fraction of the power further inside the band. A linear
chirp has a quarter of its full power at its first frequency.
"""
_REACH = 16
"""Number of frequency bins further inside the band, with whose median power the power of a bin is compared."""
_OUTSIDE = 8
"""Number of frequency bins further outside the band whose median power must also be low, since a single weak bin of noise is
not an edge.
"""
_LINE = 1e-3
"""Fraction of the strongest line's power (-30 dB) above which a line counts as excited."""


def excited_band(u: Array, step: float, band: tuple[float, float] | None) -> tuple[float, float, NDArray[np.intp] | None]:
    """Lowest and highest excited frequency in Hz, and the bins of the lines; None in place of the bins if the excitation does
    not consist of lines.

    Raises RecordingError if no frequency is excited.
    """
    from scipy.ndimage import uniform_filter1d
    from scipy.signal.windows import tukey

    n = len(u)
    # Remove the trend, since a slow drift has power in the lowest bins but is no excitation. Taper only the ends of the record,
    # since a smooth window would hide the first and last frequencies of a chirp.
    straight = u - np.polynomial.polynomial.polyval(np.arange(n), np.polynomial.polynomial.polyfit(np.arange(n), u, 1))
    power = np.abs(np.fft.rfft(straight * tukey(n, 0.1))) ** 2
    f = np.fft.rfftfreq(n, step)
    inside = (f > 0) & (f <= 0.45 / step)
    if band is not None:
        inside &= (f >= band[0]) & (f <= band[1])
    if not inside.any() or not power[inside].max() > 0:
        raise RecordingError(
            f"the record resolves no frequency between {band[0]:g} and {band[1]:g} Hz"
            if band
            else "the record varies at no frequency that it resolves",
            code="nothing-excited",
            hint=f"The record resolves {1 / (n * step):.3g} to {0.45 / step:.4g} Hz",
        )
    lines = _lines(np.abs(np.fft.rfft((u - np.mean(u)) * np.hanning(n))) ** 2, inside)
    if lines is not None:
        return float(f[lines[0]]), float(f[lines[-1]]), lines
    bins = np.flatnonzero(inside)
    smooth = uniform_filter1d(power, 5)
    # Start the search for the edges inside the strongest half of the energy, so that a gap in the middle does not end it.
    share = np.cumsum(power[bins]) / np.sum(power[bins])
    low, high = (int(bins[np.searchsorted(share, level)]) for level in (0.25, 0.75))
    enough = FLOOR * smooth[bins].max()
    first = _edge(power, smooth, low, int(bins[0]), -1, enough)
    last = _edge(power, smooth, high, int(bins[-1]), 1, enough)
    return float(f[first]), float(f[last]), None


def _edge(power: Array, smooth: Array, start: int, end: int, way: int, enough: float) -> int:
    """Last excited frequency bin on the way from `start` to `end`. way: 1 for upwards, -1 for downwards."""
    narrow = np.convolve(power, (0.25, 0.5, 0.25), mode="same")
    found = start
    for i in range(start, end + way, way):
        # Towards low frequencies, compare with a whole octave, since the edge of a slow, long chirp is many bins wide.
        inner = np.median(power[i : i + 1 + max(i, _REACH)] if way < 0 else power[max(i - _REACH, 1) : i + 1])
        outer = np.median(power[max(i - (_OUTSIDE - 1) * (way < 0), 1) : i + 1 + (_OUTSIDE - 1) * (way > 0)])
        if smooth[i] < enough or (narrow[i] < _FLANK * inner and outer < _FLANK * inner):
            break
        found = i
    return found


def _lines(power: Array, inside: NDArray[np.bool_]) -> NDArray[np.intp] | None:
    """Bins of the lines of an excitation with a line spectrum (Hann window: three or four bins per line), else None."""
    strong = inside & (power > _LINE * power[inside].max())
    runs = int(np.sum(np.diff(strong.astype(int)) == 1))
    bins = np.flatnonzero(strong)
    narrow = runs > 0 and len(bins) <= 4.5 * runs and bins[0] > 2
    if not narrow or float(np.sum(power[strong])) < 0.95 * float(np.sum(power[inside])):
        return None
    peaks = bins[(power[bins] >= power[bins - 1]) & (power[bins] > power[np.minimum(bins + 1, len(power) - 1)])]
    return peaks if len(peaks) else None
