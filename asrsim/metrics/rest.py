"""Rest at the end of a series. Measures of the steady state are undefined while the series still moves.

A series that ends near an extremum of a swing is slow there, but not at rest. Therefore the motion is observed for at least as
long as its last swing took. A creep that slows down exponentially is extrapolated.
"""

from __future__ import annotations

import math

import numpy as np

from asrsim.samples import Array

SHARE = 0.1
"""Last fraction of the duration over which the steady state is averaged."""
BAND = 0.01
"""Largest motion that is left at rest, as a fraction of the range of the whole series. It is half of the settling band."""
STILL = 1e-6
"""Motion that counts as rest for any range of the series, in the unit of the series."""
_NOISE = 8.0
"""Range of a thousand samples of white noise in standard deviations, rounded up."""
_DECAY = 0.25
"""Largest change of the means over a period, as a fraction of the change of amplitude, that the decay of a swing explains."""
_SLOWEST = 0.99
"""Largest ratio of the distances that a creep covers in two successive intervals at which its limit is extrapolated."""


def motion_left(time: Array, values: Array, *, share: float = SHARE, extent: float = 0.0) -> float:
    """Motion that is left at the end of a series (n,), in the unit of the series; 0 at rest.

    The motion is the larger of the amplitude after the last swing and the distance of an exponential creep from its limit. A
    motion counts as rest up to 1 % of the range of the series, or of `extent` if this is larger.
    """
    noise = _noise(values)
    extent = max(float(np.ptp(values)), extent)
    if extent <= max(_NOISE * noise, STILL) or len(values) < 3:
        return 0.0
    swing, period = _last_swing(time, values, max(BAND * extent, _NOISE * noise))
    tenth = share * float(time[-1] - time[0])
    second, last = _last_windows(time, values, max(tenth, swing), 2)
    way = float(np.ptp(last))
    amplitude = max(0.5 * (way - _NOISE * noise), 0.0)
    if len(second):
        # The amplitude was measured at the middle of the last swing. Reduce it by the decay in the half swing until the end.
        amplitude *= math.sqrt(min(way / max(float(np.ptp(second)), way, STILL), 1.0))
    # Use windows of whole periods, since an oscillation does not change the mean over a whole period.
    length = period * math.ceil(tenth / period) if period else max(tenth, swing)
    # Report at most the range of the series, since the extrapolation is meaningless for a motion that has hardly slowed down.
    left = min(max(amplitude, _creep_left(_last_windows(time, values, length, 3), noise)), float(np.ptp(values)))
    return left if left > max(BAND * extent, STILL) else 0.0


def _last_windows(time: Array, values: Array, length: float, number: int) -> list[Array]:
    """The values in the last windows of `length` s, in the order of time. Windows before the series are empty."""
    edges = np.searchsorted(time, [time[-1] - k * length for k in range(number, 0, -1)], side="right").tolist()
    return [values[begin:end] for begin, end in zip(edges, (*edges[1:], len(values)), strict=True)]


def _creep_left(windows: list[Array], noise: float) -> float:
    """Distance of an exponential creep from its limit, from the means of the last three windows; 0 without a creep."""
    third, second, last = windows
    if not len(third) or not len(second):
        return 0.0
    before, now = (float(np.mean(b) - np.mean(a)) for a, b in ((third, second), (second, last)))
    way = float(np.ptp(last))
    # An oscillation whose amplitude decays also changes the means. `swinging` is the size of this change.
    swinging = _DECAY * 0.5 * abs(float(np.ptp(second)) - way)
    if before * now <= 0.0 or abs(now) <= max(_NOISE * noise / math.sqrt(len(last)), swinging):
        return 0.0
    # In an exponential creep, the range of the last window exceeds `ratio` times the change of the means.
    ratio = min(now / before, way / abs(now), _SLOWEST)
    return min(abs(now), way) * ratio / (1.0 - ratio)


def _last_swing(time: Array, values: Array, least: float) -> tuple[float, float]:
    """Durations of the last complete swing and of the last complete period, s.

    A swing is a motion between two turning points. Swings below `least` are ignored. For a motion without a turning point, the
    swing lasts from 10 % to 90 % of the way, since the beginning and the end may be slow. A motion of fewer than three swings
    has no period, and 0 is returned for the period.
    """
    turns = _turning_points(values, least)
    if len(turns) < 2:
        return 0.0, 0.0
    if len(turns) > 3:
        swing = float(time[turns[-2]] - time[turns[-3]])
        return swing, float(time[turns[-2]] - time[turns[-4]]) if len(turns) > 4 else 2.0 * swing
    # The first swing begins with the motion, and not with the record.
    begin, end = turns[0], turns[1]
    way = (values[begin : end + 1] - values[begin]) / (values[end] - values[begin])
    first, last = (begin + int(np.argmax(way >= level)) for level in (0.1, 0.9))
    whole = math.pi / (math.pi - 2.0 * math.acos(0.8)) if len(turns) == 3 else 1.0
    swing = whole * float(time[last] - time[first])
    return swing, 0.0


def _turning_points(values: Array, least: float) -> list[int]:
    """Indices of the first extremum, of the turning points, and of the last extremum, which differ by more than `least`."""
    # Examine only local extrema, since other samples cannot be turning points.
    slopes = np.sign(np.diff(values))
    moving = np.flatnonzero(slopes)
    if not len(moving):
        return []
    places = [0, *(moving[1:][slopes[moving[1:]] != slopes[moving[:-1]]]).tolist(), len(values) - 1]
    turns: list[int] = []
    low = high = 0
    rises: bool | None = None
    for place, value in zip(places, values[places].tolist(), strict=True):
        high = place if value > values[high] else high
        low = place if value < values[low] else low
        if rises is not False and values[high] - value > least:
            turns.append(high)
            rises, low, high = False, place, place
        elif rises is not True and value - values[low] > least:
            turns.append(low)
            rises, low, high = True, place, place
    return turns if rises is None else [*turns, high if rises else low]


def _noise(values: Array) -> float:
    """Standard deviation of white noise in a series, from its third differences, which smooth motions do not change."""
    if len(values) < 9:
        return 0.0
    return float(np.median(np.abs(np.diff(values, 3)))) / (0.6745 * math.sqrt(20.0))
