"""What follows a search: substeps as its numbers ask for, bristles of friction where recordings do, weights of what is left."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from asrsim.identification.between import timed
from asrsim.identification.bristles import with_bristles
from asrsim.identification.fit import NEARLY, Best, fits_noise, left_of
from asrsim.identification.intervals import whitened
from asrsim.identification.noise import lag_correlation
from asrsim.identification.residuals import Residuals, Weights
from asrsim.identification.setup import Setup
from asrsim.identification.solver import cost_of, solve
from asrsim.identification.steps import ROUNDS, followed, refined
from asrsim.identification.task import Task
from asrsim.samples import Array

ALIKE = 0.05
"""Of the mean square error, at most, that weights by correlated noise may cost: more, and what is correlated is the model's
fault."""


def settle(residuals: Residuals, best: Best, setup: Setup) -> None:
    """With the substeps of a run with these numbers, or as fine ones as the recordings ask for, and weights of what is left."""
    for _ in range(ROUNDS):
        if not followed(residuals, best.x, setup.tracks):
            break
        best.x = solve(residuals, best.x, loss="linear", rounds=20)
    best.x, best.substeps = refined(residuals, best.x, setup.tracks)
    best.x = reweighted(residuals, best.x, setup.task)


def bristled(residuals: Residuals, best: Best, setup: Setup, share: float) -> bool:
    """Free bristles of the motors' friction, too, where recordings ask for it; whether they do, and at most a share of the cost
    is left.
    """
    layout, x = with_bristles(residuals, best.x, setup.robot)
    if len(x) == len(best.x):
        return False
    narrow, residuals.layout = residuals.layout, layout
    followed(residuals, x, setup.tracks)
    x = solve(residuals, x, loss=setup.task.loss)
    cost = cost_of(residuals(x), setup.task.loss)
    if cost > share * best.cost:
        residuals.layout = narrow
        followed(residuals, best.x, setup.tracks)
        return False
    setup.layout, best.x, best.cost = layout, x, cost
    return True


def widened(residuals: Residuals, best: Best, setup: Setup) -> bool:
    """Free what recordings ask for beside the parameters: times of jumps, or bristles of the motors' friction. Whether they do.

    Each may explain a part of what is the other's: first what leaves less, and the other only where that is not all.
    """
    ways: tuple[Callable[[], bool], ...] = (
        lambda: timed(residuals, best, setup),
        lambda: bristled(residuals, best, setup, NEARLY),
    )
    narrow = setup.layout, best.x, best.cost
    found = []
    for number, way in enumerate(ways):
        if not way():
            continue
        if fits_noise(left_of(residuals, best.x)):
            return True
        found.append((best.cost, number, setup.layout, best.x))
        residuals.layout = setup.layout = narrow[0]
        best.x, best.cost = narrow[1:]
        followed(residuals, best.x, setup.tracks)
    if not found:
        return False
    best.cost, number, setup.layout, best.x = min(found, key=lambda one: one[0])
    residuals.layout = setup.layout
    followed(residuals, best.x, setup.tracks)
    if len(found) > 1:
        ways[1 - number]()
    return True


def reweighted(residuals: Residuals, x: Array, task: Task) -> Array:
    """Once more with each channel's noise and its correlation as they are left over.

    Whitening is right for noise that is correlated; where the model is wrong it would give weight to what the model does best.
    """
    before = residuals.weights
    residuals.weights = whitened(residuals, x)
    there = solve(residuals, x, loss=task.loss, rounds=15)
    better = float(np.mean(residuals(there) ** 2)) <= float(np.mean(residuals(x) ** 2)) * (1.0 + 1e-9)
    weights = residuals.weights
    residuals.weights = before
    # Of so many independent samples, a fit without these weights explains a part by chance.
    left = np.concatenate([one for track in range(len(residuals.tracks)) for one in residuals.raw(x, track) or [np.zeros(1)]])
    correlation = min(max(lag_correlation(left), 0.0), 1.0 - 1e-6)
    chance = 2.0 * len(x) / (len(left) * (1.0 - correlation) / (1.0 + correlation))
    limit = 1.0 + min(max(chance, 0.01), ALIKE)
    if better and cost_of(residuals(there), task.loss) <= limit * cost_of(residuals(x), task.loss):
        residuals.weights = weights
        return there
    residuals.weights = [
        [Weights(float(np.sqrt(np.mean(r**2)))) for r in residuals.raw(x, track, residuals.until(track)) or []]
        for track in range(len(residuals.tracks))
    ]  # fmt: skip
    # A search that was far from the noise has not gone to the end.
    return solve(residuals, x, loss="linear", rounds=10)
