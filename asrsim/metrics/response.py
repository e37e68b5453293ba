"""Measures of a frequency response from the reference (input) to the values (output); `low` and `high` (Hz) bound the band.

See `asrsim.metrics.frequency.frequency_response`. The measures are undefined if the output does not move.
"""

from __future__ import annotations

import math
from collections.abc import Callable

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
    """Gain from reference to values at the frequency `hertz`; undefined outside the excited frequency band."""
    found = _response(time, values, reference, low, high)
    return math.nan if found is None else float(np.interp(hertz, found.frequency, found.gain, left=math.nan, right=math.nan))


def _of_response(pick: Callable[[FrequencyResponse], float | None]) -> Callable[..., float]:
    """Measure of time, output and input, defined by a function of the frequency response. If the function returns None, the
    measure is undefined."""

    def measured(time: Array, values: Array, reference: Array, *, low: float | None = None, high: float | None = None) -> float:
        found = _response(time, values, reference, low, high)
        value = None if found is None else pick(found)
        return math.nan if value is None else float(value)

    measured.__name__, measured.__doc__ = pick.__name__, pick.__doc__
    return measured


@_of_response
def largest_gain(found: FrequencyResponse) -> float | None:
    """Largest gain from reference to values in the excited frequency band."""
    return float(np.max(found.gain))


@_of_response
def resonance(found: FrequencyResponse) -> float | None:
    """Frequency of the gain's peak inside the excited frequency band; undefined without a peak."""
    return None if found.resonance is None else found.resonance[0]


@_of_response
def bandwidth(found: FrequencyResponse) -> float | None:
    """Frequency at which the gain first falls 3 dB below its value at the low end of the excited frequency band; undefined if
    the gain does not fall so far."""
    return found.bandwidth


@_of_response
def coherence(found: FrequencyResponse) -> float | None:
    """Smallest coherence of reference and values in the excited frequency band. It is 1 if the reference explains the values
    fully, and 0 if the reference explains nothing."""
    return float(np.min(found.coherence))
