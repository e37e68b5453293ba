"""The search: least squares from several starts, over a growing horizon where one shot does not fit; and what follows it,
substeps as the numbers found ask for, and weights of what is left.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from asrsim.identification.causes import jumps, jumps_or_bristles, stairs
from asrsim.identification.data import Channel
from asrsim.identification.extensions import Extended, extended
from asrsim.identification.noise import beyond_steps, independent_samples, is_nothing, lag_correlation, size_of, swings
from asrsim.identification.problem import (
    ROUNDS,
    Problem,
    Weights,
    cost_of,
    errors,
    mean_square,
    residuals,
    solve,
    with_own_substeps,
)
from asrsim.identification.regression import regressed
from asrsim.identification.setup import Setup
from asrsim.identification.task import Task
from asrsim.identification.uncertainty import whitened
from asrsim.samples import Array

SHORT, GROWING = (0.2, 1.0), (0.08, 0.15, 0.25, 0.4, 0.65, 1.0)
"""Shares of the training part, one after the other: swings stay within half a period of each other."""
NEARER = 0.5
"""Share of the start's cost that one from regression may have: where noise is most of it, its bias would lead astray."""
FITS, SURE = 1.25, 2.0
"""Deviations, in those of the noise's fine structure, up to which errors may be noise; what a single sample adds to these."""
WHITE = 0.3
"""Correlation of neighbouring errors below which they may be noise."""
AGREED = 2
"""Searches that end alike, of a model that does not fit."""
ALIKE = 0.05
"""Of the mean square error, at most, that weights by correlated noise may cost: more, and what is correlated is the model's
fault.
"""


class Stopped(Exception):  # noqa: N818 - no error: the user has seen enough
    """Raised between evaluations when the user asks for the end."""


@dataclass
class Best:
    """What is best so far: kept outside the search, so that it survives its end."""

    problem: Problem
    x: Array
    cost: float = np.inf
    how: str = "start"
    attempts: int = 0
    successes: int = 0
    """Searches that ended as near as the best."""

    def offer(self, found: Extended, how: str) -> None:
        """Another end."""
        self.attempts += 1
        near = np.isfinite(self.cost) and max(self.cost, found.cost) < 1.02 * min(self.cost, found.cost)
        if found.cost < self.cost * (1.0 - 1e-4):
            self.problem, self.x, self.cost, self.how = found.problem, found.x, found.cost, how
            self.successes = self.successes + 1 if near else 1
        elif near:
            self.successes += 1


def search(best: Best, setup: Setup, tell: Callable[[str], None]) -> None:
    """Try starts until one fits; `best` has the best of them at any time."""
    task, first = setup.task, best.x.copy()
    for number, (how, start, horizons) in enumerate(islice(_attempts(best, first, task.spread, task.seed), task.starts)):
        tell(how)
        # Only a start's own end tells whether stairs are nearer: beside others that are far off, they seem so by chance.
        problem = best.problem.played(frozenset())
        x = np.append(start, np.zeros(len(problem.layout) - len(start)))
        for share in horizons:
            here, last = replace(problem, share=share), share == 1.0
            x = solve(here, x, tolerance=1e-5 if last else 1e-2, rounds=ROUNDS if last else 12)
            if last and task.loss != "linear" and _tails(residuals(here, x)):
                x = solve(here, x, loss=task.loss, tolerance=1e-5)
        # Stairs first: jumps between samples explain a part of them.
        found = extended(problem, x, stairs, loss=task.loss, enough=fits_noise)
        if not number:
            found = extended(found.problem, found.x, jumps_or_bristles(setup.robot), loss=task.loss, enough=fits_noise)
        best.offer(found, how)
        if fits_noise(best.problem, best.x):
            break


def with_jumps_of_whole_recordings(best: Best, task: Task) -> None:
    """Times of jumps in what is held out, too: when they came is nothing that a model could predict."""
    found = extended(best.problem.whole, best.x, jumps, loss=task.loss, enough=fits_noise)
    if found.chosen:
        best.problem = best.problem.under(found.problem.layout)
        best.x = np.append(best.x, found.x[len(best.x) :])


def _attempts(best: Best, start: Array, spread: float, seed: int) -> Iterator[tuple[str, Array, tuple[float, ...]]]:
    """Starts: the user's or that from regression, then scattered ones, with losses divided otherwise."""
    generator = np.random.default_rng(seed)
    how, first = _nearest(best.problem, start)
    yield how, first, SHORT
    yield f"{how}, horizon growing", first, GROWING
    layout = best.problem.layout
    start = np.append(start, np.zeros(len(layout) - len(start)))
    losses = [i for i, entry in enumerate(layout.entries) if any(word in entry.name for word in ("friction", "damping"))]
    number = 1
    # Two ways to one end: others would hardly lead elsewhere.
    while best.successes < AGREED:
        moved = best.x.copy() if number % 2 else start.copy()
        for i, entry in enumerate(layout.entries):
            if i in losses:
                # Friction that sits on the motor may belong to the link, and the other way round.
                size = max(entry.value(float(moved[i])), 0.3 * entry.parameter.size)
                moved[i] = entry.place(size * float(np.exp(generator.uniform(-1.0, 1.0) * np.log(2.0 * spread))))
            elif number % 2 == 0:
                reach = np.log(spread) if entry.parameter.logarithmic else 1.0
                moved[i] += generator.uniform(-reach, reach)
        yield f"scattered start {number}", np.clip(moved, *layout.bounds), SHORT if number % 2 else GROWING
        number += 1


def _nearest(problem: Problem, start: Array) -> tuple[str, Array]:
    """The user's start, or that from regression, whichever is nearer to the beginning of what was recorded."""
    known, short = regressed(problem, start), replace(problem, share=SHORT[0])
    if known is not None and cost_of(residuals(short, known), "huber") < NEARER * cost_of(residuals(short, start), "huber"):
        return "a start from regression", known
    return "the start", start


def _tails(values: Array) -> bool:
    """Whether single samples are far off: neighbours that are off together are the model's fault."""
    size = np.abs(values - np.median(values))
    far = size > 5.0 * np.median(size) / 0.6745
    alone = far[1:-1] & ~far[:-2] & ~far[2:]
    return float(np.mean(alone)) > 1e-3


# -- what is left ------------------------------------------------------------------------------------------------------------


def _left(problem: Problem, x: Array) -> Iterator[tuple[Channel, Array | None]]:
    """Channels with what is left of each, up to the end of what counts; None where the motion is not sane."""
    for number in problem.fitted:
        left = errors(problem, x, number)
        channels = problem.tracks[number].channels
        yield from zip(channels, [None] * len(channels) if left is None else left, strict=True)


def fits_noise(problem: Problem, x: Array) -> bool:
    """Whether what is left looks like noise in every channel of every recording, or nothing is left."""
    for channel, left in _left(problem, x):
        if left is None:
            return False
        # Steps of an encoder swing with the motion.
        ringing = not channel.quantum and swings(left)
        beyond, borne = beyond_steps(left, channel.values[: len(left)], channel.quantum)
        odd = ringing or is_loud(beyond, channel.floor) or abs(lag_correlation(beyond) - borne) > WHITE
        if odd and not is_nothing(size_of(left), channel.noise):
            return False
    return True


def is_explained(problem: Problem, x: Array) -> bool:
    """Whether nothing is left of any channel, as of a simulation's own log."""
    return all(left is not None and is_nothing(size_of(left), channel.noise) for channel, left in _left(problem, x))


def is_loud(left: Array, noise: float) -> bool:
    """Whether errors (n,) are more than a noise that as many samples told."""
    return bool(size_of(left) > (FITS + SURE / max(len(left), 1) ** 0.5) * noise)


# -- what follows a search ---------------------------------------------------------------------------------------------------


def settle(best: Best, setup: Setup) -> None:
    """With the substeps of a run with these numbers, and weights of what is left."""
    for _ in range(3):
        resolved = with_own_substeps(best.problem, best.x)
        if resolved is best.problem:
            break
        best.problem, best.x = resolved, solve(resolved, best.x, rounds=20)
    best.problem, best.x = _reweighted(best.problem, best.x, setup.task.loss)


def _reweighted(problem: Problem, x: Array, loss: str) -> tuple[Problem, Array]:
    """Once more with each channel's noise and its correlation as they are left over.

    Whitening is right for noise that is correlated; where the model is wrong it would give weight to what the model does best.
    """
    white = replace(problem, weights=whitened(problem, x))
    there = solve(white, x, loss=loss, rounds=15)
    better = mean_square(white, there) <= mean_square(white, x) * (1.0 + 1e-9)
    left = [errors(problem, x, track) or [np.ones(1)] for track in problem.fitted]
    everything = np.concatenate([one for track in left for one in track])
    # Of so many independent samples, a fit without these weights explains a part by chance.
    limit = 1.0 + min(max(2.0 * len(x) / independent_samples(everything), 0.01), ALIKE)
    if better and cost_of(residuals(problem, there), loss) <= limit * cost_of(residuals(problem, x), loss):
        return white, there
    plain = [tuple(Weights(float(np.sqrt(np.mean(one**2)))) for one in track) for track in left]
    found = replace(problem, weights=(*plain, *problem.weights[len(plain) :]))
    # A search that was far from the noise has not gone to the end.
    return found, solve(found, x, rounds=10)
