"""What is said of each parameter: identified, weak, only as ratio, no effect, at bound."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from asrsim.actuators import MODES
from asrsim.identification.combinations import Combination, combinations
from asrsim.identification.layout import Entry, Layout
from asrsim.identification.problem import Problem
from asrsim.identification.told import UNKNOWN, percent, relative
from asrsim.identification.track import Track
from asrsim.identification.uncertainty import Uncertainty
from asrsim.samples import Array

IDENTIFIED, WEAK, RATIO, NO_EFFECT, AT_BOUND = "identified", "weak", "only as ratio", "no effect", "at bound"
CLOSE = 0.05
"""Relative half width of the 95 % interval up to which a parameter is identified."""
HOPELESS = 10.0
"""The same from which on an interval tells nothing at all."""
VANISHED = 0.01
"""Share of its start at which a positive parameter is gone, if nothing depends on it there."""
NONE = 1.0
"""The same from which on it cannot be told from none."""


def doubted(told: Sequence[Estimate], missed: float, channel: str) -> list[Estimate]:
    """Estimates of a model that does not fit. missed: largest share of a channel's deviation that it leaves.

    Nothing is known to 5 % by a model that misses more than that of what was recorded.
    """
    reason = f"the model misses {percent(missed)} of {channel}"
    return [replace(one, verdict=WEAK, reason=reason) if one.verdict == IDENTIFIED and missed > CLOSE else one for one in told]


@dataclass(frozen=True)
class Estimate:
    """A parameter's result."""

    key: str
    name: str
    unit: str
    start: float
    value: float
    low: float
    """Of the 95 % interval; nan where there is none."""
    high: float
    verdict: str
    reason: str = ""
    combinations: tuple[str, ...] = ()
    track: int | None = None
    is_place: bool = False
    """Whether it is a place, a zero or a delay, of which a share of itself says nothing."""

    @property
    def margin(self) -> float:
        """Half width of the interval as a share of the value."""
        return 0.5 * (self.high - self.low) / abs(self.value) if self.value else math.inf

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        interval = None if math.isnan(self.low) else [self.low, self.high]
        return {
            "key": self.key, "unit": self.unit, "start": self.start, "estimate": self.value, "interval": interval,
            "verdict": self.verdict, "reason": self.reason, "known": list(self.combinations), "recording": self.track,
        }  # fmt: skip


def bounds_met(layout: Layout, x: Array) -> list[bool]:
    """Whether an entry is at one of its bounds."""
    low, high = layout.bounds
    met = []
    for v, a, b in zip(x, low, high, strict=True):
        width = b - a if math.isfinite(b - a) else 1.0
        met.append(bool(v - a < 1e-4 * min(width, 1.0) or b - v < 1e-4 * min(width, 1.0)))
    return met


def estimates(
    problem: Problem, x: Array, found: Uncertainty, met: Sequence[bool], still: Mapping[str, str]
) -> tuple[list[Estimate], list[Combination]]:
    """met: whether an entry ended at a bound; still: joint -> why nothing is told of what moves there."""
    layout, tracks = problem.layout, problem.tracks
    scaled, values = relative(layout, x, found.jacobian)
    norms = np.linalg.norm(scaled, axis=0)
    without = [NONE * norm < 1.96 for norm in norms]
    free = [i for i in range(len(x)) if not met[i] and not without[i]]
    known = combinations(problem, x, found, free)
    result = []
    for i, entry in enumerate(layout.entries):
        value = float(values[i])
        low, high = _interval(entry, float(x[i]), float(found.deviation[i] * found.quantile[i]))
        margin = 0.5 * (high - low) / max(abs(value), 1e-300)
        place = entry.parameter.key.rpartition(".")[2] in ("offset", "delay", "clock", "x", "y", "z") or entry.track is not None
        if place or value == 0.0:
            # A zero that is well known is known, however small it is.
            margin = 0.5 * (high - low) / max(abs(value), 0.2 * entry.parameter.size)
        own = [one for one in known if i in one.keys]
        listed: tuple[str, ...] = ()
        reason, verdict = "", IDENTIFIED
        if met[i]:
            edges = entry.parameter.low, entry.parameter.high
            value = edges[abs(edges[1] - value) < abs(edges[0] - value)]
            as_far = f"{value:.4g} {entry.parameter.unit}".rstrip() + " is as far as it may go"
            verdict, reason = AT_BOUND, (_vanished(entry, value) if without[i] else "") or as_far
            low = high = math.nan
        elif without[i]:
            verdict, reason = NO_EFFECT, _vanished(entry, value) or _reason(entry, float(norms[i]), tracks, still)
            low = high = math.nan
        elif own and not margin <= UNKNOWN:
            verdict, listed = RATIO, tuple(map(str, own))
            reason, low, high = "known is " + "; ".join(listed), math.nan, math.nan
        elif math.isnan(margin):
            verdict, reason = RATIO, "it is not told apart from others: see the correlations"
        elif margin >= NONE:
            verdict = NO_EFFECT
            reason = still.get(_joint(entry, tracks), "it cannot be told from none: its interval is as wide as itself")
            if not margin < HOPELESS:
                low = high = math.nan
        elif margin >= CLOSE:
            verdict = WEAK
        result.append(
            Estimate(
                key=entry.parameter.key, name=entry.name, unit=entry.parameter.unit, start=entry.start, value=value, low=low,
                high=high, verdict=verdict, reason=reason, combinations=listed, track=entry.track,
                is_place=place,
            )
        )  # fmt: skip
    return result, known


def _interval(entry: Entry, x: float, width: float) -> tuple[float, float]:
    """Of the value; of a logarithm's width, it is not symmetric."""
    parameter = entry.parameter
    if parameter.logarithmic:
        middle = parameter.start * math.exp(x)
        return middle * math.exp(-min(width, 50.0)), middle * math.exp(min(width, 50.0))
    middle = entry.start + parameter.size * x
    return max(middle - parameter.size * width, parameter.low), min(middle + parameter.size * width, parameter.high)


def _joint(entry: Entry, tracks: Sequence[Track]) -> str:
    """That an entry is of: a link's is the one that moves it."""
    owner = entry.parameter.key.rpartition(".")[0]
    return next((one.name for one in tracks[0].door.robot.joints if owner in (one.name, one.child)), owner)


def _vanished(entry: Entry, value: float) -> str:
    """What is to be said of one that left its start so far that nothing depends on it any more; empty where it did not."""
    share = value / entry.start if entry.parameter.logarithmic else 1.0
    if VANISHED < share < 1.0 / VANISHED:
        return ""
    where = "fell to" if share < 1.0 else "rose to"
    return f"it {where} {share:.2g} of its start, where nothing depends on it: the recordings would do without it"


def _reason(entry: Entry, norm: float, tracks: Sequence[Track], still: Mapping[str, str]) -> str:
    """Why nothing compared depends on it."""
    name, joint = entry.parameter.key.rpartition(".")[2], _joint(entry, tracks)
    block = next((one for one in tracks[0].door.drives if one.name == joint), None)
    if norm < 1e-9 and block is not None and block.mode is not None:
        mode = MODES[block.mode.number]
        if name.startswith("motor") and not mode.motor:
            return f"motors have no dynamics in mode {mode.number} ({mode.name})"
        if name.startswith("controller") and not mode.controller:
            return f"mode {mode.number} ({mode.name}) has no controller"
        if name.startswith(("spring", "max_deflection", "hysteresis")) and not mode.spring:
            return f"mode {mode.number} ({mode.name}) has no spring"
    if joint in still:
        return still[joint]
    if name == "max_deflection":
        return "the deflection never reaches it"
    if name.startswith(("spring", "lever", "pulley")):
        return "the deflection is too small"
    return (
        f"all it does to what is compared is {norm:.2g} of the noise"
        if norm > 1e-9
        else "nothing that is compared depends on it"
    )
