"""The search: least squares from several start vectors, for some starts with a growing fitted part of the recording. Substeps
and weights are then adapted to the estimates.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from asrsim.identification.extensions import Extended, extended, presliding, stairs
from asrsim.identification.judge import fits_noise, is_explained
from asrsim.identification.noise import size_of
from asrsim.identification.problem import (
    ROUNDS,
    Problem,
    differences,
    residuals,
    solve,
    with_own_substeps,
)
from asrsim.samples import Array

SHORT, GROWING = (0.2, 1.0), (0.08, 0.15, 0.25, 0.4, 0.65, 1.0)
"""Successive fractions of the training part that are fitted. The growth is slow enough that predicted and recorded oscillations
differ by less than half a period.
"""
AGREED = 2
"""Number of searches that must reach the same minimum before the search ends, if the model does not fit."""
SPREAD = 3.0
"""Factor by which start values are scattered."""


class Stopped(Exception):  # noqa: N818 - a request, not an error
    """Raised between evaluations when the user stops the fit."""


class OutOfTime(Stopped):
    """Raised between evaluations when the time of the fit is over."""


@dataclass
class Best:
    """The best fit so far, stored outside the search so that the fit survives an interruption."""

    problem: Problem
    x: Array
    cost: float = np.inf
    attempts: int = 0
    successes: int = 0
    """Number of searches that reached the smallest cost."""

    def offer(self, found: Extended) -> None:
        """Store the result of a search if it is the best fit so far."""
        self.attempts += 1
        better = found.cost < self.cost * (1.0 - 1e-4)
        if max(self.cost, found.cost) < 1.02 * min(self.cost, found.cost):
            self.successes += 1
        elif better:
            self.successes = 1
        if better:
            self.problem, self.x, self.cost = found.problem, found.x, found.cost


def search(best: Best, starts: int, begin: Callable[[str], None]) -> None:
    """Search from at most this number of starts until the model fits, and store the best fit in `best`.

    begin: called with the name of each start.
    """
    for how, start, horizons in islice(_attempts(best, best.x.copy()), starts):
        begin(how)
        # Far from the solution, staircase commands might fit better by chance.
        problem = best.problem.played(frozenset())
        x = np.append(start, np.zeros(len(problem.layout) - len(start)))
        for share in horizons:
            here, last = replace(problem, share=share), share == 1.0
            x = solve(here, x, tolerance=1e-5 if last else 1e-2, rounds=ROUNDS if last else 12)
            x = refined(here, x, ROUNDS) if last and has_outliers(residuals(here, x)) else x
        kinds = (stairs,) if best.attempts else (stairs, presliding)
        best.offer(extended(problem, x, kinds, enough=fits_noise))
        if fits_noise(best.problem, best.x):
            break


def _attempts(best: Best, start: Array) -> Iterator[tuple[str, Array, tuple[float, ...]]]:
    """Start vectors of the search: the user's start, then scattered starts that divide friction and damping differently among
    motor and link.
    """
    generator = np.random.default_rng(0)
    yield "the start", start, SHORT
    yield "the start, horizon growing", start, GROWING
    layout = best.problem.layout
    start = np.append(start, np.zeros(len(layout) - len(start)))
    number = 1
    while best.successes < AGREED:
        moved = best.x.copy() if number % 2 else start.copy()
        for i, entry in enumerate(layout.entries):
            if any(word in entry.name for word in ("friction", "damping")):
                # Friction may be attributed to the motor instead of the link, or vice versa.
                size = max(entry.value(float(moved[i])), 0.3 * entry.size)
                moved[i] = entry.place(size * float(np.exp(generator.uniform(-1.0, 1.0) * np.log(2.0 * SPREAD))))
            elif number % 2 == 0:
                reach = np.log(SPREAD) if entry.logarithmic else 1.0
                moved[i] += generator.uniform(-reach, reach)
        yield f"scattered start {number}", np.clip(moved, *layout.bounds), SHORT if number % 2 else GROWING
        number += 1


def has_outliers(values: Array) -> bool:
    """Whether the residuals have isolated outliers; consecutive large residuals are model errors."""
    size = np.abs(values - np.median(values))
    far = size > 5.0 * np.median(size) / 0.6745
    alone = far[1:-1] & ~far[:-2] & ~far[2:]
    return float(np.mean(alone)) > 1e-3


def refined(problem: Problem, x: Array, rounds: int) -> Array:
    """Least-squares solution, from a start vector near the solution; with the Huber loss if there are outliers."""
    return solve(problem, x, robust=has_outliers(residuals(problem, x)), rounds=rounds)


def settle(best: Best) -> None:
    """Adapt substeps and weights to the estimates, and add pre-sliding friction if it is significant."""
    _resolve(best)
    # With many samples, pre-sliding is significant even if the residuals look like noise.
    found = extended(best.problem, best.x, (presliding,), enough=is_explained)
    if found.chosen:
        best.problem, best.x, best.cost = found.problem, found.x, found.cost
        _resolve(best)


def _resolve(best: Best) -> None:
    """Adapt substeps and weights to the estimates."""
    for _ in range(3):
        resolved = with_own_substeps(best.problem, best.x)
        if resolved is best.problem:
            break
        best.problem, best.x = resolved, refined(resolved, best.x, 20)
    # Weight the channels by the noise in their residuals. A recording whose simulation diverges keeps its weights.
    found: dict[int, list[float]] = {}
    for part, left in differences(best.problem, best.x):
        size = max(size_of(left), 1e-12) if np.isfinite(left).all() else part.noise
        found.setdefault(part.track, []).append(size)
    weights = tuple(tuple(found.get(track, known)) for track, known in enumerate(best.problem.weights))
    best.problem = replace(best.problem, weights=weights)
    best.x = refined(best.problem, best.x, 15)
