"""Extensions of a model: proposed, freed beside the other parameters, refitted and scored."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from asrsim.identification.keys import Parameter
from asrsim.identification.layout import Entry
from asrsim.identification.noise import independent_samples
from asrsim.identification.problem import Problem, huber, jacobian, residuals, solve, with_own_substeps
from asrsim.identification.task import Tie
from asrsim.samples import Array

ASKED = 20.0
"""Chi squared of one number from which on recordings ask for it: noise alone reaches it one time in a hundred thousand."""
TRIED, ADOPTED = 4, 4
"""Extensions that are refitted in a round, those that promise most; extensions that are adopted in all."""
LOOK = 1e-3
"""Step of a difference along a new entry, in the vector's units."""
FAR_OFF = 4.0
"""Mean square, in the noise's, of a model that is wrong in more than a detail."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Extension:
    """A problem in which more is free, at the end of its vector, or commands are played otherwise."""

    text: str = ""
    flags: str = ""
    """Options of `asrsim identify` that ask for it."""
    problem: Problem
    begins: tuple[float, ...] = ()
    """Values of the new entry at which its search may begin; none: where slopes lead."""
    finite: bool = False
    """Simulate where it begins: slopes say nothing about it."""
    restepped: bool = False
    """It changes how finely a simulation must be stepped."""
    share: float = 1.0
    """Largest fraction of the mean square that it may leave."""
    excess: float = 1.0
    """Largest fraction of the misfit beyond the noise that it may leave of a model that is far off: there, any number explains
    a part.
    """

    def accepts(self, before: float, after: float, samples: float) -> bool:
        """Whether mean squares without and with it, from so many independent samples, show that it is there."""
        far = before > FAR_OFF and after - 1.0 > self.excess * (before - 1.0)
        return bool(not far and after <= self.share * before and samples * np.log(before / max(after, 1e-300)) > ASKED)


class _Place:
    """A vector beside which extensions are compared."""

    def __init__(self, problem: Problem, x: Array) -> None:
        self.x, self.there = x, residuals(problem, x)
        self._free = np.linalg.qr(jacobian(problem, x, base=self.there))[0]
        self._left = self.alone(self.there)

    def alone(self, change: Array) -> Array:
        """The part of a change (m,) or (m, k) of the residuals that the parameters cannot make good."""
        return np.asarray(change - self._free @ (self._free.T @ change))

    def promises(self, extension: Extension) -> Iterator[tuple[float, Extension, Array]]:
        """Fraction of the squared error that an extension would explain if slopes hold, and the start of its refit."""
        from scipy.optimize import lsq_linear

        n, layout = len(self.x), extension.problem.layout
        if extension.finite:
            for begin in [[one] for one in extension.begins] or [[]]:
                start = np.append(self.x, begin)
                trial = with_own_substeps(extension.problem, start) if extension.restepped else extension.problem
                alone = self.alone(residuals(trial, start) - self.there)
                amount = max(-float(alone @ self._left) / max(float(alone @ alone), 1e-300), 0.0)
                yield self._share(amount * alone), replace(extension, problem=trial), start
            return
        nowhere, new = np.append(self.x, np.zeros(len(layout) - n)), range(n, len(layout))
        alone = self.alone(jacobian(extension.problem, nowhere, LOOK, base=self.there, columns=new))
        low, high = (bound[n:] for bound in layout.bounds)
        moves = lsq_linear(alone, -self._left, bounds=(np.minimum(low, -1e-9), high)).x if alone.any() else np.zeros(len(new))
        yield self._share(alone @ moves), extension, np.append(self.x, extension.begins[:1] or moves)

    def _share(self, change: Array) -> float:
        """Fraction of the squared error that a change explains; 0 where that may be chance."""
        before, after = float(self._left @ self._left), float(np.sum((self._left + change) ** 2))
        return 1.0 - after / before if (before - after) * len(change) > ASKED * after else 0.0


@dataclass(frozen=True, eq=False)
class Extended:
    """A problem with the extensions that recordings ask for, and its fit."""

    chosen: tuple[Extension, ...]
    problem: Problem
    x: Array
    cost: float
    """Mean square; outliers count by Huber's loss."""


Propose = Callable[[Problem, Array], Iterable[Extension]]


def extended(
    problem: Problem, x: Array, propose: Propose, *, enough: Callable[[Problem, Array], bool], most: int = ADOPTED,
    rounds: int = 60,
) -> Extended:  # fmt: skip
    """Add the extension that explains most, one after the other, until it is enough or recordings ask for none."""
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
    """With parameters free, too. tracks: recordings that have values of their own; None: all share one."""
    layout = problem.layout
    entries = [
        Entry(one, track, one.key if track is None else f"{one.key} ({problem.tracks[track].data.name})", one.start)
        for one in parameters
        for track in tracks
    ]
    return problem.under(replace(layout, entries=(*layout.entries, *entries), ties=(*layout.ties, *ties)))
