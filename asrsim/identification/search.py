"""The search: least squares from several starts, over a growing horizon where one shot does not fit; then the substeps and
weights that the estimates ask for.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from asrsim.identification.balance import regressed
from asrsim.identification.causes import presliding, stairs
from asrsim.identification.extensions import Extended, extended
from asrsim.identification.judge import fits_noise, is_explained, rms
from asrsim.identification.problem import (
    ROUNDS,
    Problem,
    errors,
    huber,
    residuals,
    solve,
    with_own_substeps,
)
from asrsim.identification.setup import Setup
from asrsim.samples import Array

SHORT, GROWING = (0.2, 1.0), (0.08, 0.15, 0.25, 0.4, 0.65, 1.0)
"""Fractions of the training part, one after the other: swings stay within half a period of each other."""
NEARER = 0.5
"""Fraction of the start's cost that a start from regression may have: near the noise, its bias would mislead."""
AGREED = 2
"""Searches of a model that does not fit that must end alike."""
OUTLIER = 6.0
"""Robust standard deviations beyond which a residual is an outlier."""
SPREAD = 3.0
"""Factor by which starts are scattered."""


class Stopped(Exception):  # noqa: N818 - no error: the user has seen enough
    """Raised between evaluations when the user asks for the end."""


@dataclass
class Best:
    """The best fit so far: kept outside the search, so that it survives an interruption."""

    problem: Problem
    x: Array
    cost: float = np.inf
    how: str = "start"
    attempts: int = 0
    successes: int = 0
    """Searches that ended as near as the best."""

    def offer(self, found: Extended, how: str) -> None:
        """The end of another search."""
        self.attempts += 1
        near = np.isfinite(self.cost) and max(self.cost, found.cost) < 1.02 * min(self.cost, found.cost)
        if found.cost < self.cost * (1.0 - 1e-4):
            self.problem, self.x, self.cost, self.how = found.problem, found.x, found.cost, how
            self.successes = self.successes + 1 if near else 1
        elif near:
            self.successes += 1


def search(best: Best, setup: Setup, tell: Callable[[str], None]) -> None:
    """Try starts until one fits; `best` has the best of them at any time."""
    for number, (how, start, horizons) in enumerate(islice(_attempts(best, best.x.copy()), setup.task.starts)):
        tell(how)
        # Beside starts that are far off, commands played as stairs would fit better by chance.
        problem = best.problem.played(frozenset())
        x = np.append(start, np.zeros(len(problem.layout) - len(start)))
        for share in horizons:
            here, last = replace(problem, share=share), share == 1.0
            x = solve(here, x, tolerance=1e-5 if last else 1e-2, rounds=ROUNDS if last else 12)
            x = refined(here, x, ROUNDS) if last and has_outliers(residuals(here, x)) else x
        first = number == 0
        found = extended(
            problem, x, lambda wider, _, first=first: (*stairs(wider), *(presliding(wider, setup.robot) if first else ())),  # type: ignore[misc]
            enough=fits_noise,
        )  # fmt: skip
        best.offer(found, how)
        if fits_noise(best.problem, best.x):
            break


def _attempts(best: Best, start: Array) -> Iterator[tuple[str, Array, tuple[float, ...]]]:
    """Starts: the user's or that from regression, then scattered ones with losses divided otherwise."""
    generator = np.random.default_rng(0)
    how, first = _nearest(best.problem, start)
    yield how, first, SHORT
    yield f"{how}, horizon growing", first, GROWING
    layout = best.problem.layout
    start = np.append(start, np.zeros(len(layout) - len(start)))
    losses = [i for i, entry in enumerate(layout.entries) if any(word in entry.name for word in ("friction", "damping"))]
    number = 1
    while best.successes < AGREED:
        moved = best.x.copy() if number % 2 else start.copy()
        for i, entry in enumerate(layout.entries):
            if i in losses:
                # Friction that the motor has may belong to the link, and the other way round.
                size = max(entry.value(float(moved[i])), 0.3 * entry.parameter.size)
                moved[i] = entry.place(size * float(np.exp(generator.uniform(-1.0, 1.0) * np.log(2.0 * SPREAD))))
            elif number % 2 == 0:
                reach = np.log(SPREAD) if entry.parameter.logarithmic else 1.0
                moved[i] += generator.uniform(-reach, reach)
        yield f"scattered start {number}", np.clip(moved, *layout.bounds), SHORT if number % 2 else GROWING
        number += 1


def _nearest(problem: Problem, start: Array) -> tuple[str, Array]:
    """The user's start, or that from regression, whichever is nearer to the beginning of the recordings."""
    known, short = regressed(problem, start), replace(problem, share=SHORT[0])
    if known is not None and huber(residuals(short, known)) < NEARER * huber(residuals(short, start)):
        return "a start from regression", known
    return "the start", start


def has_outliers(values: Array) -> bool:
    """Whether single samples are far off: neighbours that are off together are the model's fault."""
    size = np.abs(values - np.median(values))
    far = size > 5.0 * np.median(size) / 0.6745
    alone = far[1:-1] & ~far[:-2] & ~far[2:]
    return float(np.mean(alone)) > 1e-3


def refined(problem: Problem, x: Array, rounds: int) -> Array:
    """Least squares from a vector near the end; outliers count by Huber's loss."""
    return solve(problem, x, robust=has_outliers(residuals(problem, x)), rounds=rounds)


def settle(best: Best, setup: Setup) -> None:
    """The substeps of a run with the estimates, weights from the residuals, and pre-sliding if recordings ask for it."""
    _resolve(best)
    # Many samples show pre-sliding even where the residuals look like noise.
    found = extended(best.problem, best.x, lambda wider, _: presliding(wider, setup.robot), enough=is_explained)
    if found.chosen:
        best.problem, best.x, best.cost = found.problem, found.x, found.cost
        _resolve(best)


def _resolve(best: Best) -> None:
    for _ in range(3):
        resolved = with_own_substeps(best.problem, best.x)
        if resolved is best.problem:
            break
        best.problem, best.x = resolved, refined(resolved, best.x, 20)
    best.problem, best.x = _reweighted(best.problem, best.x)


def _reweighted(problem: Problem, x: Array) -> tuple[Problem, Array]:
    """Once more with each channel's noise as its residuals show it."""
    found = [*problem.weights]
    for track in problem.fitted:
        found[track] = tuple(map(noise_of_residuals, errors(problem, x, track) or [np.ones(1)]))
    weighted = replace(problem, weights=tuple(found))
    return weighted, refined(weighted, x, 15)


def noise_of_residuals(left: Array) -> float:
    """Root mean square of residuals (n,) without outliers; an offset of all of them is no outlier, and counts."""
    away = np.abs(left - np.median(left))
    return max(rms(left[away <= OUTLIER * float(np.median(away)) / 0.6745 + 1e-300]), 1e-12)
