"""What finer substeps would make of a fit's estimates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from asrsim.identification.problem import Problem, residuals
from asrsim.identification.told import percent
from asrsim.identification.uncertainty import Uncertainty
from asrsim.samples import Array

FINER = 4
"""Times as many substeps, against which an estimate is held."""
SAID = 2.0
"""Deviations from which on it is said what substeps do to an estimate."""


def _finer(problem: Problem, factor: int) -> Problem:
    playing = [replace(one, substeps=(factor * one.substeps[0], one.substeps[1])) for one in problem.playing]
    return replace(problem, playing=tuple(playing))


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
