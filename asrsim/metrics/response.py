"""Measures of a frequency response from the reference (input) to the values (output); `low` and `high` (Hz) bound the band.

See `asrsim.metrics.frequency.frequency_response`. The measures are undefined if the output does not move.
"""

from __future__ import annotations

import math

import numpy as np

from asrsim.errors import RecordingError
from asrsim.metrics.frequency import FrequencyResponse, frequency_response
from asrsim.samples import Array


def _response(time: Array, output: Array, given: Array, low: float | None, high: float | None) -> FrequencyResponse | None:
    if (low is None) != (high is None):
        raise ValueError("`low` and `high` must be given together")
    try:
        found = frequency_response(time, given, output, band=None if low is None or high is None else (low, high))
    except RecordingError:
        return None
    return found if found.moves else None


def gain(
    time: Array, values: Array, reference: Array, *, hertz: float, low: float | None = None, high: float | None = None
) -> float:
    """Gain from reference to values at the frequency `hertz`; undefined outside the band."""
    found = _response(time, values, reference, low, high)
    return math.nan if found is None else float(np.interp(hertz, found.frequency, found.gain, left=math.nan, right=math.nan))


def largest_gain(time: Array, values: Array, reference: Array, *, low: float | None = None, high: float | None = None) -> float:
    """Largest gain from reference to values in the band."""
    found = _response(time, values, reference, low, high)
    return math.nan if found is None else float(np.max(found.gain))


def resonance(time: Array, values: Array, reference: Array, *, low: float | None = None, high: float | None = None) -> float:
    """Frequency of the gain's peak inside the band; undefined without a peak."""
    found = _response(time, values, reference, low, high)
    return math.nan if found is None or found.resonance is None else found.resonance[0]


def bandwidth(time: Array, values: Array, reference: Array, *, low: float | None = None, high: float | None = None) -> float:
    """Frequency at which the gain first falls 3 dB below its value at the low end of the band; undefined if it does not."""
    found = _response(time, values, reference, low, high)
    return math.nan if found is None or found.bandwidth is None else found.bandwidth


def coherence(time: Array, values: Array, reference: Array, *, low: float | None = None, high: float | None = None) -> float:
    """Smallest coherence of reference and values in the band: 1 if the reference explains the values fully, 0 if not at all."""
    found = _response(time, values, reference, low, high)
    return math.nan if found is None else float(np.min(found.coherence))
