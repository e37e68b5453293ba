"""The search: least squares while an observer moves the simulation towards the recorded positions. The observer's bandwidth
falls level by level to 0, where the simulation is free. Substeps and weights are then adapted to the estimates.

With a fast observer the residuals are errors of short predictions, which have hardly more than one minimum. Each level starts
at the estimate of the level before; if a free simulation fits after the first level, the others are left out. The free
simulation is kept if it explains the recording, or if it follows the channels, and either predicts held-out parts as well as
fitted parts or agrees with the slower levels. Otherwise errors of the model accumulate in it. A level then counts only if a
free simulation of the whole recordings with that level's estimates explains as many channels as the fitted free simulation
does, at each of three limits: 50, 90 and 95 % of a channel's variance. Of these levels, the level is kept whose estimates
differ least between tenths of the recordings. If several levels differ equally, within chance, the level with the best
predictions is kept. If this is the first level, the bandwidth rises as long as its level is kept. At a lower bandwidth errors
of the model accumulate; at a higher one, predictions are so short that they show mostly noise. If no level is kept by these
rules, the free simulation is kept.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from asrsim.identification.extensions import extended, jumps, presliding, stairs
from asrsim.identification.judge import ACCEPTABLE, ENOUGH, FOLLOWED, HELD_OUT, explains, fits, is_explained
from asrsim.identification.parameters import JUMP
from asrsim.identification.problem import (
    FitProblem,
    differences,
    huber,
    residuals,
    slopes_along,
    solve,
    weighed,
    with_own_substeps,
)
from asrsim.identification.uncertainty import BLOCKS, uncertainty
from asrsim.metrics.values import root_mean_square
from asrsim.samples import Array

LEVELS = (8.0, 2.0, 0.5, 0.1)
"""Bandwidths of the observer, in units of the band of the motion. A prototype found the right minima of five recorded machines
at 0.25 to 8, from starts that were wrong by a factor of ten; at bandwidths below 0.1 it did not.
"""
EVALUATIONS, TWICE = 10, 2
"""Largest number of evaluations of a search with an observer, and number of searches with new weights at each level, as in the
prototype.
"""
AGREES = 1.1
"""Two successive levels agree if the estimate of the first raises the mean square error at the second at most by this factor:
the error itself rises by 5 %, as in the prototype.
"""
TIMED = 3
"""Number of linear solutions for the instants of jumps. The error is nearly linear in them, so each solution leaves little."""
RISE = 2.0
"""Factor by which the bandwidth rises from level to level, so small that predictions of successive levels cover similar times.
"""
CHANCE = (2.0 * (BLOCKS - 1)) ** -0.5
"""Standard error of the logarithm of a standard deviation that is estimated from the tenths of a recording."""
ELSEWHERE = (0.1, 10.0, 0.01, 100.0)
"""Factors of all stiffnesses at which the search begins anew if the predictions do not follow a channel: one and
two decades to both sides, since the start values of stiffnesses have the largest errors.
"""
SPRINGS = ("stiffness", "spring_k")
"""Words in the names of stiffnesses."""


class Stopped(Exception):  # noqa: N818 - a request, not an error
    """Raised between evaluations when the user stops the fit."""


class OutOfTime(Stopped):
    """Raised between evaluations when the time of the fit is over."""


@dataclass
class Best:
    """The best fit so far, stored outside the search so that the fit survives an interruption."""

    problem: FitProblem
    x: Array
    cost: float = np.inf
    slow: tuple[tuple[FitProblem, Array], ...] = ()
    """If the free simulation is not kept: problem and estimate of the free simulation or, if it follows no channel, of the
    levels that follow the channels, the slowest first. Errors of the model are largest at slow levels.
    """

    def take(self, problem: FitProblem, x: Array) -> None:
        """Replace the fit."""
        self.problem, self.x, self.cost = problem, x, huber(residuals(problem, x))


def search(best: Best, begin: Callable[[str], None]) -> None:
    """Search level by level, and store the fit in `best`. begin: called with the name of each level."""
    # Search without staircases first: far from the solution, a command played as a staircase might fit better by chance.
    problem, found = best.problem.played(frozenset()), list[tuple[FitProblem, Array]]()
    begun = x = np.append(best.x, np.zeros(len(problem.layout) - len(best.x)))
    for level in (*(problem.distinct(LEVELS) if problem.observes else ()), 0.0):
        begin(_name(level))
        first = level == LEVELS[0]
        if not level and _likelihood((problem.observed(0.0), begun)) < _likelihood((problem.observed(0.0), x)):
            # Return to the start of the search: short predictions may contain too little information, so that the search left a
            # good start.
            x = begun
        problem, x = _solved(problem.observed(level), x, times=1 if first else TWICE)
        if first:
            if not follows(problem, x):
                starts = [problem.layout.scaled(np.zeros(len(x)), SPRINGS, factor) for factor in ELSEWHERE]
                problem, x = min([(problem, x), *(_solved(problem, start) for start in starts)], key=_likelihood)
            best.take(problem, x)
            # If a free simulation fits from here, we are near the solution, and the intermediate levels are not needed.
            near = weighed(problem.observed(0.0), x)
            there = solve(near, x, rounds=EVALUATIONS)
            if fits(near, there):
                best.take(near, there)
                return
            problem, x = _solved(problem, x, times=1)
        found.append((problem, x))
        best.take(problem, x)
    free = extended(problem, x, (stairs, jumps, presliding), enough=fits)
    best.take(free.problem, free.x)
    most, followed = followed_by(free.problem, free.x), follows(free.problem, free.x)
    agrees = followed and (all(_agree(*pair) for pair in pairwise(found)) or _transfers(free.problem, free.x))
    if agrees or not problem.observes or fits(free.problem, free.x):
        return
    # Short predictions may contain too little information, so that the search finds parameters with which a free simulation
    # moves differently.
    levels = [_judged(*fit) for fit in (found if followed else found[:-1]) if reaches(fit, most)]
    if not levels:
        return
    kept, level = _best(levels), LEVELS[0]
    fastest = levels[0] if levels[0].problem is found[0][0] else None
    while kept is fastest and problem.can_rise(level := level * RISE):
        begin(_name(level))
        risen = _solved(kept.problem.observed(level), kept.x)
        if not reaches(risen, most):
            break
        levels.append(fastest := _judged(*risen))
        kept = _best(levels)
    if kept.problem.playing.bandwidth > 0.0:
        best.slow = ((free.problem, free.x),) if followed else tuple(fit for fit in found[-2::-1] if follows(*fit))
        best.take(kept.problem, kept.x)


@dataclass(frozen=True, eq=False)
class _Level:
    """A level of the search, with the measures that decide whether it is kept."""

    problem: FitProblem
    x: Array
    spread: Array
    """Standard deviations (n,) of the estimates from their spread between tenths of the recordings, in the vector's units; nan
    for parameters without effect.
    """
    error: float
    """Negative logarithm of the likelihood of the predictions, for each sample."""


def _judged(problem: FitProblem, x: Array) -> _Level:
    return _Level(problem, x, uncertainty(problem, x, quick=True).spread, _likelihood((problem, x)))


def _best(levels: Sequence[_Level]) -> _Level:
    """The level with the best predictions, of the levels whose estimates differ least (within chance) between tenths of the
    recordings.
    """
    entries = levels[0].problem.layout.entries
    # Parameters of single recordings, such as initial positions, matter less to short predictions.
    shared = [entry.track is None for entry in entries]
    # A spread larger than the parameter itself only means that the parameter is unknown: limit it to the parameter's size.
    most = [
        1.0 if entry.logarithmic else max(abs(entry.value(float(one.x[i]))) for one in levels) / entry.size or 1.0
        for i, entry in enumerate(entries)
    ]
    known = [np.log(np.clip(np.nan_to_num(one.spread, nan=np.inf), 1e-300, most))[shared] for one in levels]
    sums = [float(np.mean(one)) if len(one) else 0.0 for one in known]
    good = [one for one, sum_ in zip(levels, sums, strict=True) if sum_ <= min(sums) + CHANCE]
    return min(good, key=lambda one: one.error)


def _name(level: float) -> str:
    return f"observer at {level:g} times the bandwidth of the motion" if level else "free simulation"


def _solved(problem: FitProblem, x: Array, times: int = TWICE) -> tuple[FitProblem, Array]:
    """Problem with weights and substeps of the estimate, and estimate. times: number of searches with an observer."""
    observed = problem.playing.bandwidth > 0.0
    for _ in range(times):
        problem = weighed(with_own_substeps(problem, x), x)
        if observed:
            x = solve(problem, x, robust=True, rounds=EVALUATIONS, tolerance=1e-2)
        else:
            x = refined(problem, x)
            break
    return problem, x


def level_by_level(problem: FitProblem, starts: Sequence[Array]) -> Array:
    """Estimate of a search level by level, down to the problem's own bandwidth and weights, from the start whose predictions
    are best at the first level.
    """
    for level in problem.distinct(LEVELS) if problem.observes else ():
        if (faster := problem.observed(level)).playing.bandwidth > problem.playing.bandwidth:
            starts = [min((_solved(faster, one, times=1) for one in starts), key=_likelihood)[1]]
    return min((solve(problem, one, rounds=EVALUATIONS) for one in starts), key=lambda x: huber(residuals(problem, x)))


def follows(problem: FitProblem, x: Array) -> bool:
    """Whether the predictions explain more than half of the variance of each channel."""
    return all(explains(part, left, FOLLOWED) for part, left in differences(problem, x))


def followed_by(problem: FitProblem, x: Array) -> list[int]:
    """Numbers of channels of whose variance a free simulation of the whole recordings with these estimates explains at least
    50, 90 and 95 %.
    """
    found = differences(problem.observed(0.0).everything, x)
    return [sum(explains(part, left, least) for part, left in found) for least in (FOLLOWED, ACCEPTABLE, ENOUGH)]


def reaches(fit: tuple[FitProblem, Array], most: Sequence[int]) -> bool:
    """Whether a free simulation with these estimates explains as many channels as another simulation; most: result of
    `followed_by` for that simulation.
    """
    return all(own >= least for own, least in zip(followed_by(*fit), most, strict=True))


def _likelihood(fit: tuple[FitProblem, Array]) -> float:
    """Negative logarithm of the likelihood of predictions with unknown noise, for each sample."""
    sizes = [float(np.mean(left**2)) if np.isfinite(left).all() else np.inf for _, left in differences(*fit)]
    return float(np.sum(np.log(np.maximum(sizes, 1e-300))))


def _transfers(problem: FitProblem, x: Array) -> bool:
    """Whether a fit predicts held-out parts as well as the parts that were fitted."""
    parts = [
        (left[: (count := part.channel.until(problem.ends[part.track]))], left[count:])
        for part, left in differences(problem.everything, x)
        if problem.ends[part.track] and np.isfinite(left).all()
    ]
    return all(len(held) and root_mean_square(held) <= HELD_OUT * root_mean_square(trained) for trained, held in parts)


def _agree(fit: tuple[FitProblem, Array], slower: tuple[FitProblem, Array]) -> bool:
    """Whether the estimate of a level is nearly optimal at the next, slower level."""
    problem, x = slower
    return bool(huber(residuals(problem, fit[1])) <= AGREES * huber(residuals(problem, x)))


def has_outliers(values: Array) -> bool:
    """Whether the residuals have isolated outliers; consecutive large residuals are model errors."""
    size = np.abs(values - np.median(values))
    far = size > 5.0 * np.median(size) / 0.6745
    alone = far[1:-1] & ~far[:-2] & ~far[2:]
    return float(np.mean(alone)) > 1e-3


def refined(problem: FitProblem, x: Array) -> Array:
    """Least-squares solution, from a start vector near the solution; with the Huber loss if there are outliers."""
    return solve(problem, x, robust=has_outliers(residuals(problem, x)))


def settle(best: Best) -> None:
    """Adapt substeps and weights to the estimates; add instants of jumps and pre-sliding friction if they are significant."""
    _resolve(best)
    # Try these effects unless the residuals are zero: with many samples, jumps and pre-sliding friction are significant even if
    # the residuals look like noise.
    found = extended(best.problem, best.x, (jumps, presliding), enough=is_explained)
    # Reject effects with which a free simulation no longer follows the recording: short predictions may gain by them
    # nevertheless.
    if found.chosen and reaches((found.problem, found.x), followed_by(best.problem, best.x)):
        best.problem, best.x, best.cost = found.problem, found.x, found.cost
        _resolve(best)
    best.x = _timed(best.problem, best.x)


def _timed(problem: FitProblem, x: Array) -> Array:
    """Vector with fitted instants of the jumps in held-out parts; the error is nearly linear in these instants."""
    from scipy.optimize import lsq_linear

    whole, (low, high), x = problem.everything, problem.layout.bounds, x.copy()
    late = [
        i for i, entry in enumerate(problem.layout.entries) if entry.track is not None and entry.key.startswith(JUMP)
        and problem.tracks[entry.track].jumps[int(entry.key.removeprefix(JUMP)) - 1] > problem.ends[entry.track]
    ]  # fmt: skip
    for _ in range(TIMED if late else 0):
        left = residuals(whole, x)
        slopes = slopes_along(whole, x, late, base=left)
        x[late] += lsq_linear(slopes, -left, bounds=(low[late] - x[late] - 1e-12, high[late] - x[late] + 1e-12)).x
        x[late] = np.clip(x[late], low[late], high[late])
    return x


def _resolve(best: Best) -> None:
    """Adapt substeps and weights to the estimates."""
    for _ in range(3):
        resolved = with_own_substeps(best.problem, best.x)
        if resolved is best.problem:
            break
        best.problem, best.x = resolved, refined(resolved, best.x)
    best.problem = weighed(best.problem, best.x)
    best.x = refined(best.problem, best.x)
