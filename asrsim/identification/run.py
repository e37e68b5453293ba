"""A complete fit: search for the parameters, weights from the residuals, judgement on the held-out part, and report. The fit
reports its progress and can be interrupted.
"""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.errors import SimulationError
from asrsim.identification.causes import missing_causes, ties_that_are_none
from asrsim.identification.judge import channel_fits, fits_noise, foreign, rms, verdict
from asrsim.identification.problem import Problem, differences, jacobian, mean_square
from asrsim.identification.result import ACCEPTABLE, Result, bounds_met, doubted, estimates
from asrsim.identification.search import Best, Stopped, refined, search, settle
from asrsim.identification.setup import Setup, set_up
from asrsim.identification.task import Task, task_of
from asrsim.identification.uncertainty import Uncertainty, uncertainty, widened
from asrsim.samples import Array
from asrsim.workers import one_thread


@dataclass(frozen=True)
class Progress:
    """Progress of a running fit."""

    stage: str
    cost: float
    """Smallest mean square residual so far, relative to the noise."""
    evaluations: int
    elapsed: float
    """Time since the start of the fit, s."""
    remaining: float
    """Estimated remaining time if the search tries no further start, s; nan: unknown."""


OFTEN = 0.2
"""Time between progress reports, s."""
SEARCH, AFTERWARDS = 12, 40
"""Estimated number of evaluations per parameter in a search, and in all later stages together."""
UNFINISHED, INTERRUPTED = "unfinished", "interrupted"
"""Status of a fit that reached its time limit, or that the user stopped."""


class Watch:
    """Observer that calls the user's functions between evaluations, and ends the search at its time limit."""

    def __init__(
        self, progress: Callable[[Progress], None] | None, stop: Callable[[], bool] | None, seconds: float | None = None
    ) -> None:
        """seconds: time limit of the search."""
        self._progress, self.stop = progress, stop
        """Functions of the user; `stop` is None if requests to stop are ignored."""
        self._seconds = self.limit = math.inf if seconds is None else seconds
        """Time after which the next evaluation ends the computation, s; infinity if the time limit is ignored."""
        self.ended = INTERRUPTED
        """Status of a search that was stopped."""
        self.began = self._reported = clock.perf_counter()
        self._stage, self._before = "start", 0
        self.best: Best | None = None

    def stage(self, name: str) -> None:
        """Begin a stage, or a start of the search."""
        if self.best is not None:
            self.best.problem.meter.cost, self._before = math.inf, self.best.problem.meter.evaluations
        self._stage = name
        self._report()

    def tick(self) -> None:
        """Report progress after an evaluation. Raises Stopped if the user stops the fit or its time is over."""
        late = clock.perf_counter() - self.began > self.limit
        if late or (self.stop is not None and self.stop()):
            self.ended = UNFINISHED if late else INTERRUPTED
            raise Stopped
        if clock.perf_counter() - self._reported > OFTEN:
            self._report()

    def in_time(self, found: Callable[[], Iterable[str]]) -> list[str]:
        """Results of an optional computation; empty if the time limit is reached during the computation."""
        self.limit = self._seconds
        try:
            return list(found())
        except Stopped:
            if self.ended == INTERRUPTED:
                raise
            return []
        finally:
            self.limit = math.inf

    def _report(self) -> None:
        self._reported = clock.perf_counter()
        if self._progress is None:
            return
        elapsed, left, cost, done = self._reported - self.began, math.nan, math.nan, 0
        if self.best is not None:
            meter = self.best.problem.meter
            cost, done = min(self.best.cost, meter.cost), meter.evaluations
            wanted = self._before + (AFTERWARDS + SEARCH) * (len(self.best.x) + 1)
            left = min(max(wanted - done, 0) * elapsed / max(done, 1), max(self._seconds - elapsed, 0.0))
        self._progress(Progress(self._stage, cost, done, elapsed, left))


APART = 10.0
"""If the mean square error of whole recordings exceeds that of the training parts by this factor, no parameters explain both.
"""


def identify(
    scenario: str | Path | Task,
    experiments: Sequence[str | Path] = (),
    *,
    progress: Callable[[Progress], None] | None = None,
    stop: Callable[[], bool] | None = None,
    check: bool = False,
    accept: bool = False,
    seconds: float | None = None,
    **options: Any,
) -> Result:
    """Result of fitting parameters to recordings, as `asrsim identify` does, without files.

        result = asrsim.identify("lab.yaml", ["a.csv"], free=["joint_1.spring_k_1"])
        result.find("joint_1.spring_k_1").value

    Args:
        scenario: Scenario or fit file, or a task from `task_of`.
        experiments, options: Arguments of `task_of`.
        progress: Called about five times a second.
        stop: Called between evaluations; True ends the search, and the best fit so far is judged.
        check: Compute only the sensitivities at the start.
        accept: If the model does not fit but explains 90 % of the variance of every channel, give intervals that show the
            spread of estimates from tenths of the recording.
        seconds: Time limit of the search, s; the best fit so far is then judged as `unfinished`. None: no limit.

    Raises:
        InputError: Recordings, keys or ties are wrong, all problems at once; nothing moves; too few samples.
        SimulationError: The simulation diverges at the start.
    """
    task = scenario if isinstance(scenario, Task) else task_of(scenario, experiments, **options)
    watch = Watch(progress, stop, seconds)
    with one_thread(), ExitStack() as stack:
        watch.stage("reading and preparing")
        setup = set_up(task, stack)
        problem, start = setup.problem, np.zeros(len(setup.problem.layout))
        before = differences(problem.everything, start)
        parts = zip(problem.everything.parts, before, strict=True)
        if any(np.isnan(left).any() for part, left in parts if part.track in problem.fitted):
            message = "the simulation with the start values diverges before the recording ends"
            raise SimulationError(f"{message}. Give other starts (--free KEY=START), or a smaller step")
        problem.meter.tell = watch.tick
        watch.best = best = Best(problem, start.copy())
        status = "checked" if check else _searched(best, setup, watch)
        watch.limit = math.inf
        try:
            return _judged(setup, best, before, status, watch, accept=accept)
        except Stopped:
            # The user interrupts the judgement after the search is complete.
            return _judged(setup, best, before, INTERRUPTED, watch, accept=accept)


def _searched(best: Best, setup: Setup, watch: Watch) -> str:
    """Search for the parameters, store the best fit in `best`, and return the status of the search."""
    try:
        search(best, setup, watch.stage)
        watch.stage("substeps and weights")
        settle(best, setup)
    except Stopped:
        return watch.ended
    return "complete"


def _judged(setup: Setup, best: Best, before: Sequence[Array], status: str, watch: Watch, *, accept: bool) -> Result:
    watch.stage("judgement")
    watch.stop = None if status == INTERRUPTED else watch.stop
    problem, trained, complete = best.problem, best.x, status == "complete"
    fits = channel_fits(problem, before, trained)
    misfit, causes = verdict(fits, cache(lambda: _unsure(problem, trained))) if complete else [], list[str]()
    if misfit:
        watch.stage("what may be missing")
        causes = foreign(fits) + watch.in_time(lambda: _causes(problem, trained))
    final, x, found, met = _final(problem, trained, status)
    if complete and not all(one.is_exact for one in fits) and final.ends != problem.whole.ends:
        misfit.append("no parameters explain the whole recordings: estimates are from the training part")
    misfit += ties_that_are_none(final, x) if complete else ()
    accepted = accept and bool(misfit) and all(one.explained >= ACCEPTABLE for one in fits)
    found = found.of_a_block if accepted else found
    known, combined = estimates(final, x, found, met)
    if misfit:
        missed, channel = max((1.0 if one.diverges else max(1.0 - one.explained, 0.0) ** 0.5, one.key) for one in fits)
        known = doubted(known, missed, channel)
    return Result(
        task=setup.task, estimates=tuple(known), combinations=tuple(combined),
        covariance=found.covariance, channels=tuple(fits), misfit=tuple(misfit), causes=tuple(causes),
        remarks=tuple(_remarks(setup, best)), evaluations=problem.meter.evaluations,
        seconds=clock.perf_counter() - watch.began, how=best.how, attempts=best.attempts, successes=best.successes,
        status=status, x=x, layout=final.layout, ends=problem.ends,
        scenario=setup.scenario, robot=setup.robot, whole=final.ends != problem.ends, accepted=accepted,
        played={
            c.source: "hold" if c.hold or c.key in problem.playing.held else "smooth"
            for track in problem.tracks for c in track.data.commands
        },
    )  # fmt: skip


def _causes(problem: Problem, x: Array) -> Iterator[str]:
    """Sentences on effects that the model may lack, from the training part, or from whole recordings if the
    training part fits.
    """
    plain = replace(problem, weights=tuple(tuple(c.noise for c in track.channels) for track in problem.tracks))
    if fits_noise(problem, x):
        plain = plain.whole
        x = refined(plain, x, 20)
    yield from missing_causes(plain, x)


def _unsure(problem: Problem, x: Array) -> list[float]:
    """RMS change of each channel's held-out prediction within the standard deviations of the estimates."""
    values, vectors = np.linalg.eigh(uncertainty(problem, x, bounds_met(problem.layout, x)).covariance)
    weights = tuple(tuple(channel.floor for channel in track.channels) for track in problem.tracks)
    everything = replace(problem.everything, weights=weights)
    moves = jacobian(everything, x) @ (vectors * np.sqrt(np.maximum(values, 0.0)))
    sizes = []
    for part in everything.parts:
        held = moves[part.rows][part.time > problem.ends[part.track] + 1e-9]
        sizes.append(rms(np.linalg.norm(held, axis=1)) * part.noise)
    return sizes


def _final(problem: Problem, trained: Array, status: str) -> tuple[Problem, Array, Uncertainty, list[bool]]:
    """Problem, estimate, uncertainty and entries at bounds, from whole recordings if the fit is complete and explains them."""
    if status != "complete":
        # In a check an entry may start at a bound, such as a delay of 0; then no search moved the entry to the bound.
        met = [status != "checked" and one for one in bounds_met(problem.layout, trained)]
        found = uncertainty(problem, trained, met, foreseen=status == "checked", quick=status == INTERRUPTED)
        return problem, trained, found, met
    whole, x = problem.whole, trained
    if whole.ends != problem.ends:
        x = min((refined(whole, x, 20), x), key=lambda there: mean_square(whole, there))
        if mean_square(whole, x) > APART * max(mean_square(problem, trained), 1.0):
            whole, x = problem, trained
    met = bounds_met(whole.layout, x)
    return whole, x, widened(whole, x, uncertainty(whole, x, met)), met


def _remarks(setup: Setup, best: Best) -> Iterator[str]:
    """Sentences on how recordings were read, and on parameters that were freed automatically."""
    keys = {entry.parameter.key for entry in best.problem.layout.entries}
    for key in sorted(keys - setup.asked):
        if key.endswith("friction_stiffness"):
            yield f"{key} is estimated, too: the recording shows a different pre-sliding stiffness of the friction"
    if held := best.problem.playing.held:
        yield (
            f"{', '.join(sorted(held))}: played as a staircase, since the recording shows that each sample was held until the "
            "next (`interpolation: hold` of the scenario's playback)"
        )
    for track in best.problem.tracks:
        yield from (f"{track.data.name}: {text}" for text in track.data.remarks)
        for key in keys.intersection(track.uncertain):
            yield (
                f"{track.data.name}: {key} is estimated, too: the recording begins at another position than the "
                "scenario, in motion, or at a measured position"
            )
