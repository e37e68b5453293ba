"""Limits of motors and springs that a recording may have run into while the model does not, or the model while it did not."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from asrsim.identification.keys import Parameter, parameters_of
from asrsim.identification.layout import Layout
from asrsim.identification.residuals import Residuals
from asrsim.identification.task import Tie
from asrsim.identification.track import Track
from asrsim.samples import Array

BITES, RELEASES = (0.75, 0.3, 0.1), 2.0
"""Shares of what the motion reaches, and of a limit that it reaches, at which another limit is tried."""
REACHED = 0.999
"""Share of a limit from which on the motion has run into it."""
SIZES = {"max_torque": "torque", "max_velocity": "velocity", "max_current": "current", "max_voltage": "voltage"}
"""Last part of a motor's limit -> the motor's quantity that it bounds on both sides."""
PLACES = {"min_position": -1.0, "max_position": 1.0}
"""The same of a motor's stop -> the side on which it bounds the position."""
DEFLECTION = "max_deflection"
"""A spring's limit."""

Limit = tuple[str, Parameter, list[Tie]]
"""For people, the number with a start that bites, and what goes with it."""


def limits(residuals: Residuals, layout: Layout, x: Array) -> Iterator[Limit]:
    """Every limit that is not free, where it would make a difference to the motion at x; those of a joint's two motors, where
    they are the same number, together.
    """
    track = residuals.tracks[0]
    values = layout.table(x, 0)
    known = parameters_of(track.prepared.robot, (), {})
    for j, drive in enumerate(track.prepared.drives):
        tied: dict[str, str] = {}
        for i in range(1, drive.dynamic_motors + 1):
            for what in (*SIZES, *PLACES):
                key, first = f"{drive.name}.motor_{i}_{what}", f"{drive.name}.motor_1_{what}"
                if key not in known or key in values or key in tied:
                    continue
                reached = _reached(track.series(values, [(j, f"motor_{i}_{SIZES.get(what, 'position')}")]), what)
                starts = _starts(known[key].start, reached, PLACES.get(what))
                if not starts:
                    continue
                other = f"{drive.name}.motor_2_{what}"
                same = key == first and other in known and other not in values and drive.dynamic_motors > 1
                ties = [Tie(key=other, to=key)] if same and known[other].start == known[key].start else []
                tied.update((tie.key, key) for tie in ties)
                for start in starts:
                    yield f"a limit of the motors of {drive.name}, {what}", _parameter(known[key], start, what), ties
        key = f"{drive.name}.{DEFLECTION}"
        if key in known and key not in values and drive.actuator and drive.mode and drive.mode.spring:
            sizes = [_reached(_deflection(track, values, j, i), DEFLECTION) for i in range(1, drive.actuator.motors + 1)]
            most = max((one[1] for one in sizes if one is not None), default=0.0)
            for start in _starts(known[key].start, (0.0, most), None):
                yield f"a limit of the deflection of {drive.name}", _parameter(known[key], start, DEFLECTION), []


def _deflection(track: Track, values: Mapping[str, float], joint: int, motor: int) -> Array | None:
    found = track.series(values, [(joint, f"motor_{motor}_position"), (joint, "link_position")])
    return None if found is None else found[0] - found[1]


def _reached(series: Array | None, what: str) -> tuple[float, float] | None:
    """Least and largest value; of what has two sides, of its size."""
    if series is None or not np.all(np.isfinite(series)):
        return None
    found = series if what in PLACES else np.abs(series)
    return float(found.min()), float(found.max())


def _starts(limit: float, reached: tuple[float, float] | None, side: float | None) -> list[float]:
    """Where another limit is tried; nowhere, where there is nothing to limit."""
    if reached is None or reached[0] == reached[1]:
        return []
    low, high = reached
    # Where a jump of the command reaches the limit for a moment, a lower one may be missing all the same.
    if side is None:
        return [*([RELEASES * limit] if high >= REACHED * limit else []), *(bite * high for bite in BITES)]
    reach, extent = (high if side > 0.0 else low), high - low
    into = math.isfinite(limit) and side * (limit - reach) <= (1.0 - REACHED) * extent
    return [*([limit + side * extent] if into else []), *(reach - side * (1.0 - bite) * extent for bite in BITES)]


def _parameter(parameter: Parameter, start: float, what: str) -> Parameter:
    if what in PLACES:
        return replace(parameter, start=start, low=-math.inf, high=math.inf, logarithmic=False)
    return replace(parameter, start=start, low=1e-3 * start, high=1e3 * start, logarithmic=True)
