"""The search: least squares in several levels. At each level but the last, an observer corrects the simulation towards the
recorded positions. The observer's bandwidth falls from level to level. At the last level it is 0, and the simulation is free.
After the search, substeps and weights are adapted to the estimates.

With a fast observer the residuals are errors of short predictions, and their sum of squares rarely has more than one minimum.
The search at each level starts at the estimate of the level before. If a free simulation fits after the first level, the search
ends there.

The free simulation is kept if the model fits. It is also kept if it follows the whole recordings and passes one of two tests:
it predicts held-out parts as well as fitted parts, or its estimates agree with the estimates of the levels before it. Otherwise
errors of the model accumulate in the free simulation, and the level to keep is selected in three steps.

1. A level is a candidate if a free simulation of the whole recordings with its estimates explains as many channels as the
fitted free simulation. Three limits are compared: 50, 90 and 95 % of a channel's variance. If no level is a candidate, the free
simulation is kept.
2. The candidate whose estimates differ least between tenths of the recordings is kept. If several levels differ equally within
chance, the level is kept whose estimates give the smallest error of a free simulation.
3. If this is the first level, further levels with higher bandwidths are tried, as long as their estimates differ as little
between tenths, within chance. The highest of these levels is kept.

At a low bandwidth, errors of the model accumulate in the predictions. At a high bandwidth, predictions are so short that they
show mostly noise.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from asrsim.identification.extensions import DECISIVE, extended, is_significant, jumps, presliding
from asrsim.identification.judge import ACCEPTABLE, ENOUGH, FOLLOWED, HELD_OUT, are_negligible, explains, fits, is_explained
from asrsim.identification.noise import independent_samples
from asrsim.identification.parameters import CLOCK, JUMP
from asrsim.identification.problem import (
    Differences,
    FitProblem,
    differences,
    huber,
    jacobian,
    mean_square,
    residuals,
    slopes_along,
    solve,
    weighed,
    with_finer_substeps,
    with_own_substeps,
)
from asrsim.identification.uncertainty import BLOCKS, uncertainty
from asrsim.metrics.values import root_mean_square
from asrsim.samples import Array

LEVELS = (8.0, 2.0, 0.5, 0.1)
"""Bandwidths of the observer, in units of the bandwidth of the motion. In a prototype study with recordings of five machines,
the start values were wrong by a factor of ten. Bandwidths from 0.25 to 8 led to the right minima, and bandwidths below 0.1 did
not.
"""
EVALUATIONS, TWICE = 10, 2
"""EVALUATIONS: largest number of evaluations of a search with an observer.
TWICE: number of searches with new weights at each level. The two numbers are from the prototype study of `LEVELS`.
"""
AGREES = 1.1
"""Two successive levels agree if the estimate of the faster level increases the mean square error at the slower level at most
by this factor. The RMS error then increases by at most 5 %. The value is from the prototype study of `LEVELS`.
"""
TIMED = 3
"""Number of steps of the Gauss-Newton method for the instants of jumps. The residuals are nearly linear in the instants, so
that few steps suffice.
"""
RISE = 2.0
"""Factor between the bandwidths of additional levels above the first one. It is so small that predictions of successive levels
cover similar times.
"""
CHANCE = (2.0 * (BLOCKS - 1)) ** -0.5
"""Standard error of the logarithm of a standard deviation that is estimated from tenths of a recording."""
ELSEWHERE = (0.1, 10.0, 0.01, 100.0)
"""If the predictions do not follow a channel, the search begins again with all stiffnesses multiplied by each of these factors:
one and two decades down and up. Start values of stiffnesses have the largest errors.
"""
SPRINGS = ("stiffness", "spring_k")
"""Words in the names of stiffnesses."""
DELAYS = ("delay", CLOCK)
"""Endings of the names of delays."""
COARSE = 0.2
"""Time-step error, as a fraction of a channel's noise, above which finer substeps are tried. At this fraction, the time-step
error adds 4 % to the mean square residual.
"""
FINER = 3
"""Largest number of times that the number of substeps is doubled."""
SLIGHT = 0.25
"""Change of an estimate, in standard deviations, that does not matter: it widens an interval of 95 % by a thirtieth."""


class Stopped(Exception):  # noqa: N818 - a request, not an error
    """Raised between evaluations when the user stops the fit."""


class OutOfTime(Stopped):
    """Raised between evaluations when the time limit of the fit is reached."""


@dataclass
class Best:
    """The best fit so far. It is stored outside the search, so that it is available after an interruption."""

    problem: FitProblem
    x: Array
    cost: float = np.inf
    slow: tuple[tuple[FitProblem, Array], ...] = ()
    """Problems and estimates of slow levels if the free simulation is not kept; errors of the model have the largest effect at
    slow levels. They are the free simulation or, if it does not follow the channels, the levels that follow the channels,
    slowest first.
    """
    rivals: tuple[Mapping[str, float], ...] = ()
    """Estimates, by name, with commands that are held between samples, if these explain the recordings as well."""

    def take(self, problem: FitProblem, x: Array) -> None:
        """Replace the fit."""
        self.problem, self.x, self.cost = problem, x, huber(residuals(problem, x))


def search(best: Best, begin: Callable[[str], None]) -> None:
    """Search level by level, and store the fit in `best`. begin: called with the name of each level."""
    # Search without staircases first. Far from the solution, a command that is played as a staircase might fit better by
    # chance.
    problem, found = best.problem.played(frozenset()), list[tuple[FitProblem, Array]]()
    begun = x = np.append(best.x, np.zeros(len(problem.layout) - len(best.x)))
    for level in (*(problem.distinct(LEVELS) if problem.observes else ()), 0.0):
        begin(_name(level))
        first = level == LEVELS[0]
        if not level and _likelihood((problem.observed(0.0), begun)) < _likelihood((problem.observed(0.0), x)):
            # Return to the start vector of the search. Short predictions may contain too little information, so that the search
            # moved away from a good start vector.
            x = begun
        problem, x = _solved(problem.observed(level), x, times=1 if first else TWICE)
        if first:
            if not follows(problem, x):
                starts = [problem.layout.scaled(np.zeros(len(x)), SPRINGS, factor) for factor in ELSEWHERE]
                problem, x = min([(problem, x), *(_solved(problem, start) for start in starts)], key=_likelihood)
            best.take(problem, x)
            # If a free simulation fits after a search from this estimate, the other levels are not needed.
            near = weighed(problem.observed(0.0), x)
            there = solve(near, x, rounds=EVALUATIONS)
            if fits(near, there):
                best.take(near, there)
                return
            problem, x = _solved(problem, x, times=1)
        found.append((problem, x))
        best.take(problem, x)
    if not fits(problem, x):
        _hold(best)
    free = extended(best.problem, best.x, (jumps, presliding), enough=fits)
    best.take(free.problem, free.x)
    most = free_run(free.problem, free.x)
    # If a free simulation follows only the training part, errors of the model have moved its estimates.
    followed = most.explained[0] == len(problem.whole.parts)
    agrees = followed and (all(_agree(*pair) for pair in pairwise(found)) or _transfers(free.problem, free.x))
    if agrees or not problem.observes or fits(free.problem, free.x):
        return
    # A level is a candidate only if it passes `reaches`. Short predictions may contain too little information: their estimates
    # may fail in a free simulation.
    runs = [(fit, free_run(*fit)) for fit in (found if followed else found[:-1])]
    levels = [_judged(fit, run) for fit, run in runs if run.reaches(most)]
    if not levels:
        return
    kept, level = min(_steady(levels), key=lambda one: one.run.error), LEVELS[0]
    rises = kept.problem is found[0][0]
    while rises and problem.can_rise(level := level * RISE):
        begin(_name(level))
        risen = _solved(kept.problem.observed(level), kept.x)
        run = free_run(*risen)
        levels.append(_judged(risen, run))
        rises = run.reaches(most) and levels[-1] in _steady(levels)
        kept = levels[-1] if rises else kept
    if kept.problem.playing.bandwidth > 0.0:
        best.slow = ((free.problem, free.x),) if followed else tuple(fit for fit in found[-2::-1] if follows(*fit))
        best.take(kept.problem, kept.x)


@dataclass(frozen=True, eq=False)
class _Level:
    """A level of the search, with the measures by which the level to keep is selected."""

    problem: FitProblem
    x: Array
    spread: Array
    """Standard deviations (n,) of the estimates, from the spread between tenths of the recordings, in the vector's units. They
    are nan for parameters without effect.
    """
    run: FreeRun
    """Free simulation with the estimates."""


def _judged(fit: tuple[FitProblem, Array], run: FreeRun) -> _Level:
    return _Level(*fit, uncertainty(*fit, quick=True).spread, run)


def _steady(levels: Sequence[_Level]) -> list[_Level]:
    """The levels whose estimates differ least between tenths of the recordings. They differ equally within chance."""
    entries = levels[0].problem.layout.entries
    # Leave out parameters of single recordings, such as initial positions, since they affect short predictions less.
    shared = [entry.track is None for entry in entries]
    # A spread above the size of the parameter only means that the parameter is unknown, so limit the spread to this size.
    most = [
        1.0 if entry.logarithmic else max(abs(entry.value(float(one.x[i]))) for one in levels) / entry.size or 1.0
        for i, entry in enumerate(entries)
    ]
    known = [np.log(np.clip(np.nan_to_num(one.spread, nan=np.inf), 1e-300, most))[shared] for one in levels]
    sums = [float(np.mean(one)) if len(one) else 0.0 for one in known]
    return [one for one, sum_ in zip(levels, sums, strict=True) if sum_ <= min(sums) + CHANCE]


def _name(level: float) -> str:
    return f"observer at {level:g} times the bandwidth of the motion" if level else "free simulation"


def _solved(problem: FitProblem, x: Array, times: int = TWICE) -> tuple[FitProblem, Array]:
    """Estimate from a search, and the problem with the weights and substeps that suit the start vector of the last search.
    times: number of searches if the problem has an observer.
    """
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


@dataclass(frozen=True)
class FreeRun:
    """How well a free simulation follows the whole recordings that are fitted."""

    explained: tuple[int, ...]
    """Numbers of channels that the simulation explains, at three limits: more than 50, 90 and 95 % of a channel's variance."""
    error: float
    """Logarithm of the RMS error, mean over the channels."""

    def reaches(self, other: FreeRun) -> bool:
        """Whether this simulation explains at least as many channels as another one, at each limit."""
        return all(own >= least for own, least in zip(self.explained, other.explained, strict=True))


def free_run(problem: FitProblem, x: Array) -> FreeRun:
    """Judgement of a free simulation of the whole recordings with these estimates."""
    found = differences(problem.observed(0.0).whole, x)
    explained = tuple(sum(explains(part, left, least) for part, left in found) for least in (FOLLOWED, ACCEPTABLE, ENOUGH))
    return FreeRun(explained, 0.5 * _unlikelihood(found) / len(found))


def _likelihood(fit: tuple[FitProblem, Array]) -> float:
    """Negative logarithm of the likelihood of predictions with unknown noise, per sample, up to a constant and a factor."""
    return _unlikelihood(differences(*fit))


def _unlikelihood(found: Differences) -> float:
    """Sum over the channels of the logarithms of their mean square errors."""
    sizes = [float(np.mean(left**2)) if np.isfinite(left).all() else np.inf for _, left in found]
    return float(np.sum(np.log(np.maximum(sizes, 1e-300))))


def _transfers(problem: FitProblem, x: Array) -> bool:
    """Whether a fit predicts the held-out parts as well as the fitted parts."""
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
    """Whether the residuals have isolated outliers. Consecutive large residuals are model errors, not outliers."""
    size = np.abs(values - np.median(values))
    far = size > 5.0 * np.median(size) / 0.6745
    alone = far[1:-1] & ~far[:-2] & ~far[2:]
    return float(np.mean(alone)) > 1e-3


def refined(problem: FitProblem, x: Array) -> Array:
    """Least-squares solution, from a start vector near the solution. The Huber loss is used if there are outliers."""
    return solve(problem, x, robust=has_outliers(residuals(problem, x)))


def settle(best: Best) -> None:
    """Adapt substeps and weights to the estimates. Add staircases, instants of jumps and pre-sliding friction if they are
    significant.
    """
    begun = best.problem, best.x
    _resolve(best)
    _refine_steps(best)
    smooth = best.problem.playing
    _hold(best)
    if best.problem.playing != smooth:
        _resolve(best)
    # Try these effects unless the residuals are negligible. If the recording has many samples, jumps and pre-sliding friction
    # may be significant although the residuals look like noise.
    found = extended(best.problem, best.x, (jumps, presliding), enough=is_explained)
    # Reject effects with which a free simulation explains fewer channels. Such effects may nevertheless improve short
    # predictions.
    if found.chosen and free_run(found.problem, found.x).reaches(free_run(best.problem, best.x)):
        best.problem, best.x, best.cost = found.problem, found.x, found.cost
        _resolve(best)
    # Short predictions may improve while a free simulation leaves the recording.
    if best.problem.playing.bandwidth > 0.0 and not free_run(best.problem, best.x).reaches(free_run(*begun)):
        best.problem, best.x = begun
    best.x = _timed(best.problem, best.x)


def _refine_steps(best: Best) -> None:
    """Double the number of substeps as long as the time-step error matters and the error of the fit falls significantly.
    Otherwise effects that the model does not lack would be adopted, since they explain the time-step error.
    """
    for _ in range(FINER if best.problem.tracks[0].door.exact_in_time else 0):
        problem, finer = best.problem, with_finer_substeps(best.problem)
        now = differences(problem, best.x)
        if are_negligible(now):
            return
        then = differences(finer, best.x)
        if not any(root_mean_square(new - old) > COARSE * part.noise for (part, old), (_, new) in zip(now, then, strict=True)):
            return
        x = refined(finer, best.x)
        left = residuals(finer, x)
        if not is_significant(mean_square(problem, best.x), float(np.mean(left**2)), max(independent_samples(left), 2.0)):
            return
        best.take(weighed(finer, x), x)


def _hold(best: Best) -> None:
    """Play the commands as staircases if that explains the recordings decisively better. A delay of half a sampling interval
    has nearly the same effect as a staircase. If the motions of the training part are too slow to distinguish the two, the
    held-out parts are also used.
    """
    problem, x, data = best.problem, best.x, [best.problem.tracks[i].data for i in best.problem.fitted]
    smooth = {one.key for own in data for one in own.commands if not one.hold and not one.is_motion}
    held = problem.played(problem.playing.staircases | smooth)
    if held.playing == problem.playing:
        return
    start = _sooner(problem, x)
    left, after, slopes = residuals(problem, x), residuals(held, start), jacobian(problem, x)
    inverse = np.linalg.pinv(slopes.T @ slopes)
    move = -inverse @ (slopes.T @ after)
    linear, samples = float(np.mean((after + slopes @ move) ** 2)), max(independent_samples(left), 2.0)
    gain = samples * float(np.log(np.mean(left**2) / max(linear, 1e-300)))
    moved = np.abs(move) > SLIGHT * np.sqrt(np.diag(inverse))
    estimated = [one.track is None and not one.key.endswith(DELAYS) for one in problem.layout.entries]
    if gain < -DECISIVE or _acts_early(problem, start + move) or (gain < DECISIVE and not (moved & estimated).any()):
        return
    there = refined(held, np.clip(start + move, *problem.layout.bounds))
    if abs(gain) < DECISIVE:
        wholes = [(one.whole, refined(one.whole, y)) for one, y in ((problem, x), (held, there))]
        smoothly, stepwise = (mean_square(*whole) for whole in wholes)
        gain = samples * len(residuals(*wholes[0])) / len(left) * float(np.log(smoothly / stepwise))
    if gain > DECISIVE:
        best.take(held, there)
    best.rivals = (held.layout.named(there),) if abs(gain) <= DECISIVE else ()


def _acts_early(problem: FitProblem, x: Array) -> bool:
    """Whether the delay of a command is below minus a quarter of a sampling interval. A staircase differs from a smooth command
    by half an interval.
    """
    delays = {f"{one.key}.delay": track.sampling for track in problem.tracks for one in track.data.commands}
    entries = zip(problem.layout.entries, x.tolist(), strict=True)
    return any(one.value(place) < -0.25 * delays[one.key] for one, place in entries if one.key in delays)


def _sooner(problem: FitProblem, x: Array) -> Array:
    """Vector in which the delays of the commands are shorter by half a sampling interval. If no delay of a command is free, the
    clock offset is shorter instead.
    """
    delays = {f"{one.key}.delay" for track in problem.tracks for one in track.data.commands}
    free = {one.key for one in problem.layout.entries} & delays or {CLOCK}
    shorter = x.copy()
    for i, entry in enumerate(problem.layout.entries):
        if entry.key in free:
            track = problem.tracks[problem.fitted[0] if entry.track is None else entry.track]
            shorter[i] -= 0.5 * track.sampling / entry.size
    return shorter


def _timed(problem: FitProblem, x: Array) -> Array:
    """Parameter vector in which the instants of jumps in held-out parts are fitted to these parts. The residuals are nearly
    linear in these instants.
    """
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
