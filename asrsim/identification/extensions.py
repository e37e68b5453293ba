"""What a model may lack: proposed, freed beside the rest, refitted and scored. One algorithm for all of it.

Jumps of commands between samples, commands held as stairs, bristles of friction are adopted where recordings ask for them;
delays, zeros, gains, springs, limits and ties that are none are named as causes where a model does not fit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from asrsim.identification.keys import Parameter
from asrsim.identification.layout import Entry
from asrsim.identification.noise import independent_samples
from asrsim.identification.problem import Problem, cost_of, jacobian, residuals, solve, with_own_substeps
from asrsim.identification.task import Tie
from asrsim.samples import Array

ASKED = 20.0
"""Chi squared of one number from which on recordings ask for it: of noise alone, one time in a hundred thousand."""
TRIED = 4
"""Extensions that are tried at a time, at most, those that promise most: of a model that is all wrong, nothing explains it."""
LOOK = 1e-3
"""Of a difference along what is freed, in the vector's units."""
ADOPTED = 4
"""Extensions that a fit adopts, at most, at a time."""
FAR_OFF = 4.0
"""Mean square, in the noise's, of a model that is wrong in more than a detail."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Extension:
    """A problem in which more is free, at the end of its vector, or commands are played otherwise."""

    text: str = ""
    flags: str = ""
    """For people: what it is, and how they ask for it."""
    problem: Problem
    begins: tuple[float, ...] = ()
    """Places of the new entry at which its search may begin; none: where slopes say."""
    finite: bool = False
    """Its effect is looked at where it begins: slopes tell nothing of it."""
    separable: bool = False
    """New entries that recordings do not ask for are dropped."""
    restepped: bool = False
    """It changes how finely a simulation must be stepped."""
    share: float = 1.0
    """Of the mean square, that it may leave at most."""
    excess: float = 1.0
    """Of what is more than noise, that it may leave of a model that is far off: there any number more explains a part."""

    def accepts(self, before: float, after: float, samples: float) -> bool:
        """Whether mean squares without and with it, where as many independent samples tell that, say that it is there."""
        far = before > FAR_OFF and after - 1.0 > self.excess * (before - 1.0)
        # Errors that a missing part of the model correlates are white with it; correlated noise stays so.
        return bool(not far and after <= self.share * before and samples * np.log(before / max(after, 1e-300)) > ASKED)


@dataclass(frozen=True, eq=False)
class _Place:
    """A vector from which extensions are looked at."""

    x: Array
    there: Array
    """(m,) residuals."""
    free: Array
    """(m, n) orthonormal: what the parameters can make good."""
    left: Array
    """(m,) residuals that they cannot."""

    @staticmethod
    def of(problem: Problem, x: Array) -> _Place:
        there = residuals(problem, x)
        free = np.linalg.qr(jacobian(problem, x, base=there))[0]
        return _Place(x, there, free, there - free @ (free.T @ there))

    def alone(self, change: Array) -> Array:
        """Of a change (m, k) of the residuals, what the parameters cannot make good."""
        return np.asarray(change - self.free @ (self.free.T @ change))

    def share(self, after: Array) -> float:
        """Of what is left, squared, that is not in `after` (m,); 0 where that is chance."""
        before, less = float(self.left @ self.left), float(after @ after)
        return 1.0 - less / before if (before - less) * len(after) > ASKED * less else 0.0


@dataclass(frozen=True, eq=False)
class Promise:
    """What an extension would do near a place, if slopes hold."""

    extension: Extension
    start: Array
    share: float
    """Of the error that all else leaves, squared, that it explains."""


def promises(extension: Extension, place: _Place) -> Iterator[Promise]:
    """What an extension promises, from each place where it may begin."""
    x, there, n = place.x, place.there, len(place.x)
    if extension.finite:
        for begin in ([one] for one in extension.begins) if extension.begins else ([],):
            start = np.append(x, begin)
            trial = with_own_substeps(extension.problem, start) if extension.restepped else extension.problem
            alone = place.alone(residuals(trial, start) - there)
            amount = float(alone @ place.left) / max(float(alone @ alone), 1e-300)
            if share := place.share(place.left - min(amount, 0.0) * alone):
                yield Promise(replace(extension, problem=trial), start, share)
        return
    layout = extension.problem.layout
    nowhere, new = np.append(x, np.zeros(len(layout) - n)), range(n, len(layout))
    slopes = jacobian(extension.problem, nowhere, LOOK, base=there, columns=new)
    alone = place.alone(slopes)
    moves = least_moves(alone, place.left, *(bound[n:] for bound in layout.bounds))
    after = place.left + alone @ moves
    if extension.separable:
        asked = moves**2 * np.sum(alone**2, axis=0) > ASKED * max(float(np.mean(after**2)), 1.0)
        kept = [layout.entries[i] for i, one in zip(new, asked.tolist(), strict=True) if one]
        extension = replace(extension, problem=extension.problem.under(replace(layout, entries=(*layout.entries[:n], *kept))))
        moves = moves[asked]
    if len(moves) and (share := place.share(after)):
        yield Promise(extension, np.append(x, extension.begins[:1] or moves), share)


def least_moves(alone: Array, left: Array, low: Array, high: Array) -> Array:
    """(k,) moves within bounds that leave the least."""
    from scipy.optimize import lsq_linear

    if not alone.any():
        return np.zeros(alone.shape[1])
    return np.asarray(lsq_linear(alone, -left, bounds=(np.minimum(low, -1e-9), high)).x)


@dataclass(frozen=True, eq=False)
class Extended:
    """A problem with the extensions that recordings ask for, and where its fit is."""

    chosen: tuple[Extension, ...]
    problem: Problem
    x: Array
    cost: float
    """Mean square, by the loss."""


Propose = Callable[[Problem, Array], Iterable[Extension]]


def extended(
    problem: Problem, x: Array, propose: Propose, *, enough: Callable[[Problem, Array], bool], loss: str = "linear",
    most: int = ADOPTED, starts: Sequence[Array] = (), rounds: int = 60, tolerance: float = 1e-5,
) -> Extended:  # fmt: skip
    """Add what explains most, one after the other, until it is enough or nothing is asked for. starts: other vectors from which
    the first is looked at, too.
    """
    found = Extended((), problem, x, cost_of(residuals(problem, x), loss))
    while len(found.chosen) < most and not enough(found.problem, found.x):
        places = [_Place.of(found.problem, place) for place in (found.x, *starts)]
        ordered = sorted(
            (one for extension in propose(found.problem, found.x) for place in places for one in promises(extension, place)),
            key=lambda one: -one.share,
        )
        trials = []
        for one in _first_of_each(ordered):
            there = solve(one.extension.problem, one.start, loss=loss, rounds=rounds, tolerance=tolerance)
            left = residuals(one.extension.problem, there)
            cost = cost_of(left, loss)
            if one.extension.accepts(found.cost, cost, independent_samples(left)):
                trials.append((cost, one.extension, there))
        if not trials:
            break
        cost, extension, there = min(trials, key=lambda trial: trial[0])
        found, starts = Extended((*found.chosen, extension), extension.problem, there, cost), ()
    return found


def _first_of_each(ordered: Sequence[Promise]) -> list[Promise]:
    """Those that promise most, each once: an extension may be looked at from several places."""
    first = {one.extension.text: one for one in reversed(ordered)}
    ordered = [one for one in ordered if first[one.extension.text] is one]
    # What is looked at from afar promises more than it keeps: the best of the others has its turn, too.
    others = [one for one in ordered[TRIED:] if not one.extension.finite]
    return [*ordered[:TRIED], *others[: all(one.extension.finite for one in ordered[:TRIED])]]


def freed(
    problem: Problem, parameters: Sequence[Parameter], ties: Sequence[Tie] = (), *, tracks: Sequence[int | None] = (None,)
) -> Problem:
    """With parameters free, too; tracks: recordings that have values of their own, None: all share one."""
    layout = problem.layout
    entries = [
        Entry(one, track, one.key if track is None else f"{one.key} ({problem.tracks[track].data.name})", one.start)
        for one in parameters
        for track in tracks
    ]
    return problem.under(replace(layout, entries=(*layout.entries, *entries), ties=(*layout.ties, *ties)))
