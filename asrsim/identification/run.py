"""A complete fit: search for the parameters, weights from the residuals, judgement by the held-out part, and result. The fit
reports its progress and can be interrupted.
"""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.errors import SimulationError
from asrsim.identification.causes import (
    MOST,
    Suspicion,
    contradicted_ties,
    missing_causes,
    unexplained_drives,
    wrong_controllers,
)
from asrsim.identification.judge import channel_fits, explains_both, fits_noise, foreign, misread, verdict
from asrsim.identification.noise import is_first_order
from asrsim.identification.parameters import JUMP
from asrsim.identification.problem import Differences, FitProblem, Meter, Setup, differences, jacobian, mean_square, set_up
from asrsim.identification.profiles import Profile, profiles
from asrsim.identification.replay import replay_of
from asrsim.identification.result import (
    CHECKED,
    COMPLETE,
    INTERRUPTED,
    UNFINISHED,
    FitResult,
    accepts,
    doubted,
    estimates,
)
from asrsim.identification.search import Best, OutOfTime, Stopped, free_run, refined, search, settle
from asrsim.identification.task import Task, task_of
from asrsim.identification.transfer import failed_predictions, transfers, with_own_values
from asrsim.identification.uncertainty import Uncertainty, uncertainty, widened
from asrsim.metrics.values import root_mean_square
from asrsim.progress import Progress, Stop
from asrsim.renamed import renamed
from asrsim.samples import Array
from asrsim.workers import one_thread


@dataclass(frozen=True, kw_only=True)
class FitProgress(Progress):
    """Progress of a running fit. `task` is the present stage of the fit."""

    cost: float
    """Smallest mean Huber loss of the residuals so far, in units of the noise variance."""
    evaluations: int
    elapsed: float
    """Time since the start of the fit, s."""
    remaining: float
    """Estimated remaining time if the search begins at no further start vector, s; nan: unknown."""


OFTEN = 0.2
"""Time between progress reports, s. Five reports a second appear as steady progress."""
EXPECTED = 70
"""Estimated number of remaining evaluations per parameter when a stage begins, for a fit that tries causes. A fit without
causes needs a fifth of this number.
"""
APART = 10.0
"""No parameters explain both the training parts and the held-out parts if the mean square error of the whole recordings exceeds
this multiple of the mean square error of the training parts.
"""


@dataclass
class FitWatch(Meter):
    """Counter of evaluations. It reports the progress to the user, and ends the search when the time limit is reached."""

    progress: Callable[[FitProgress], None] | None = None
    seconds: float = math.inf
    """Time limit of the search."""
    stop: Stop | None = None
    """Function that returns True when the user stops the fit; None: the fit cannot be stopped."""
    limited: bool = False
    """Whether the time limit applies to the present computation."""
    best: Best | None = None
    began: float = field(default_factory=clock.perf_counter)
    _reported: float = 0.0
    _stage: str = ""
    _before: int = 0
    """Number of evaluations before the present stage."""

    def stage(self, name: str) -> None:
        """Begin a stage of the fit. name: name of the stage for the user."""
        self.cost, self._before, self._stage = math.inf, self.evaluations, name
        self._report()

    def count(self) -> None:
        """Count an evaluation, and report the progress from time to time. Raises Stopped if the user stops the fit, and
        OutOfTime, a kind of Stopped, if the time limit is reached.
        """
        super().count()
        if self.limited and clock.perf_counter() - self.began > self.seconds:
            raise OutOfTime
        if self.stop is not None and self.stop():
            raise Stopped
        if clock.perf_counter() - self._reported > OFTEN:
            self._report()

    @contextmanager
    def in_time(self) -> Iterator[None]:
        """Context in which the time limit applies. Evaluations inside it raise OutOfTime when the limit is reached."""
        self.limited = True
        try:
            yield
        finally:
            self.limited = False

    def _report(self) -> None:
        self._reported = clock.perf_counter()
        if self.progress is None:
            return
        elapsed, left, cost = self._reported - self.began, math.nan, math.nan
        if self.best is not None:
            cost, wanted = min(self.best.cost, self.cost), EXPECTED * (len(self.best.x) + 1)
            missing = max(self._before + wanted - self.evaluations, 0)
            left = min(missing * elapsed / max(self.evaluations, 1), max(self.seconds - elapsed, 0.0))
        told = FitProgress(task=self._stage, cost=cost, evaluations=self.evaluations, elapsed=elapsed, remaining=left)
        self.progress(told)


@renamed(seconds="duration")
def identify(
    scenario: str | Path | Task,
    experiments: Sequence[str | Path] = (),
    *,
    progress: Callable[[FitProgress], None] | None = None,
    stop: Stop | None = None,
    check: bool = False,
    accept: bool = False,
    adopt: bool = False,
    duration: float | None = None,
    **options: Any,
) -> FitResult:
    """Fit parameters to recordings, as `asrsim identify` does, and return the result. No files are written.

        result = asrsim.identify("lab.yaml", ["a.csv"], free=["joint_1.spring_k_1"])
        result.find("joint_1.spring_k_1").value

    Args:
        scenario: Scenario or fit file, or a task from `task_of`.
        experiments, options: Arguments of `task_of`.
        progress: Function that is called with the progress about five times a second.
        stop: Function that is called between evaluations. If it returns True, the search ends, and the best fit so far is
        judged.
        check: Whether to compute only the sensitivities at the start values, without a fit.
        accept: Whether to accept a model that does not fit if it explains 90 % of the variance of every channel, instead of
            95 %. The robot of an accepted model can be written.
        adopt: Whether to add the effects that a model may lack if it does not fit, and to fit again, up to three times.
        duration: Time limit of the search, s. When it is reached, the status is `unfinished`, and the result is the best fit so
        far. None: no limit.

    Raises:
        InputError: Recordings, keys or ties are wrong (the error contains all problems), no channel moves, or the samples are
        too few.
        SimulationError: The simulation with the start values diverges.
    """
    task = scenario if isinstance(scenario, Task) else task_of(scenario, experiments, **options)
    watch = FitWatch(progress=progress, seconds=math.inf if duration is None else duration)
    with one_thread(), ExitStack() as stack:
        watch.stage("reading the recordings and preparing the simulation")
        setup = set_up(task, stack, watch)
        problem, start = setup.problem, np.zeros(len(setup.problem.layout))
        before = differences(problem.everything, start)
        if not problem.observes and any(np.isnan(left).any() for part, left in before if part.track in problem.fitted):
            message = "the simulation with the start values diverges before the recording ends"
            raise SimulationError(f"{message}. Give other starts (--free KEY=START), or a smaller step")
        watch.stop = stop
        watch.best = Best(problem, start)
        result, suspected = _fitted(setup, watch.best, before, watch, check=check, accept=accept)
        rounds, rivals = MOST if adopt else 0, list[Mapping[str, float]]()
        while rounds and suspected is not None and suspected.model is not None:
            # Repeat the whole fit. The adopted effects change the other parameters, and the fit may then show further effects.
            wider, start = suspected.model
            rivals += suspected.rivals
            watch.best = Best(replace(wider, ends=problem.ends, weights=problem.weights), start)
            setup, rounds = replace(setup, adopted=(*setup.adopted, *suspected.added)), rounds - 1
            result, suspected = _fitted(setup, watch.best, before, watch, check=False, accept=accept, rivals=rivals)
        return result


def _fitted(
    setup: Setup,
    best: Best,
    before: Differences,
    watch: FitWatch,
    *,
    check: bool,
    accept: bool,
    rivals: Sequence[Mapping[str, float]] = (),
) -> tuple[FitResult, Suspicion | None]:
    """Result of a search that begins with the problem and the estimate in `best`, and the effects that the model may lack.
    before: predicted minus recorded values with the start values; rivals: for each model with effects as likely as the adopted
    effects, its estimates by parameter name.
    """
    status = CHECKED if check else COMPLETE
    try:
        with watch.in_time():
            if not check:
                search(best, watch.stage)
                watch.stage("adapting substeps and weights to the estimates")
                settle(best)
                best.x = best.problem.possible(best.x)
    except OutOfTime:
        status = UNFINISHED
    except Stopped:
        status = INTERRUPTED
    try:
        return _judged(setup, best, before, status, watch, accept=accept, rivals=rivals)
    except Stopped:
        # The user stopped the judgement after the complete search: judge again without the search for causes.
        return _judged(setup, best, before, INTERRUPTED, watch, accept=accept, rivals=rivals)


def _judged(
    setup: Setup,
    best: Best,
    before: Differences,
    status: str,
    watch: FitWatch,
    *,
    accept: bool,
    rivals: Sequence[Mapping[str, float]],
) -> tuple[FitResult, Suspicion | None]:
    watch.stage("judgement")
    watch.stop = None if status == INTERRUPTED else watch.stop
    problem, trained, complete = best.problem, best.x, status == COMPLETE
    if status != CHECKED:
        problem = with_own_values(problem, trained)
    # Judge a free simulation, since users simulate the written robot without an observer.
    free, observed, slow = problem.observed(0.0), problem.playing.bandwidth > 0.0, best.slow or ((problem, trained),)
    slow = tuple((replace(wider, own=problem.own), there) for wider, there in slow)
    fits = channel_fits(free, before, trained)
    foretold = transfers(free, trained, fits) if status != CHECKED else []
    final, x, found = _final(problem, trained, status)
    misfit, causes = list[str](), list[str]()
    if complete:
        misfit = verdict(
            fits, cache(lambda: _unsure(free, trained)), cache(lambda: explains_both(free, final.observed(0.0), x))
        )
    of_channels = [*misfit]
    others, suspected, untried = list[Mapping[str, float]](), list[Suspicion](), dict[str, None]()
    if complete and observed:
        misfit.append(
            "errors of the model accumulate in a simulation of the recording: estimates are from short predictions of "
            f"{1.0 / problem.playing.bandwidth:.2g} s, each of which starts at the recorded positions"
        )
        others += [wider.layout.named(there) for wider, there in best.slow]
    others += best.rivals
    if misfit:
        watch.stage("looking for effects that the model lacks")
        others += rivals
        predicted = channel_fits(problem, before, trained) if observed else fits
        causes += foreign(predicted)
        causes += wrong_controllers(*slow[0])
        read = not misread((*predicted, *fits))
        with watch.in_time(), suppress(OutOfTime):
            for level in slow if read else ():
                for one in _causes(*level):
                    untried |= dict.fromkeys(one.remarks)
                    # Causes that are found without a trial fit are equal at all levels. Report each of them once.
                    if one.trials or level is slow[0]:
                        suspected.append(one)
                        causes += filter(None, [one.text])
                        others += one.trials
                if any(one.added for one in suspected):
                    break
            if not any(one.added for one in suspected):
                causes += [text for text in foreign(fits) if observed and text not in causes]
                causes += unexplained_drives(*slow[0]) if read else ()
            causes += failed_predictions(*slow[0], [one for one in foretold if not one.succeeds])
    if complete and not all(one.is_exact for one in fits) and final.ends != problem.whole.ends:
        misfit.append("no parameters explain the whole recordings: estimates are from the training part")
    misfit += contradicted_ties(*(slow[0] if observed else (final, x))) if complete else ()
    accepted = bool(misfit) and all(accepts(one.explained, accept=accept) for one in fits)
    # `noise`: whether the residuals may be correlated noise of the sensors. Then only the correlation of the residuals
    # contradicts the model.
    noise = not causes and misfit == of_channels and all(accepts(one.explained, accept=False) for one in fits)
    noise = noise and all(is_first_order(left) for _, left in differences(final, x))
    found = found if not misfit or noise else found.of_a_block
    known, combined = estimates(final, x, found)
    if status != CHECKED:
        known = list(doubted(known, fits=complete and not misfit, others=others))
    curves: tuple[Profile, ...] = ()
    if complete:
        watch.stage("profiles")
        with watch.in_time(), suppress(OutOfTime):
            curves = profiles(final, x, found, tuple(one.name for one in known))
    result = FitResult(
        task=setup.task, profiles=curves, estimates=tuple(known), combinations=tuple(combined),
        covariance=found.covariance, channels=tuple(fits), misfit=tuple(misfit), causes=tuple(causes),
        transfers=tuple(foretold),
        remarks=(*untried, *_remarks(setup, final, x, suspected, fits=not misfit or noise)), evaluations=watch.evaluations,
        seconds=clock.perf_counter() - watch.began, bandwidth=final.playing.bandwidth,
        status=status, x=x, layout=final.layout, ends=problem.ends,
        scenario=setup.scenario, robot=setup.robot, whole=final.ends != problem.ends, accepted=accepted,
        replay=replay_of(problem.tracks[0], final.layout.table(x, 0), replace(final.playing, bandwidth=0.0)),
        played=problem.tracks[0].data.commands,
    )  # fmt: skip
    return result, next((one for one in suspected if one.added), None)


def _causes(problem: FitProblem, x: Array) -> Iterator[Suspicion]:
    """Effects that the model may lack. They are searched in the training part, or in whole recordings if the model fits the
    training part.
    """
    plain = replace(problem, weights=tuple(tuple(c.noise for c in track.channels) for track in problem.tracks))
    if fits_noise(problem, x):
        plain, x = plain.whole, refined(plain.whole, x)
    return missing_causes(plain, x)


def _unsure(problem: FitProblem, x: Array) -> list[float]:
    """RMS change of each channel's held-out prediction due to the standard deviations of the estimates."""
    slopes = jacobian(problem.everything, x)
    variances = np.sum((slopes @ uncertainty(problem, x).covariance) * slopes, axis=1)
    held = [(part, variances[part.rows][part.time > problem.ends[part.track] + 1e-9]) for part in problem.everything.parts]
    return [root_mean_square(np.sqrt(np.maximum(values, 0.0))) * part.noise for part, values in held]


def _final(problem: FitProblem, trained: Array, status: str) -> tuple[FitProblem, Array, Uncertainty]:
    """Problem, estimate and uncertainty. They are from whole recordings if the fit is complete and if the parameters explain
    the whole recordings.
    """
    if status != COMPLETE:
        return problem, trained, uncertainty(problem, trained, foreseen=status == CHECKED, quick=status == INTERRUPTED)
    whole, x = problem.whole, trained
    if whole.ends != problem.ends:
        refit = refined(whole, x)
        # Short predictions may improve while a free simulation leaves the recording: keep the estimates of the training part.
        if mean_square(whole, refit) < mean_square(whole, x) and free_run(whole, refit).reaches(free_run(whole, x)):
            x = whole.possible(refit)
        if mean_square(whole, x) > APART * max(mean_square(problem, trained), 1.0):
            whole, x = problem, trained
    return whole, x, widened(whole, x, uncertainty(whole, x))


def _remarks(setup: Setup, problem: FitProblem, x: Array, suspected: Sequence[Suspicion], *, fits: bool) -> Iterator[str]:
    """Sentences on the reading of recordings, and on parameters that were freed automatically. suspected: effects that the
    model may lack; fits: whether the model fits.
    """
    added = [one for one in problem.layout.entries[len(setup.problem.layout) :] if one.name not in setup.adopted]
    if setup.adopted:
        yield f"{', '.join(setup.adopted)}: adopted, since the recording shows an effect that the model lacked"
    if late := [entry.name for entry in added if entry.key.startswith(JUMP)]:
        yield f"{', '.join(late)} is estimated, too: the command jumps by this time before the first sample with the new value"
    for entry in (one for one in added if not one.key.startswith(JUMP)):
        yield f"{entry.key} is estimated, too: the recording shows a different pre-sliding stiffness of the friction"
    if staircases := problem.playing.staircases:
        smooth = any(one.model is not None and not one.model[0].playing.staircases for one in suspected)
        why = "since the recording shows that each sample was held until the next"
        why += " (`interpolation: hold` of the scenario's playback)"
        if not fits:
            why = "which has a smaller error; since the model does not fit, this does not show that each sample was held"
            why += ", and with the suspected effects, smooth interpolation has a smaller error" if smooth else ""
        yield f"{', '.join(sorted(staircases))}: played as a staircase, {why}"
    for link in problem.at_limit(x):
        yield (
            f"the inertia of {link} is at the limit of what is physically possible: its largest principal moment is the sum of "
            "the other two"
        )
    for number, track in enumerate(problem.tracks):
        yield from (f"{track.data.name}: {text}" for text in track.data.remarks)
        if own := problem.own.get(number, {}):
            known = ((problem.known[key], value) for key, value in own.items() if not key.startswith(JUMP))
            values = ", ".join(f"{one.key} = {value:.4g} {one.unit}" for one, value in known)
            yield f"{track.data.name}: these parameters belong to the recording, and were fitted to it: {values}"
        for key in track.uncertain:
            if key in problem.layout.keys and not own:
                yield (
                    f"{track.data.name}: {key} is estimated, too: the recording begins at another position than the "
                    "scenario, in motion, or at a measured position"
                )
