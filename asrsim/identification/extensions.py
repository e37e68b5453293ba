"""Extensions of a model: they are proposed, freed together with the other parameters, refitted and scored."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from asrsim.identification.keys import Parameter
from asrsim.identification.layout import entry_of
from asrsim.identification.noise import independent_samples
from asrsim.identification.problem import Problem, huber, jacobian, residuals, solve, with_own_substeps
from asrsim.identification.task import Tie
from asrsim.samples import Array

ASKED = 20.0
"""Chi squared above which an extension is significant: noise alone exceeds it with a probability of 1e-5."""
TRIED, ADOPTED = 4, 4
"""Largest number of extensions that are refitted in a round, the most promising first; largest number of extensions that are
adopted.
"""
LOOK = 1e-3
"""Step of finite differences along a new entry of the parameter vector, in the vector's units."""
FAR_OFF = 4.0
"""Mean square residual, relative to the noise, above which a model counts as badly fitting."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Extension:
    """A problem with additional free parameters at the end of its parameter vector, or with commands played as a staircase."""

    text: str = ""
    problem: Problem
    begins: Sequence[float | Sequence[float]] = ()
    """Start values of the new entries of the parameter vector, at which the effect of the extension is simulated; empty: the
    start is the optimum of the linearised problem.
    """
    restepped: bool = False
    """Whether the extension changes the required number of substeps."""
    share: float = 1.0
    """Largest fraction of the mean square error that may remain with the extension."""
    excess: float = 1.0
    """Largest fraction of the misfit beyond the noise that may remain with the extension if the model fits badly. In a badly
    fitting model any additional parameter reduces the misfit.
    """

    def accepts(self, before: float, after: float, samples: float) -> bool:
        """Whether mean square errors before and after, from independent samples, show that the extension is real."""
        far = before > FAR_OFF and after - 1.0 > self.excess * (before - 1.0)
        return bool(not far and after <= self.share * before and samples * np.log(before / max(after, 1e-300)) > ASKED)


class _Place:
    """The point of the parameter space at which extensions are compared, with residuals and derivatives."""

    def __init__(self, problem: Problem, x: Array) -> None:
        self.x, self.there = x, residuals(problem, x)
        self._free = np.linalg.qr(jacobian(problem, x, base=self.there))[0]
        self._left = self.alone(self.there)

    def alone(self, change: Array) -> Array:
        """Part of a change (m,) or (m, k) of the residuals that the free parameters cannot compensate."""
        return np.asarray(change - self._free @ (self._free.T @ change))

    def promises(self, extension: Extension) -> Iterator[tuple[float, Extension, Array]]:
        """Fraction of the squared error that an extension would explain to first order, and start vector for a refit with the
        extension.
        """
        from scipy.optimize import lsq_linear

        new, (low, high) = range(len(self.x), len(extension.problem.layout)), extension.problem.layout.bounds
        for begin in extension.begins or [(0.0,) * len(new)]:
            start, trial = np.append(self.x, begin), extension.problem
            trial = with_own_substeps(trial, start) if extension.restepped else trial
            if extension.begins:
                change, limits = (residuals(trial, start) - self.there)[:, None], (np.zeros(1), np.full(1, np.inf))
            else:
                change = jacobian(trial, start, LOOK, base=self.there, columns=new)
                limits = np.minimum(low[new], -1e-9), high[new]
            alone = self.alone(change)
            moves = lsq_linear(alone, -self._left, bounds=limits).x if alone.any() else np.zeros(alone.shape[1])
            start = start if extension.begins else np.append(self.x, moves)
            yield self._share(alone @ moves), replace(extension, problem=trial), start

    def _share(self, change: Array) -> float:
        """Fraction of the squared error that a change of the residuals explains; 0 if the fraction is not significant."""
        before, after = float(self._left @ self._left), float(np.sum((self._left + change) ** 2))
        return 1.0 - after / before if (before - after) * len(change) > ASKED * after else 0.0


@dataclass(frozen=True, eq=False)
class Extended:
    """A problem with the adopted extensions, and the fitted parameter vector."""

    chosen: tuple[Extension, ...]
    problem: Problem
    x: Array
    cost: float
    """Mean of the Huber loss of the residuals."""


Propose = Callable[[Problem, Array], Iterable[Extension]]


def extended(
    problem: Problem, x: Array, propose: Propose, *, enough: Callable[[Problem, Array], bool], most: int = ADOPTED,
    rounds: int = 60,
) -> Extended:  # fmt: skip
    """Problem with added extensions: the most explanatory is added first, until `enough` is true or no further extension is
    significant.
    """
    found = Extended((), problem, x, huber(residuals(problem, x)))
    while len(found.chosen) < most and not enough(found.problem, found.x):
        place, proposed = _Place(found.problem, found.x), list(propose(found.problem, found.x))
        promised = [max(place.promises(one), key=lambda promise: promise[0]) for one in proposed]
        trials = []
        for share, extension, start in sorted(promised, key=lambda promise: -promise[0])[:TRIED]:
            if not share:
                continue
            there = solve(extension.problem, start, rounds=rounds, tolerance=1e-5)
            left = residuals(extension.problem, there)
            if extension.accepts(found.cost, huber(left), independent_samples(left)):
                trials.append((huber(left), extension, there))
        if not trials:
            break
        cost, extension, there = min(trials, key=lambda trial: trial[0])
        found = Extended((*found.chosen, extension), extension.problem, there, cost)
    return found


def freed(
    problem: Problem, parameters: Sequence[Parameter], ties: Sequence[Tie] = (), *, tracks: Sequence[int | None] = (None,)
) -> Problem:
    """Problem with additional free parameters. tracks: recordings that get separate values; None: all recordings
    share a value.
    """
    layout, names = problem.layout, [track.data.name for track in problem.tracks]
    entries = [entry_of(one, track, names) for one in parameters for track in tracks]
    return problem.under(replace(layout, entries=(*layout.entries, *entries), ties=(*layout.ties, *ties)))
