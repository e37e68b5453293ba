"""Extensions of a model. An extension adds an effect to a problem. Its parameters are fitted together with the other
parameters, and the extension is adopted if it reduces the error significantly.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from math import inf

import numpy as np

from asrsim.identification.noise import independent_samples
from asrsim.identification.parameters import INITIAL, JUMP, FitParameter, parameters_of
from asrsim.identification.problem import (
    FitProblem,
    differences,
    jacobian,
    mean_square,
    residuals,
    robust_mean,
    robust_mean_square,
    slopes_along,
    solve,
    with_own_substeps,
)
from asrsim.identification.task import Tie
from asrsim.samples import Array

SIGNIFICANT = 20.0
"""An extension is significant if its chi squared exceeds this value. Noise alone exceeds it with a probability of 1e-5."""
TRIED, ADOPTED = 4, 4
"""TRIED: largest number of extensions that are refitted in a round. Only the most promising extensions are refitted, since
refits take most of the time.
ADOPTED: largest number of extensions that are adopted.
"""
PROBE_STEP = 1e-3
"""Step of finite differences for a new entry of the parameter vector, in the vector's units. A step changes a number by 0.1 %,
and residuals are nearly linear over such a step.
"""
FAR_OFF = 4.0
"""A model fits badly if its mean square residual exceeds this multiple of the noise variance. Its error is then more than twice
the noise.
"""
FACTORS = (0.3, 3.0)
"""Start values of the pre-sliding stiffness, relative to its default in the friction law. They are half a decade below and
above the default.
"""
MUCH = 0.5
"""Largest fraction of the squared misfit beyond the noise that may remain with an effect that a model lacks. Causes are named
only below this limit. In a badly fitting model, pre-sliding friction is adopted only below this limit.
"""
FURTHER = 0.8
"""A further cause is suspected if at most this fraction of the mean square error remains with this cause, so that the RMS error
falls by 11 %.
"""
DECISIVE = 10.0
"""If Schwarz's criterion (BIC) of two extensions differs by more than this value, the evidence for the extension with the
smaller criterion is very strong (Kass and Raftery 1995).
"""
NEAR = 4.0
"""Trials are fitted further before they are compared if their criterion (BIC) exceeds the criterion of the best trial by at
most NEAR times DECISIVE.
"""
CLEAR = 0.4
"""A cause is suspected without a test of significance if at most this fraction of the mean square error remains with it, so
that the RMS error falls by 37 %. Smooth residuals count as few independent samples, so that the test would miss such a cause.
"""


@dataclass(frozen=True, kw_only=True, eq=False)
class Extension:
    """Parameters that become free, and ties that are added or removed.

    Attributes:
        text: Words that name the effect as a cause of a misfit. Empty: the extension is never reported as a cause.
        parameters: Parameters of `problem.fixed` that become free. They form the end of the extended parameter vector.
        size: Function that returns the size of the effect in words, such as `0.29 N m`. Its arguments are the values of
            `parameters`, in their order. None: the size is the value of the last parameter.
        begins: Start values of the new entries of the parameter vector. The effect of the extension is simulated at these
            values. Empty: the start values are the optimum of the linearised problem.
        ties: Further parameters that become multiples of free parameters, such as `Tie(key="joint_1.motor_2_damping",
            to="joint_1.motor_1_damping")` (`asrsim.identification.task.Tie`).
        untied: Tie that is removed.
        elastic: Joint whose link becomes elastic, and the frequency of the link's second mode, rad/s. `parameters` then belong
            to the second body.
        restepped: Whether the extension changes the required number of substeps.
        share: Largest fraction of the mean square error that may remain with the extension. If a larger fraction remains, the
            extension is refused.
        excess: Largest fraction of the squared misfit beyond the noise that may remain with the extension if the model fits
            badly. In a badly fitting model any additional parameter reduces the misfit. 1: no limit.
    """

    text: str = ""
    parameters: tuple[FitParameter, ...] = ()
    size: Callable[..., str] | None = None
    begins: Sequence[float | Sequence[float]] = ()
    ties: tuple[Tie, ...] = ()
    untied: Tie | None = None
    elastic: tuple[str, float] | None = None
    restepped: bool = False
    share: float = FURTHER
    excess: float = 1.0

    @property
    def names(self) -> set[str]:
        """Names of the parameters that become free."""
        return {parameter.name for parameter in self.parameters}

    def added_to(self, problem: FitProblem) -> FitProblem:
        """Problem with this extension."""
        if self.elastic is not None:
            tracks = [track.elastic(*self.elastic) for track in problem.tracks]
            problem = replace(problem, tracks=tuple(one for one in tracks if one is not None))
        layout = problem.layout
        ties = tuple(tie for tie in layout.ties if tie is not self.untied)
        entries = *self._released(layout.entries), *self.parameters
        return replace(problem, layout=replace(layout, entries=entries, ties=ties + self.ties))

    def _released(self, entries: tuple[FitParameter, ...]) -> Iterator[FitParameter]:
        """The given entries. An initial position loses its bounds if the zero offset or the scale of its sensor becomes
        free.
        """
        joints = {one.key.rsplit(".", 2)[0] for one in self.parameters if one.key.endswith((".offset", ".gain"))}
        for one in entries:
            joint, _, name = one.key.rpartition(".")
            yield replace(one, low=-inf, high=inf) if name.startswith(INITIAL) and joint in joints else one

    def accepts(self, before: float, after: float, samples: float) -> bool:
        """Whether the mean square errors show that the effect of the extension is real. before, after: mean square errors
        without and with the extension; samples: number of independent samples in these errors.
        """
        far = before > FAR_OFF and after - 1.0 > self.excess * (before - 1.0)
        # The residuals of a wrong model are smooth, so that few of their samples are independent. Therefore a large reduction
        # of the error suffices for a cause.
        real = (self.text and after <= CLEAR * before) or is_significant(before, after, samples)
        return bool(real and not far and after <= self.share * before)


def is_significant(before: float, after: float, samples: float) -> bool:
    """Whether a change of the model reduces the mean square error significantly. samples: number of independent samples."""
    return bool(samples * np.log(max(before, 1e-300) / max(after, 1e-300)) > SIGNIFICANT)


@dataclass(frozen=True, eq=False)
class Promise:
    """An extension with the part of the error that it would explain to first order, and the start vector of a refit."""

    share: float
    """Fraction of the squared error that the extension would explain; 0 if the fraction is not significant."""
    extension: Extension
    problem: FitProblem
    """Problem with the extension, and with suitable substeps."""
    start: Array


class Optimum:
    """The parameter vector at which extensions are compared, with its residuals and derivatives."""

    def __init__(self, problem: FitProblem, x: Array) -> None:
        self.problem, self.x, self.residuals = problem, x, residuals(problem, x)
        self._free = np.linalg.qr(jacobian(problem, x, base=self.residuals))[0]
        """Orthonormal basis (m, n) of the changes that the free parameters can produce."""
        self._left = self._uncompensated(self.residuals)

    def _uncompensated(self, change: Array) -> Array:
        """Part of a change (m,) or (m, k) of the residuals that the free parameters cannot compensate."""
        return np.asarray(change - self._free @ (self._free.T @ change))

    def promise(self, extension: Extension) -> Promise:
        """Promise of an extension, from the best of its start values."""
        begins = extension.begins or [(0.0,) * len(extension.parameters)]
        return max((self._promise(extension, begin) for begin in begins), key=lambda one: one.share)

    def _promise(self, extension: Extension, begin: float | Sequence[float]) -> Promise:
        from scipy.optimize import lsq_linear

        start, wider = np.append(self.x, begin), extension.added_to(self.problem)
        new, (low, high) = range(len(self.x), len(start)), wider.layout.bounds
        wider = with_own_substeps(wider, start) if extension.restepped else wider
        if extension.begins:
            change, limits = (residuals(wider, start) - self.residuals)[:, None], (np.zeros(1), np.full(1, np.inf))
        else:
            change = slopes_along(wider, start, new, PROBE_STEP, base=self.residuals)
            limits = np.minimum(low[new], -1e-9), high[new]
        alone = self._uncompensated(change)
        moves = lsq_linear(alone, -self._left, bounds=limits).x if alone.any() else np.zeros(alone.shape[1])
        if not extension.begins or not any(parameter.logarithmic for parameter in extension.parameters):
            # The start vector is the optimum of the linearised problem, or the proposed start vector if that is farther away. A
            # small change may have no effect, for example a small change of friction that keeps a joint at rest.
            best = np.maximum(moves, 1.0) * np.asarray(begin) if extension.begins else moves
            start = np.append(self.x, np.clip(best, low[new], high[new]))
        before, after = float(self._left @ self._left), float(np.sum((self._left + alone @ moves) ** 2))
        share = 1.0 - after / before if is_significant(before, after, len(alone)) else 0.0
        return Promise(share, extension, wider, start)


@dataclass(frozen=True, eq=False)
class Extended:
    """A problem with the adopted extensions, and the fitted parameter vector."""

    chosen: tuple[Extension, ...]
    problem: FitProblem
    x: Array
    cost: float
    """Mean square of the residuals, in which outliers count less."""
    samples: float = 1.0
    """Number of independent samples to which the residuals are equivalent."""
    trials: tuple[Extended, ...] = ()
    """Extended problems that were tried and that had smaller errors than the problem before."""
    rivals: tuple[Extended, ...] = ()
    """Extended problems that explain the recordings as well. Each has another extension, its last one, in place of one of
    `chosen`.
    """

    @property
    def estimates(self) -> dict[str, float]:
        """Estimates by name."""
        return self.problem.layout.named(self.x)

    def criterion(self, samples: float) -> float:
        """Schwarz's criterion (BIC) without a constant, from a number of independent samples; the smallest is the best."""
        return samples * float(np.log(max(self.cost, 1e-300))) + len(self.x) * float(np.log(samples))


Propose = Callable[[FitProblem, Array], Iterable[Extension]]


def extended(
    problem: FitProblem,
    x: Array,
    kinds: Sequence[Propose],
    *,
    enough: Callable[[FitProblem, Array], bool],
    most: int = ADOPTED,
    rounds: int = 60,
    least: float = inf,
    chosen: tuple[Extension, ...] = (),
) -> Extended:
    """Problem with added extensions. Each round adds the extension that is best by Schwarz's criterion. The rounds end if
    `enough` is true, if `most` extensions are added, or if no further extension is accepted. kinds: functions that propose
    extensions of a problem; least: smallest known `cost` of the problem without extensions, which an extension must reduce;
    chosen: extensions that the problem already has.
    """
    most += len(chosen)
    found, better = Extended(chosen, problem, x, robust_mean_square(problem, x)), list[Extended]()
    while len(found.chosen) < most and not enough(found.problem, found.x):
        optimum = Optimum(found.problem, found.x)
        promises = [optimum.promise(one) for propose in kinds for one in propose(found.problem, found.x)]
        likely = sorted((one for one in promises if one.share), key=lambda one: -one.share)[:TRIED]
        trials = [_trial((*found.chosen, one.extension), one.problem, one.start, rounds) for one in likely]
        before = min(found.cost, least)
        better += [one for one in trials if one.cost < before]
        trials = [one for one in trials if one.chosen[-1].accepts(before, one.cost, one.samples)]
        if not trials:
            break
        best = _most_likely(trials, NEAR * DECISIVE)
        if len(best) > 1:
            # Continue the searches of these trials before comparing them, since some searches may not have converged.
            best = _most_likely([_trial(one.chosen, one.problem, one.x, rounds) for one in best], DECISIVE)
            best = best_predictions(_simplest(best))
        found = best[0]
    return replace(found, trials=tuple(better))


def _trial(chosen: tuple[Extension, ...], problem: FitProblem, start: Array, rounds: int) -> Extended:
    """Fit of a problem with extensions, from a start vector near the solution."""
    x = solve(problem, start, rounds=rounds, tolerance=1e-5)
    left = residuals(problem, x)
    return Extended(chosen, problem, x, robust_mean_square(problem, x), max(independent_samples(left), 2.0))


def _simplest(trials: Sequence[Extended]) -> list[Extended]:
    """The simplest trials. A trial is left out if it frees all parameters of another trial and further parameters."""
    keys = [set[str]().union(*(one.names for one in trial.chosen)) for trial in trials]
    return [trial for trial, own in zip(trials, keys, strict=True) if not any(own > other for other in keys)]


def best_predictions(trials: Sequence[Extended]) -> list[Extended]:
    """The given trials in a new order. They are about equally likely, and the most likely trial comes first. If another trial
    predicts the held-out parts clearly better than the most likely trial, the trial with the best predictions comes first.
    """
    errors = [held_out(one.problem, one.x) for one in trials]
    best = int(np.argmin(errors))
    best = best if errors[best] <= FURTHER * errors[0] else 0
    return [trials[best], *trials[:best], *trials[best + 1 :]]


def held_out(problem: FitProblem, x: Array) -> float:
    """Mean square error of the predictions in the held-out parts, in which outliers count less; 0 if everything was fitted."""
    firsts = [part.channel.until(end) if (end := problem.ends[part.track]) else 0 for part in problem.everything.parts]
    found = zip(firsts, differences(problem.everything, x), strict=True)
    return robust_mean([part.weighted(values)[first:] for first, (part, values) in found])


def _most_likely(trials: Sequence[Extended], within: float) -> list[Extended]:
    """The trial that is best by Schwarz's criterion, followed by the trials whose criterion exceeds the best criterion by at
    most `within`.
    """
    # Count the independent samples in the residuals of the best trial, since these residuals are closest to noise.
    samples = min(trials, key=lambda trial: trial.cost).samples
    ranked = sorted(trials, key=lambda trial: trial.criterion(samples))
    return [one for one in ranked if one.criterion(samples) <= ranked[0].criterion(samples) + within]


def with_all(problem: FitProblem, extensions: Iterable[Extension]) -> FitProblem:
    """Problem to which all these extensions are added, in this order."""
    return reduce(lambda wider, one: one.added_to(wider), extensions, problem)


def pruned(problem: FitProblem, found: Extended, *, rounds: int) -> Extended:
    """Extended problem without the extensions that the other extensions make unnecessary. An extension is necessary if it
    leaves at most the fraction `FURTHER` of the mean square error. problem: problem without extensions.
    """
    for extension in found.chosen if len(found.chosen) > 1 else ():
        chosen = tuple(one for one in found.chosen if one is not extension)
        fewer = with_all(problem, chosen)
        kept = [entry not in extension.parameters for entry in found.problem.layout.entries]
        x = solve(fewer, found.x[kept], rounds=rounds)
        if mean_square(found.problem, found.x) > FURTHER * mean_square(fewer, x):
            found = Extended(chosen, fewer, x, robust_mean_square(fewer, x))
    return found


def exchanged(problem: FitProblem, found: Extended, kinds: Sequence[Propose], *, rounds: int) -> Extended:
    """Extended problem in which each extension was compared with the extensions that could take its place. At the estimates
    without the extension, the most promising other extensions are fitted. The best of them all is kept, and those that explain
    the recordings as well become rivals. problem: problem without extensions.

    Two extensions may imitate each other. For example, a larger mass has the same effect as a smaller scale of the torque if
    inertia and friction are free.
    """
    rivals = list[Extended]()
    for extension in found.chosen:
        others = tuple(one for one in found.chosen if one is not extension)
        without = with_all(problem, others)
        own = extension.names
        x = found.x[[entry.name not in own for entry in found.problem.layout.entries]]
        optimum = Optimum(without, x)
        promises = [optimum.promise(one) for propose in kinds for one in propose(without, x) if not own <= one.names]
        hopeful = sorted((one for one in promises if one.share), key=lambda one: -one.share)[:TRIED]
        trials = [_trial((*others, one.extension), one.problem, one.start, rounds) for one in hopeful]
        near = [one for one in _most_likely([found, *trials], NEAR * DECISIVE) if one is not found]
        # Continue the searches before comparing them, since some searches may not have converged.
        found, *near = (_trial(one.chosen, one.problem, one.x, rounds) for one in (found, *near))
        likely = best_predictions(_simplest(_most_likely([found, *near], DECISIVE)))
        kept, _ = best_predictions([likely[0], found])
        rivals += [one for one in likely if one is not kept]
        found = kept
    return replace(found, rivals=tuple(rivals))


def jumps(problem: FitProblem, _: Array) -> Iterator[Extension]:
    """Extensions that free the instants at which the commands of a recording jump. Each instant lies within one sampling
    interval before the first sample after the jump.
    """
    names = [track.data.name for track in problem.tracks]
    for i in problem.fitted:
        track = problem.tracks[i]
        if any(entry.key.startswith(JUMP) and entry.track == i for entry in problem.layout.entries):
            continue
        early = [
            FitParameter(key=f"{JUMP}{n}", unit="s", start=0.0, low=0.0, high=track.sampling)
            for n in range(1, 1 + len(track.jumps))
        ]
        if early and track.sampling > 0.0:
            yield Extension(parameters=tuple(one.of_recording(i, names) for one in early), share=1.0)


def presliding(problem: FitProblem, _: Array) -> Iterator[Extension]:
    """Extensions that free the pre-sliding stiffness of motor friction, for motors whose stiffness the robot does not state.
    Motors with tied friction share the stiffness.
    """
    robot, tied = problem.tracks[0].door.robot, {tie.key: tie.to for tie in problem.layout.ties}
    known, groups = parameters_of(robot, (), {}), dict[str, list[str]]()
    for block in robot.actuators:
        for name, value in block.parameters.items():
            key = f"{block.joint}.{name}"
            if key.endswith("friction_stiffness") and value.origin == "default" and key not in problem.layout.keys:
                level = key.replace("stiffness", "torque")
                groups.setdefault(tied.get(level, level), []).append(key)
    for first, *others in groups.values():
        ties, begins = tied_to(first, others), tuple(np.log(FACTORS))
        yield Extension(parameters=(known[first],), ties=ties, begins=begins, restepped=True, share=1.0, excess=MUCH)


def tied_to(first: str, others: Iterable[str]) -> tuple[Tie, ...]:
    """Ties of the parameters `others` to the parameter `first`; all are keys."""
    return tuple(Tie(key=key, to=first) for key in others)
