"""A fit from beginning to end: parameters searched, weighted by what is left, judged on what was held out, and told."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.errors import SimulationError
from asrsim.identification.causes import bristles, missing_causes, ties_that_are_none, with_jumps_of_predicted
from asrsim.identification.extensions import ASKED, extended
from asrsim.identification.judge import (
    HELD,
    ChannelFit,
    channel_fits,
    foreign,
    still_joints,
    verdict,
    with_unsure,
)
from asrsim.identification.keys import JUMP
from asrsim.identification.problem import Problem, Weights, errors, mean_square, residuals, solve
from asrsim.identification.progress import Progress, Watch
from asrsim.identification.result import ACCEPTABLE, Result
from asrsim.identification.search import (
    Best,
    Stopped,
    fits_noise,
    is_explained,
    search,
    settle,
    with_jumps_of_whole_recordings,
)
from asrsim.identification.setup import Setup, set_up
from asrsim.identification.substeps import with_substeps
from asrsim.identification.task import Task, task_of
from asrsim.identification.uncertainty import Uncertainty, correlations, unbiased, uncertainty, with_played
from asrsim.identification.verdicts import IDENTIFIED, WEAK, bounds_met, doubted, estimates
from asrsim.samples import Array
from asrsim.workers import one_thread

APART = 10.0
"""Times that of the training part: a mean square error of whole recordings that means that they are not explained."""

Errors = list[list[Array] | None]
"""Predicted less recorded over each whole recording, by channel."""


def identify(
    scenario: str | Path | Task,
    experiments: Sequence[str | Path] = (),
    *,
    progress: Callable[[Progress], None] | None = None,
    stop: Callable[[], bool] | None = None,
    begin: Mapping[str, float] | None = None,
    check: bool = False,
    accept: bool = False,
    seconds: float | None = None,
    **options: Any,
) -> Result:
    """Fit parameters to recordings: everything that `asrsim identify` does but the files.

        result = asrsim.identify("lab.yaml", ["a.csv"], free=["joint_1.spring_k_1"])
        result.find("joint_1.spring_k_1").value

    Args:
        scenario: Scenario or fit file, or a task of :func:`task_of`.
        experiments, options: As :func:`task_of` takes them.
        progress: Told now and then. stop: asked; True ends the search, and the best so far is judged.
        begin: Name of an entry -> value to begin at, in place of the starts: of a fit that was interrupted.
        check: Only look: sensitivities at the start.
        accept: Of a model that does not fit but explains 90 % of the variance of every channel, give intervals that are as wide
            as estimates from a tenth of the recording differ.
        seconds: after which the search ends and the best so far is judged, as `unfinished`; None: it ends by itself.

    Raises:
        InputError: Recordings, keys or ties are wrong, all problems at once; nothing moves; too few samples.
        SimulationError: The motion is not sane at the start.
    """
    task = scenario if isinstance(scenario, Task) else task_of(scenario, experiments, **options)
    watch = Watch(progress, stop, seconds)
    with one_thread(), ExitStack() as stack:
        watch.stage("reading and preparing")
        setup = set_up(task, stack)
        problem, given = setup.problem, begin or {}
        start = np.array([one.place(given[one.name]) if one.name in given else 0.0 for one in problem.layout.entries])
        before = _errors(problem, start)
        if any(before[track] is None for track in problem.fitted):
            message = "the motion at the start is not sane: it diverges before the recording ends"
            raise SimulationError(f"{message}. Give other starts (--free KEY=START), or a smaller step")
        problem.meter.tell = watch.tick
        watch.best = best = Best(problem, start.copy())
        status = "checked" if check else _searched(best, setup, watch)
        watch.ignore_stop = True
        best.problem = with_jumps_of_predicted(best.problem, best.x, fits_noise)
        start = np.append(start, np.zeros(len(best.x) - len(start)))
        return _judged(setup, best, start, before, status, watch, accept=accept)


def _searched(best: Best, setup: Setup, watch: Watch) -> str:
    """How the search ended; `best` has what it found."""
    try:
        search(best, setup, lambda how: watch.stage(how, search=True))
        with_jumps_of_whole_recordings(best, setup.task)
        watch.stage("substeps and weights of what was found")
        settle(best, setup)
        watch.stage("bristles of the friction")
        # Even where what is left may be noise: they are told from it by many samples.
        found = extended(
            best.problem, best.x, lambda problem, _: bristles(problem, setup.robot), loss=setup.task.loss, enough=is_explained
        )
        if found.chosen:
            best.problem, best.x, best.cost = found.problem, found.x, found.cost
            settle(best, setup)
    except Stopped:
        return watch.ended
    return "complete"


def _errors(problem: Problem, x: Array) -> Errors:
    return [errors(problem, x, track, whole=True) for track in range(len(problem.tracks))]


def _judged(setup: Setup, best: Best, start: Array, before: Errors, status: str, watch: Watch, *, accept: bool) -> Result:
    watch.stage("judgement")
    problem, trained, complete = best.problem, best.x, status == "complete"
    if not complete:
        problem = replace(problem, weights=tuple(tuple(Weights(w.noise) for w in track) for track in problem.weights))
    after = _errors(problem, trained)
    fits = _channels(problem, trained, before, after, unsure=complete)
    misfit = verdict(fits) if complete else []
    causes = _causes(problem, trained, start, fits, watch) if misfit else []
    final, x, found, met, finer = _final(problem, trained, status)
    whole = final.ends != problem.ends
    cut = any(0.0 < end < track.data.duration for track, end in zip(problem.tracks, problem.ends, strict=True))
    if complete and cut and not whole and not all(one.explained_whole for one in fits):
        misfit.append("no values explain whole recordings: estimates are from the part that is not held out")
    misfit += ties_that_are_none(final, x, found) if complete else []
    accepted = accept and bool(misfit) and min(one.explained for one in fits) >= ACCEPTABLE
    found = found.of_a_block if accepted else found
    known, combined = estimates(final, x, found, met, still_joints([problem.tracks[i] for i in problem.fitted]))
    if misfit:
        missed, channel = max((max(1.0 - one.explained, 0.0) ** 0.5, one.key) for one in fits)
        known = doubted(known, missed, channel)
    sure = [one.verdict in (IDENTIFIED, WEAK) for one in known]
    if moved := _moved(problem, final, trained, x, np.where(sure, found.deviation, np.inf)):
        misfit, causes = misfit or ["estimates change with the part of the recording"], [*causes, *moved]
    return Result(
        task=setup.task, estimates=tuple(known), combinations=tuple(combined), correlation=correlations(found.covariance),
        covariance=found.covariance, channels=tuple(fits), misfit=tuple(misfit), causes=tuple(causes),
        remarks=tuple(_remarks(setup, best, finer)), evaluations=problem.meter.evaluations,
        seconds=clock.perf_counter() - watch.began, how=best.how, attempts=best.attempts, successes=best.successes,
        status=status, x=x, layout=final.layout, ends=problem.ends, series=tuple(_series(problem, before, after)),
        scenario=setup.scenario, robot=setup.robot, whole=whole, accepted=accepted,
        played={
            c.source: "hold" if c.hold or c.key in problem.held else "smooth"
            for track in problem.tracks for c in track.data.commands
        },
    )  # fmt: skip


def _channels(problem: Problem, x: Array, before: Errors, after: Errors, *, unsure: bool) -> list[ChannelFit]:
    """Errors of each channel; unsure: with what the estimates' uncertainty makes of them, where they are large unseen."""
    shaken = [
        track.shaken(problem.layout.table(x, i), one)
        for i, (track, one) in enumerate(zip(problem.tracks, problem.playing, strict=True))
    ]
    fits = channel_fits(problem.tracks, problem.ends, before, after, shaken)
    if not unsure or not any(HELD in text for text in verdict(fits)):
        return fits
    roughly = uncertainty(problem, x, bounds_met(problem.layout, x)).covariance
    return with_unsure(fits, problem, x, roughly)


def _causes(problem: Problem, x: Array, start: Array, fits: Sequence[ChannelFit], watch: Watch) -> list[str]:
    """What may be missing where the model does not fit."""
    watch.stage("what may be missing")
    plain = replace(problem, weights=tuple(tuple(Weights(c.noise) for c in track.channels) for track in problem.tracks))
    return [*foreign(fits), *watch.unless_stopped(lambda: missing_causes(plain, x, start))]


def _final(problem: Problem, trained: Array, status: str) -> tuple[Problem, Array, Uncertainty, list[bool], str]:
    """The estimate of a complete fit from whole recordings, how sure it is, which entries are at bounds, and what is said of
    finer substeps; else what there is.
    """
    if status != "complete":
        # What is only looked at may begin at a bound, as a delay of 0: it has not ended there.
        met = [status != "checked" and one for one in bounds_met(problem.layout, trained)]
        return problem, trained, uncertainty(problem, trained, met, foreseen=status == "checked"), met, ""
    problem, x = _from_whole_recordings(problem, trained)
    x = unbiased(problem, x)
    met = bounds_met(problem.layout, x)
    found = uncertainty(problem, x, met)
    found, finer = with_substeps(problem, x, with_played(problem, x, found))
    return problem, x, found, met, finer


def _from_whole_recordings(problem: Problem, x: Array) -> tuple[Problem, Array]:
    """The estimate once the part that was held out has judged; the same where nothing explains whole recordings."""
    whole = problem.whole
    if whole.ends == problem.ends:
        return problem, x
    there = solve(whole, x, rounds=20)
    least, best = min(((mean_square(whole, one), one) for one in (there, x)), key=lambda pair: pair[0])
    return (problem, x) if least > APART * max(mean_square(problem, x), 1.0) else (whole, best)


def _moved(problem: Problem, final: Problem, trained: Array, x: Array, deviations: Array) -> list[str]:
    """Parameters that the held-out part makes others by more than chance."""
    apart = np.abs(x - trained) > np.maximum(6.0 * deviations, 0.1)
    if not apart.any():
        return []
    # In a long valley a search may end anywhere: what explains the training part as well is no other estimate of it.
    near, there = residuals(problem, trained), residuals(problem, x)
    if there @ there < near @ near + ASKED * float(np.mean(near**2)):
        return []
    return [
        f"{entry.name} is {b:.4g} from whole recordings, but {a:.4g} without the held-out part: no value holds for all of it"
        for entry, a, b, off in zip(
            final.layout.entries, final.layout.values(trained), final.layout.values(x), apart, strict=True
        ) if off
    ]  # fmt: skip


def _remarks(setup: Setup, best: Best, finer: str) -> Iterator[str]:
    """What is said beside the tables: how recordings were taken, and what was estimated that nobody asked for."""
    entries, tracks = best.problem.layout.entries, best.problem.tracks
    yield from (f"{track.data.name}: {text}" for track in tracks for text in track.data.remarks)
    yield from [finer] if finer else []
    for entry in entries:
        if entry.parameter.key.endswith("friction_stiffness") and entry.parameter.key not in setup.asked:
            yield f"{entry.name} is estimated, too: what was recorded asks for bristles of another stiffness than the law's own"
    if any(f".{JUMP}" in entry.parameter.key for entry in entries) or any(map(bool, best.problem.layout.fixed)):
        yield "jumps of commands are estimated, too: they came between samples, so long before those that show them"
    if held := best.problem.held:
        yield (
            f"{', '.join(sorted(held))}: played as stairs, each sample held until the next, as a digital controller does: what "
            "was recorded asks for it (`interpolation: hold` of the scenario's playback)"
        )
    keys = {entry.parameter.key for entry in entries}
    for track in tracks:
        for key in keys.intersection(track.uncertain):
            yield (
                f"{track.data.name}: {key} is estimated, too: the recording begins elsewhere than the scenario, in motion, or "
                "where a sensor said"
            )


def _series(problem: Problem, before: Errors, after: Errors) -> Iterator[tuple[dict[str, Any], ...]]:
    """Of each recording and channel, for pictures."""
    for track, old, new in zip(problem.tracks, before, after, strict=True):
        yield tuple(
            {
                "key": channel.key, "unit": channel.unit, "time": channel.time, "recorded": channel.values,
                "before": None if old is None else old[i] + channel.values,
                "after": None if new is None else new[i] + channel.values,
            }
            for i, channel in enumerate(track.channels)
        )  # fmt: skip
