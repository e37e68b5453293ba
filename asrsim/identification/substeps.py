"""Substeps of a fit: finer ones where a recording is more exact than runs; what still finer ones would make of estimates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from asrsim.identification.problem import Problem, jacobian, mean_square, residuals, solve
from asrsim.identification.told import percent
from asrsim.identification.uncertainty import Uncertainty, noise_of
from asrsim.samples import Array

FINER = 4
"""Times as many substeps, against which an estimate is held."""
COARSE, FINEST = 0.3, 8
"""Deviations of an estimate that substeps may move it, and how many times as many there are for that, at most."""
WORSE = 1.5
"""Times what is left otherwise, as a mean square, from which on finer substeps explain a recording less."""
SAID = 2.0
"""Deviations from which on it is said what substeps do to an estimate."""


def _finer(problem: Problem, factor: int) -> Problem:
    playing = [replace(one, substeps=(factor * one.substeps[0], one.substeps[1])) for one in problem.playing]
    return replace(problem, playing=tuple(playing))


def refined(problem: Problem, x: Array) -> tuple[Problem, Array, dict[str, int]]:
    """With substeps so fine that their errors move no estimate by much of its deviation, and these as a scenario has them.

    The same and nothing where those of runs suffice, where the scenario gives its own, or where finer ones explain less: then
    the recording is a simulation's, made with these.
    """
    if not problem.tracks[0].door.own_substeps or not len(x):
        return problem, x, {}
    before = residuals(problem, x)
    slopes = jacobian(problem, x, base=before)
    inverse = np.asarray(np.linalg.pinv(slopes.T @ slopes), dtype=np.float64)
    noise, _ = noise_of(problem, before, slopes)
    deviation = np.sqrt(np.maximum(np.diag(inverse @ noise @ inverse), 1e-300))
    worst = float(np.max(np.abs(_shift(problem, x, inverse, slopes)) / deviation))
    factor = next((2**k for k in range(4) if worst <= COARSE * 2**k), FINEST)
    if factor == 1:
        return problem, x, {}
    finer = _finer(problem, factor)
    there = solve(finer, x, rounds=20)
    if mean_square(finer, there) > WORSE * float(np.mean(before**2)):
        return problem, x, {}
    most = max(one.substeps for one in finer.playing)
    return finer, there, {"substeps": most[0], "motor_substeps": most[1]}


def _shift(problem: Problem, x: Array, inverse: Array, slopes: Array) -> Array:
    """(n,) by which infinitely fine substeps would move the estimate, from a run with more of them.

    Errors are taken to be of first order, as they are where joints stick.
    """
    change = residuals(_finer(problem, FINER), x) - residuals(problem, x)
    return np.asarray(-inverse @ (slopes.T @ change) / (1.0 - 1.0 / FINER))


def with_substeps(problem: Problem, x: Array, found: Uncertainty) -> tuple[Uncertainty, str]:
    """The same with deviations that hold what finer substeps would make of the estimates; and what is said of those that this
    widens much.
    """
    if not problem.tracks[0].door.exact_in_time:
        return found, ""
    shift = _shift(problem, x, found.inverse, found.jacobian)
    values, slopes = problem.layout.values(x), problem.layout.slopes(x)
    with np.errstate(invalid="ignore"):
        said = (np.abs(shift) > SAID * found.deviation) & (values != 0.0)
    moved = ", ".join(
        f"{problem.layout.entries[i].name} by {percent(shift[i] * slopes[i] / values[i], '+')}"
        for i in np.flatnonzero(said).tolist()
    )
    found = found.with_deviation(np.hypot(found.deviation, shift), found.quantile)
    text = f"intervals are wider by what finer substeps would make of {moved}: `substeps:` in the scenario sets them"
    return found, text if moved else ""
