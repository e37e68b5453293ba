"""Frequency response for any excitation: gain, phase, coherence with confidence bands, resonance, bandwidth.

The estimator depends on the excitation:

- *lines*, for a sum of some sines (multisine): sines fitted by least squares after the output has settled. The sines need no
  common period.
- *local*, for an excitation that is dense in frequency (chirp, noise, steps): a local rational fit, after McKelvey and Guerin
  (Non-parametric frequency response estimation using a local rational model, SYSID 2012) and Pintelon, Schoukens,
  Vandersteen and Barbe (Mechanical Systems and Signal Processing 24, 2010). Unlike an average over segments, the fit has
  neither leakage nor smoothing: a chirp passes each frequency once, and segments would split the chirp.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from asrsim.errors import Problem, RecordingError
from asrsim.metrics.excitation import excited_band
from asrsim.metrics.lines import by_lines
from asrsim.metrics.local import local_rational
from asrsim.metrics.spectra import Spectra, uniform
from asrsim.samples import Array

CONFIDENCE = 0.95
"""Confidence level of the confidence bands of gain and phase."""
_STILL, _NOTHING = 1e-7, 1e-12
"""Variation up to which an output counts as not moving. _STILL: relative to the size of the output; _NOTHING: absolute, in SI
units."""
_TRUSTED = 0.5
"""Coherence below which a point of the frequency response is unreliable, and is not used to find resonance and bandwidth."""


@dataclass(frozen=True, kw_only=True)
class FrequencyResponse:
    """Frequency response of an output to an input at m frequencies inside the excited band."""

    frequency: Array
    """Frequencies (m,), Hz, ascending."""
    gain: Array
    """Gain (m,), output unit / input unit."""
    phase: Array
    """Phase (m,), degrees, unwrapped; the first value lies within -180 ... 180."""
    coherence: Array
    """Coherence (m,), 0 to 1: fraction of the output that the input explains, corrected for the number of averages."""
    gain_low: Array
    """Lower edge (m,) of the gain's confidence band, not below 0."""
    gain_high: Array
    """Upper edge (m,) of the gain's confidence band."""
    phase_margin: Array
    """Half-width (m,) of the phase's confidence band, degrees; 180 if the phase is unknown."""
    band: tuple[float, float]
    """Excited band, Hz."""
    resonance: tuple[float, float] | None
    """Frequency (Hz) and gain of the largest peak inside the band; None if the gain has no peak."""
    bandwidth: float | None
    """Frequency at which the gain first falls 3 dB below its value at the low end of the band, Hz; None if the gain does not
    fall by 3 dB inside the band.
    """
    moves: bool
    """Whether the output moves. False: static friction stops the output, or the input does not act on the output."""
    findings: tuple[Problem, ...] = ()


def frequency_response(
    time: Array, excitation: Array, output: Array, *, band: tuple[float, float] | None = None
) -> FrequencyResponse:
    """Frequency response of the output to the excitation: a chirp, a multisine, noise or any other varying signal.

    Args:
        time: Times (n,), s; an uneven sampling is interpolated linearly to its median step.
        excitation: Input (n,). NaN at the ends are removed; inside, gaps of up to three samples are interpolated.
        output: Output (n,).
        band: Lowest and highest frequency, Hz; None: the band with more than -20 dB of the input's largest power.

    Raises:
        RecordingError: The record is too short, the input is constant, or no frequency of the band is excited.
    """
    t, u, y, findings = uniform(time, excitation, output)
    if len(t) < 64:
        raise RecordingError(f"{len(t)} samples are too few for a frequency response; at least 64 are needed", code="too-short")
    if np.ptp(u) <= 1e-12 * float(np.max(np.abs(u))):
        raise RecordingError(
            f"the excitation is constant at {u[0]:g}; a frequency response needs an excitation that varies",
            code="constant-excitation",
            hint="Expected a chirp, multisine or noise",
        )
    # Compare each signal with its own magnitude, since a few micrometres may be a large motion of a stiff spring.
    moves = bool(np.ptp(y) > max(_STILL * float(np.max(np.abs(y))), _NOTHING))
    if not moves:
        findings.append(
            Problem(
                f"the output does not move: it varies by {np.ptp(y):.3g}, and the input varies by {np.ptp(u):.3g}; friction "
                "may hold it, or the input does not act on it",
                code="output-still",
            )
        )
    step = float(t[1] - t[0])
    low, high, lines = excited_band(u, step, band)
    spectra = local_rational(u, y, step, low, high) if lines is None else by_lines(u, y, step, lines)
    coherence = float(np.median(spectra.coherence))
    if moves and coherence < _TRUSTED:
        findings.append(
            Problem(
                f"the input explains little of the output: median coherence {coherence:.2g}; gain and phase are unreliable",
                code="low-coherence",
                hint="Excite by a chirp, multisine or noise",
            )
        )
    if len(spectra.frequency) == 1:
        findings.append(
            Problem(
                f"there is a single frequency, {spectra.frequency[0]:.4g} Hz: gain and phase are points, not curves",
                code="single-frequency",
                hint="A chirp, a multisine or a wider band excites more frequencies",
            )
        )
    return _response(spectra, (low, high), moves, findings)


def _response(spectra: Spectra, band: tuple[float, float], moves: bool, findings: list[Problem]) -> FrequencyResponse:
    from scipy.stats import f, t

    gain = np.abs(spectra.response)
    phase = np.degrees(np.unwrap(np.angle(spectra.response)))
    # The error of the response is circular in the complex plane. Its components along and across the response follow Student's
    # distribution, since the variance is estimated, too. If the noise exceeds the response, the phase is unknown, so use the
    # whole disc.
    sigma = spectra.deviation / math.sqrt(2)
    disc = sigma * math.sqrt(2 * float(f.ppf(CONFIDENCE, 2, 2 * spectra.freedom)))
    width = np.where(disc < 1, sigma * float(t.ppf(0.5 + CONFIDENCE / 2, 2 * spectra.freedom)), disc)
    margin = np.where(width < 1, np.degrees(np.arcsin(np.minimum(width, 1.0))), 180.0)
    return FrequencyResponse(
        frequency=spectra.frequency,
        gain=gain,
        phase=phase,
        coherence=np.clip(spectra.coherence, 0, 1),
        gain_low=gain * np.maximum(1 - width, 0),
        gain_high=gain * (1 + width),
        phase_margin=margin,
        band=band,
        resonance=_resonance(spectra.frequency, gain, spectra.coherence) if moves else None,
        bandwidth=_bandwidth(spectra.frequency, gain, spectra.coherence) if moves else None,
        moves=moves,
        findings=tuple(findings),
    )


def _resonance(f: Array, gain: Array, coherence: Array) -> tuple[float, float] | None:
    """Frequency and gain of the highest peak inside the band, refined by a parabola. The gain at the peak is at least 5 % above
    the gain at the low end of the band.
    """
    trusted = np.where(coherence > _TRUSTED, gain, 0.0)
    i = int(np.argmax(trusted))
    # A gain that rises up to an end of the frequency range has no peak there. The outermost 2 % of the points count as the end.
    edge = 1 + len(f) // 50
    if not edge <= i < len(f) - edge or trusted[i] < 1.05 * _low_end(gain):
        return None
    x, y = f[i - 1 : i + 2] - f[i], gain[i - 1 : i + 2]
    a, b, c = np.polyfit(x, y, 2)
    if a >= 0:
        return float(f[i]), float(gain[i])
    shift = float(np.clip(-b / (2 * a), x[0], x[2]))
    return float(f[i]) + shift, float(a * shift**2 + b * shift + c)


def _low_end(values: Array) -> float:
    """Value at the low end of the band."""
    return float(np.median(values[: max(3, len(values) // 50)]))


def _bandwidth(f: Array, gain: Array, coherence: Array) -> float | None:
    """Frequency at which the gain falls 3 dB below the low end of the band; None if the coherence at this frequency or at the
    low end is too low.
    """
    level = _low_end(gain) / math.sqrt(2)
    below = np.flatnonzero(gain < level)
    if not len(below) or below[0] == 0:
        return None
    i = int(below[0])
    if min(_low_end(coherence), *coherence[i - 1 : i + 1]) < _TRUSTED:
        return None
    return float(f[i - 1] + (gain[i - 1] - level) / (gain[i - 1] - gain[i]) * (f[i] - f[i - 1]))
