"""Frequency response from any excitation: gain, phase, coherence with confidence bands, resonance, bandwidth.

Three estimators, chosen by what the excitation is:

- *periodic*, for one that repeats itself (multisine): the transform of whole periods, once the output has settled.
- *local*, for one that is dense in frequency (chirp, noise, steps): a local rational fit, after McKelvey and Guerin
  (Non-parametric frequency response estimation using a local rational model, SYSID 2012) and Pintelon, Schoukens,
  Vandersteen and Barbe (Mechanical Systems and Signal Processing 24, 2010). Unlike averaging over segments it has neither
  leakage nor smoothing: a chirp passes each frequency once, and segments would cut it.
- *welch*, for lines that do not repeat within the record: `scipy.signal.csd` with Hann windows, half overlapping, read at the
  excited lines only.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from asrsim.errors import Problem, RecordingError
from asrsim.metrics.excitation import excited_band, lines_of, period_of
from asrsim.metrics.local import local_rational
from asrsim.metrics.periodic import by_periods
from asrsim.metrics.spectra import Spectra, uniform, welch
from asrsim.samples import Array

METHODS = ("auto", "periodic", "local", "welch")
_STILL, _NOTHING = 1e-7, 1e-12
"""Share of the output's own size, and size in any SI unit, up to which it "does not move"."""
_TRUSTED = 0.5
"""Coherence below which a point says nothing."""


@dataclass(frozen=True, kw_only=True)
class FrequencyResponse:
    """Response of an output to an input at m frequencies inside the excited band."""

    frequency: Array
    """(m,) Hz, ascending."""
    gain: Array
    """(m,) output unit / input unit."""
    phase: Array
    """(m,) degrees, unwrapped; begins within -180 ... 180."""
    coherence: Array
    """(m,) 0 to 1: share of the output that the input explains, corrected for the number of averages."""
    gain_low: Array
    """(m,) lower edge of the gain's confidence band, not below 0."""
    gain_high: Array
    """(m,) upper edge."""
    phase_margin: Array
    """(m,) degrees, half width of the phase's confidence band; 180 where the phase is unknown."""
    confidence: float
    """Probability of the bands, such as 0.95."""
    averages: float
    """Periods (periodic), independent averages (welch) or degrees of freedom (local) behind each point."""
    resolution: float
    """Hz between independent points."""
    method: str
    """periodic, local or welch."""
    band: tuple[float, float]
    """Hz, the excited band."""
    resonance: tuple[float, float] | None
    """Frequency (Hz) and gain of the largest peak inside the band; None if the gain has none."""
    bandwidth: float | None
    """Hz at which the gain first falls 3 dB below its value at the low end of the band; None if it does not in the band."""
    moves: bool
    """False: the output does not follow the input (held by friction, or not connected)."""
    findings: tuple[Problem, ...] = ()

    def at(self, frequencies: Array) -> NDArray[np.complex128]:
        """Complex response at other frequencies (k,) Hz by linear interpolation; NaN outside of the band."""
        value = self.gain * np.exp(1j * np.radians(self.phase))
        real = np.interp(frequencies, self.frequency, value.real, left=math.nan, right=math.nan)
        imaginary = np.interp(frequencies, self.frequency, value.imag, left=math.nan, right=math.nan)
        return np.asarray(real + 1j * imaginary)


def frequency_response(
    time: Array, excitation: Array, output: Array, *, band: tuple[float, float] | None = None, method: str = "auto",
    confidence: float = 0.95,
) -> FrequencyResponse:  # fmt: skip
    """Response of the output to the excitation, which may be a chirp, a multisine, noise or anything else that moves.

    Args:
        time: (n,) s; uneven sampling is brought to its median step by linear interpolation.
        excitation: (n,), input; NaN are left out at the ends and bridged inside only up to three samples.
        output: (n,).
        band: Hz, lowest and highest frequency; None: where the input has more than -20 dB of its largest power.
        method: auto, periodic, local or welch.
        confidence: Probability of the bands.

    Raises:
        RecordingError: Too short, input constant, nothing excited in the band.
    """
    if method not in METHODS:
        raise RecordingError(f"no method is called '{method}'", choices=METHODS)
    t, u, y, findings = uniform(time, excitation, output)
    if len(t) < 64:
        raise RecordingError(f"{len(t)} samples are too few for a frequency response; at least 64", code="too-short")
    if np.ptp(u) <= 1e-12 * float(np.max(np.abs(u))):
        raise RecordingError(
            f"the excitation is constant at {u[0]:g}; a frequency response needs one that moves", code="constant-excitation",
            hint="Expected a chirp, multisine or noise",
        )  # fmt: skip
    # Each in its own units: micrometres are much of a stiff spring, however many newtons they took.
    moves = bool(np.ptp(y) > max(_STILL * float(np.max(np.abs(y))), _NOTHING))
    if not moves:
        findings.append(
            Problem(f"the output does not move: it varies by {np.ptp(y):.3g}, the input by {np.ptp(u):.3g}; it is held "
                    "(by friction?) or not connected", code="output-still")
        )  # fmt: skip
    step = float(t[1] - t[0])
    spectra, chosen, (low, high) = _estimate(u, y, step, band, method)
    coherence = float(np.median(spectra.coherence))
    if moves and coherence < _TRUSTED:
        findings.append(
            Problem(f"the input explains little of the output: median coherence {coherence:.2g}; gain and phase are "
                    "not to be believed", code="low-coherence", hint="Excite by a chirp, multisine or noise")
        )  # fmt: skip
    if len(spectra.frequency) == 1:
        findings.append(
            Problem(f"there is a single frequency, {spectra.frequency[0]:.4g} Hz: gain and phase are points, not curves",
                    code="single-frequency", hint="A chirp, a multisine or a wider band gives more")
        )  # fmt: skip
    return _response(spectra, chosen, (low, high), confidence, moves, findings)


def _estimate(
    u: Array, y: Array, step: float, band: tuple[float, float] | None, method: str
) -> tuple[Spectra, str, tuple[float, float]]:
    """Spectra, the method's name and the band. Raises RecordingError."""
    period = period_of(u) if method in ("auto", "periodic") else None
    if period is not None:
        found = by_periods(u, y, step, period, lines_of(u, period, step, band))
        if found is not None:
            return found, "periodic", (float(found.frequency[0]), float(found.frequency[-1]))
    if method == "periodic":
        message = "the excitation has no period that the record holds twice, with the output settled"
        raise RecordingError(message, code="not-periodic", hint="Expected a multisine over whole periods")
    low, high, sparse = excited_band(u, step, band)
    chosen = ("welch" if sparse else "local") if method == "auto" else method
    estimate = welch if chosen == "welch" else local_rational
    return estimate(u, y, step, low, high), chosen, (low, high)


def _response(
    spectra: Spectra, method: str, band: tuple[float, float], confidence: float, moves: bool, findings: list[Problem]
) -> FrequencyResponse:
    from scipy.stats import f, t

    gain = np.abs(spectra.response)
    phase = np.degrees(np.unwrap(np.angle(spectra.response)))
    # The error is round in the complex plane; towards the gain and across to it it is Student's, from a variance that is
    # itself estimated. A response that its own noise hides has no direction: there the whole disc counts.
    sigma = spectra.deviation / math.sqrt(2)
    disc = sigma * math.sqrt(2 * float(f.ppf(confidence, 2, 2 * spectra.freedom)))
    width = np.where(disc < 1, sigma * float(t.ppf(0.5 + confidence / 2, 2 * spectra.freedom)), disc)
    margin = np.where(width < 1, np.degrees(np.arcsin(np.minimum(width, 1.0))), 180.0)
    return FrequencyResponse(
        frequency=spectra.frequency, gain=gain, phase=phase, coherence=np.clip(spectra.coherence, 0, 1),
        gain_low=gain * np.maximum(1 - width, 0), gain_high=gain * (1 + width), phase_margin=margin,
        confidence=confidence, averages=spectra.averages, resolution=spectra.resolution, method=method, band=band,
        resonance=_resonance(spectra.frequency, gain, spectra.coherence) if moves else None,
        bandwidth=_bandwidth(spectra.frequency, gain) if moves else None, moves=moves, findings=tuple(findings),
    )  # fmt: skip


def _resonance(f: Array, gain: Array, coherence: Array) -> tuple[float, float] | None:
    """The highest peak that is 5 % above the low end and inside the band, refined by a parabola through three points."""
    trusted = np.where(coherence > _TRUSTED, gain, 0.0)
    i = int(np.argmax(trusted))
    # A gain that rises to an end of the band has no peak there; what lies within a fiftieth of it is the end.
    edge = 1 + len(f) // 50
    if not edge <= i < len(f) - edge or trusted[i] < 1.05 * _low_gain(gain):
        return None
    x, y = f[i - 1 : i + 2] - f[i], gain[i - 1 : i + 2]
    a, b, c = np.polyfit(x, y, 2)
    if a >= 0:
        return float(f[i]), float(gain[i])
    shift = float(np.clip(-b / (2 * a), x[0], x[2]))
    return float(f[i]) + shift, float(a * shift**2 + b * shift + c)


def _low_gain(gain: Array) -> float:
    return float(np.median(gain[: max(3, len(gain) // 50)]))


def _bandwidth(f: Array, gain: Array) -> float | None:
    level = _low_gain(gain) / math.sqrt(2)
    below = np.flatnonzero(gain < level)
    if not len(below) or below[0] == 0:
        return None
    i = int(below[0])
    return float(f[i - 1] + (gain[i - 1] - level) / (gain[i - 1] - gain[i]) * (f[i] - f[i - 1]))
