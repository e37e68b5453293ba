"""Result of a fit: estimates with intervals and verdicts. The verdicts are `identified`, `weak`, `only as ratio`, `no effect`
and `at bound`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from asrsim.identification.combinations import UNKNOWN, Combination, combinations, relative
from asrsim.identification.data import PlayedCommand
from asrsim.identification.judge import ACCEPTABLE, ENOUGH, ChannelFit
from asrsim.identification.parameters import FitParameter, Layout
from asrsim.identification.problem import FitProblem, differences
from asrsim.identification.profiles import Profile
from asrsim.identification.replay import FitReplay
from asrsim.identification.task import Task, Tie
from asrsim.identification.transfer import Transfer
from asrsim.identification.uncertainty import Uncertainty
from asrsim.robot.model import INERTIAS, Robot
from asrsim.samples import Array
from asrsim.scenario.data import Scenario

IDENTIFIED, WEAK, RATIO, NO_EFFECT, AT_BOUND = "identified", "weak", "only as ratio", "no effect", "at bound"
CLOSE = 0.05
"""Largest relative half width of the 95 % interval of an identified parameter. Data sheets of springs and motors state
tolerances of 5 to 10 %.
"""
NONE = 1.0
"""A parameter is unknown if the relative half width of its interval is at least this value. If its interval is so wide even
with all other parameters fixed, the parameter has no effect. If its interval is so wide only with other parameters free, the
other parameters imitate its effect.
"""
HOPELESS = 10.0
"""No interval is shown if its relative half width is at least this value. Not even the power of ten of the parameter is then
known.
"""
NOTHING = 1e-9
"""The effect of a parameter counts as rounding error if it is at most this number of standard deviations of the noise. If the
simulations do not depend on a parameter at all, they are equal bit for bit.
"""
FAR = 4.0
"""Largest factor between start value and estimate of an identified mass or inertia. CAD models and weighing scales have smaller
errors.
"""
VANISHED = 0.01
"""A positive parameter without effect counts as vanished if its estimate is below this fraction of its start value or above the
inverse multiple. Start values are rarely so wrong.
"""
PLACES = ("offset", "delay", "clock", "x", "y", "z")
"""Endings of the keys of positions, zero offsets and delays. The relative errors of these parameters are meaningless."""


@dataclass(frozen=True)
class Estimate:
    """Estimate of a parameter, with its interval and verdict."""

    key: str
    name: str
    unit: str
    start: float
    value: float
    low: float
    """Lower end of the 95 % interval; nan if the value has no interval."""
    high: float
    verdict: str
    reason: str = ""
    track: int | None = None
    is_place: bool = False
    """Whether the parameter is a position, a zero offset or a delay, or belongs to a recording. Its relative error is then
    meaningless.
    """

    @property
    def margin(self) -> float:
        """Half width of the interval relative to the value."""
        return 0.5 * (self.high - self.low) / abs(self.value) if self.value else math.inf

    @property
    def has_interval(self) -> bool:
        """Whether the value has an interval."""
        return not math.isnan(self.low)


def doubted(known: Sequence[Estimate], *, fits: bool, others: Sequence[Mapping[str, float]]) -> Iterator[Estimate]:
    """Estimates, in which the verdict of doubtful parameters changes from identified to weak. All parameters are doubtful if
    the model does not fit, since they then absorb the missing effects. A mass or moment of inertia is doubtful if it is far
    from its start value, which the robot file states.

    others: for each other model, such as a model with suspected causes, its estimates by parameter name. The intervals are
    widened to contain these estimates. If the model fits, the other models explain the recording as well; their delays, zero
    offsets and positions then depend on how commands are interpolated, and are ignored.
    """
    for one in known:
        ratio = one.value / one.start if one.start else 1.0
        reason, values = "", [values[one.name] for values in others if one.name in values]
        values = values if not (fits and one.is_place) else []
        one = replace(one, low=min(one.low, *values), high=max(one.high, *values)) if one.has_interval and values else one
        far = not one.is_place and any(abs(value - one.value) > CLOSE * abs(one.value) for value in values)
        span = " to ".join(dict.fromkeys(f"{value:.4g}" for value in (min(values), max(values)))) if far else ""
        if not fits:
            reason = f"models that explain the recording better estimate {span}" if far else "the model is not shown to fit"
        elif far:
            reason = f"with commands that are held between samples, which explains the recording as well, it is {span}"
        elif not 1.0 / FAR <= ratio <= FAR and one.key.rpartition(".")[2] in ("mass", *INERTIAS):
            reason = (
                f"it is {ratio:.3g} times its start value; if this is plausible, start there (--free {one.key}={one.value:.4g})"
            )
        yield replace(one, verdict=WEAK, reason=reason) if reason and one.verdict == IDENTIFIED else one


def estimates(problem: FitProblem, x: Array, found: Uncertainty) -> tuple[list[Estimate], list[Combination]]:
    """Estimates of all free parameters, and combinations of parameters."""
    scaled, values, _ = relative(problem.layout, x, found.jacobian)
    norms = np.linalg.norm(scaled, axis=0)
    without = NONE * norms < 1.96
    known = combinations(problem, x, found, np.flatnonzero(~found.at_bound & ~without).tolist())
    result = []
    for i, entry in enumerate(problem.layout.entries):
        value, met = float(values[i]), bool(found.at_bound[i])
        low, high = (entry.value(float(x[i] + sign * found.deviation[i] * found.quantile[i])) for sign in (-1.0, 1.0))
        place = entry.key.rpartition(".")[2] in PLACES or entry.track is not None
        # An estimate of exactly 0 has no relative half width. It is identified if its interval is narrow compared with its
        # typical size.
        size = max(abs(value), 0.2 * entry.size) if place or value == 0.0 else abs(value)
        margin = 0.5 * (high - low) / size
        own = [str(one) for one in known if i in one.keys]
        verdict, reason = IDENTIFIED, ""
        if met:
            value = entry.low if value - entry.low <= entry.high - value else entry.high
            vanished = _vanished(entry, value) if without[i] else ""
            verdict, reason = AT_BOUND, vanished or f"{value:.4g} {entry.unit}".rstrip() + " is its bound"
        elif without[i]:
            verdict, reason = NO_EFFECT, _vanished(entry, value) or _reason(entry, float(norms[i]), problem, x)
        elif own and not margin <= UNKNOWN:
            verdict, reason = RATIO, "the recordings identify only " + "; ".join(own)
        elif math.isnan(margin) or (margin >= NONE and not place):
            # The parameter alone has an effect, but other parameters together can produce an equal effect.
            verdict = RATIO
            reason = "its interval exceeds 100 %: other parameters have a similar effect, or parts of the recordings disagree"
        elif margin >= NONE:
            verdict, reason = NO_EFFECT, "it cannot be distinguished from zero"
        elif margin >= CLOSE:
            verdict = WEAK
        if met or without[i] or verdict == RATIO or not margin < HOPELESS:
            low = high = math.nan
        result.append(
            Estimate(
                key=entry.key, name=entry.name, unit=entry.unit, start=entry.start, value=value, low=low, high=high,
                verdict=verdict, reason=reason, track=entry.track, is_place=place,
            )
        )  # fmt: skip
    return result, known


def _vanished(entry: FitParameter, value: float) -> str:
    """Reason why a parameter without effect is far from its start value; empty if the parameter is not so far from it."""
    share = value / entry.start if entry.logarithmic else 1.0
    if VANISHED < share < 1.0 / VANISHED:
        return ""
    where = "fell to" if share < 1.0 else "rose to"
    return f"it {where} {share:.2g} of its start value and has no effect there: the recordings can be explained without it"


def _reason(entry: FitParameter, norm: float, problem: FitProblem, x: Array) -> str:
    """Reason why a parameter has no effect on the compared channels."""
    if norm > NOTHING:
        return f"its whole effect on the compared channels is only {norm:.2g} times their noise"
    if any(np.isnan(left).any() for _, left in differences(problem, x)):
        return "the simulation diverges, so no effect can be computed"
    joint, _, name = entry.key.rpartition(".")
    for drive in problem.tracks[0].door.drives:
        if drive.name == joint and drive.mode and drive.actuator:
            where = f"mode {drive.mode.number} ({drive.mode.name})"
            if not drive.mode.spring and name in [one.name for one in drive.actuator.parameters]:
                return f"{where} has no spring; modes 2 to 8 have one (operation_mode of the robot, or `init --mode`)"
            return f"no compared channel depends on it in {where}"
    return "no compared channel depends on it"


COMPLETE, UNFINISHED, INTERRUPTED, CHECKED = "complete", "unfinished", "interrupted", "checked"
"""COMPLETE: status of a fit that was judged.
UNFINISHED: status of a fit whose time limit was reached.
INTERRUPTED: status of a fit that the user stopped.
CHECKED: status if only the sensitivities were computed.
"""


def accepts(explained: float, *, accept: bool) -> bool:
    """Whether the robot of a model that does not fit is written. explained: smallest explained fraction of a channel's
    variance; accept: whether 90 % of the variance is enough for the user, instead of 95 %.
    """
    return explained >= (ACCEPTABLE if accept else ENOUGH)


@dataclass(frozen=True, kw_only=True, eq=False)
class FitResult:
    """Result of a fit."""

    task: Task
    estimates: tuple[Estimate, ...]
    combinations: tuple[Combination, ...]
    covariance: Array
    """Covariance of the parameter vector."""
    channels: tuple[ChannelFit, ...]
    misfit: tuple[str, ...]
    """Reasons why the model does not fit; empty if the model fits."""
    causes: tuple[str, ...]
    """Effects that the model may lack."""
    transfers: tuple[Transfer, ...]
    """Errors of the recordings that were predicted but not fitted."""
    remarks: tuple[str, ...]
    evaluations: int
    """Number of simulations."""
    seconds: float
    """Duration of the fit, s."""
    bandwidth: float
    """Bandwidth of the observer at the chosen level, rad/s; 0: free simulation without observer."""
    status: str
    """Status of the fit: `complete`, `unfinished`, `interrupted` or `checked`."""
    x: Array
    layout: Layout = field(repr=False)
    ends: tuple[float, ...]
    """End of each recording's training part, s."""
    scenario: Scenario = field(repr=False)
    robot: Robot = field(repr=False)
    whole: bool = False
    """Whether the estimates use whole recordings, including the held-out parts."""
    accepted: bool = False
    """Whether a model that does not fit was accepted."""
    profiles: tuple[Profile, ...] = ()
    """Profile of the misfit for each parameter with an interval; empty if the fit is not complete."""
    replay: FitReplay = field(repr=False)
    """Settings with which the fitted simulation repeats the first recording."""
    played: tuple[PlayedCommand, ...] = field(repr=False)
    """Commands of the first recording."""

    @property
    def fits(self) -> bool | None:
        """Whether the model explains the recordings within the noise. None if the fit is not complete, since it was then not
        judged.
        """
        return not self.misfit if self.status == COMPLETE else None

    @property
    def ties(self) -> tuple[Tie, ...]:
        """Ties of parameters to free parameters."""
        return tuple(self.layout.ties)

    @property
    def explained(self) -> float:
        """Smallest explained fraction of a channel's variance. A simulation that diverges explains nothing."""
        return min((0.0 if one.diverges else one.explained for one in self.channels), default=0.0)

    def find(self, key: str) -> Estimate:
        """Estimate of the parameter with this key or name. If each recording has a separate value, a key gives the estimate for
        the first recording. Raises KeyError.
        """
        for one in self.estimates:
            if key in (one.key, one.name):
                return one
        raise KeyError(key)
