"""A fit from beginning to end: parameters searched, weighted by what is left, judged on what was held out, and told."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.errors import SimulationError
from asrsim.identification.between import ASKED, time_jumps_of_predicted, timed
from asrsim.identification.causes import missing_causes, ties_that_are_none
from asrsim.identification.fit import Best, Stopped, globally, search
from asrsim.identification.intervals import Uncertainty, correlations, uncertainty
from asrsim.identification.inverse import unbiased
from asrsim.identification.judge import (
    HELD,
    ChannelFit,
    channel_fits,
    foreign,
    still_joints,
    verdict,
    with_unsure,
)
from asrsim.identification.nulls import settled
from asrsim.identification.pool import Pool
from asrsim.identification.profiles import profiles
from asrsim.identification.quanta import with_played
from asrsim.identification.remarks import remarks_of
from asrsim.identification.residuals import Counter, Residuals, Weights
from asrsim.identification.result import Result
from asrsim.identification.settling import bristled, settle, widened
from asrsim.identification.setup import Setup, set_up
from asrsim.identification.solver import solve
from asrsim.identification.steps import with_substeps
from asrsim.identification.task import Task, task_of
from asrsim.identification.teller import Progress, Teller
from asrsim.identification.verdicts import IDENTIFIED, WEAK, bounds_met, doubted, estimates
from asrsim.samples import Array
from asrsim.workers import cores, executor, one_thread


def identify(
    scenario: str | Path | Task,
    experiments: Sequence[str | Path] = (),
    *,
    progress: Callable[[Progress], None] | None = None,
    stop: Callable[[], bool] | None = None,
    begin: Mapping[str, float] | None = None,
    check: bool = False,
    profiled: bool = False,
    workers: int | None = None,
    seconds: float | None = None,
    **options: Any,
) -> Result:
    """Fit parameters to recordings: everything that `asrsim identify` does but the files.

        result = asrsim.identify("lab.yaml", ["a.csv"], free=["joint_1.spring_k_1"])
        result.find("joint_1.spring_k_1").value

    Args:
        scenario: Scenario or fit file, or a task of :func:`make_task` or :func:`read_task`.
        experiments, options: As :func:`make_task` takes them; of a fit file, only `plugins`.
        progress: Told now and then. stop: asked; True ends the search, and the best so far is judged.
        begin: Name of an entry -> value to begin at, in place of the starts: of a fit that was interrupted.
        check: Only look: sensitivities at the start. profiled: with profiles, for pictures.
        workers: processes that evaluate derivatives of long fits, None: one a core; results are the same bits.
        seconds: after which the search ends and the best so far is judged, as `unfinished`; None: it ends by itself.

    Raises:
        InputError: Recordings, keys or ties are wrong, all problems at once; nothing moves; too few samples.
        SimulationError: The motion is not sane at the start.
    """
    task = scenario if isinstance(scenario, Task) else task_of(Path(scenario), experiments, **options)
    teller = Teller(progress, stop, seconds)
    with one_thread(), ExitStack() as stack:
        teller.stage("reading and preparing")
        setup, count = set_up(task, stack), cores() if workers is None else workers
        pool = Pool(task, stack.enter_context(executor(count, task.plugins)) if count > 1 else None)
        return _identify(setup, pool, teller, begin or {}, check=check, profiled=profiled)


def _identify(setup: Setup, pool: Pool, teller: Teller, begin: Mapping[str, float], *, check: bool, profiled: bool) -> Result:
    task, layout = setup.task, setup.layout
    counter = Counter(tell=teller.tick)
    teller.counter = counter
    weights = [[Weights(c.floor) for c in track.channels] for track in setup.tracks]
    residuals = Residuals(setup.fitted, layout, weights, setup.ends, counter, pool)
    start = np.zeros(len(layout))
    for i, entry in enumerate(layout.entries):
        if entry.name in begin:
            start[i] = entry.place(begin[entry.name])
    before = [residuals_of(setup, start, track) for track in range(len(setup.tracks))]
    if any(one is None for one in before[: len(setup.fitted)]):
        message = "the motion at the start is not sane: it diverges before the recording ends"
        raise SimulationError(f"{message}. Give other starts (--free KEY=START), or a smaller step")
    best = Best(start.copy())
    teller.best = best
    status = "checked" if check else "complete"
    if not check:
        try:
            if task.search:
                globally(residuals, best, seed=task.seed, tell=teller.stage)
            search(
                residuals, best, loss=task.loss, starts=task.starts, spread=task.spread, seed=task.seed, tell=teller.attempt,
                widened=lambda: widened(residuals, best, setup),
            )  # fmt: skip
            timed(residuals, best, setup)
            teller.stage("substeps and weights of what was found")
            settle(residuals, best, setup)
            teller.stage("bristles of the friction")
            if bristled(residuals, best, setup, np.inf):
                settle(residuals, best, setup)
        except Stopped:
            status = teller.ended
            residuals.share, residuals.layout = 1.0, setup.layout
    for track in setup.tracks:
        track.held = best.held
    time_jumps_of_predicted(setup, residuals.layout, best.x)
    teller.deaf = True
    start = np.append(start, np.zeros(len(best.x) - len(start)))
    return _judged(setup, residuals, best, start, before, status, teller, profiled=profiled)


APART = 10.0
"""Times that of the training part: a mean square error of whole recordings that means that they are not explained."""


def residuals_of(setup: Setup, x: Array, track: int) -> list[Array] | None:
    """Predicted less recorded over a whole recording."""
    one = setup.tracks[track]
    predicted = one.predict(setup.layout.table(x, track))
    return None if predicted is None else [a - c.values for a, c in zip(predicted, one.channels, strict=True)]


def _whole(setup: Setup, residuals: Residuals, x: Array) -> Array:
    """The estimate from whole recordings, once the part that was held out has judged; x where nothing explains all of them."""
    trained = residuals.ends
    if all(end >= track.data.duration for track, end in zip(setup.fitted, trained, strict=False)):
        return x
    error = float(np.mean(residuals(x) ** 2))
    residuals.ends = [track.data.duration for track in setup.tracks]
    there = solve(residuals, x, loss="linear", rounds=20)
    errors = [float(np.mean(residuals(one) ** 2)) for one in (there, x)]
    if min(errors) > APART * max(error, 1.0):
        residuals.ends = trained
        return x
    return there if errors[0] <= errors[1] else x


def _moved(residuals: Residuals, setup: Setup, trained: Array, x: Array, deviations: Array) -> list[str]:
    """Parameters that the held-out part makes others by more than chance."""
    layout, whole = residuals.layout, residuals.ends
    values, others = layout.values(trained), layout.values(x)
    apart = np.abs(x - trained) > np.maximum(6.0 * deviations, 0.1)
    if not apart.any():
        return []
    # In a long valley a search may end anywhere: what explains the training part as well is no other estimate of it.
    residuals.ends = setup.ends
    near, there = residuals(trained), residuals(x)
    residuals.ends = whole
    if there @ there < near @ near + ASKED * float(np.mean(near**2)):
        return []
    return [
        f"{entry.name} is {b:.4g} from whole recordings, but {a:.4g} without the held-out part: no value holds for all of it"
        for entry, a, b, off in zip(layout.entries, values, others, apart, strict=True) if off
    ]  # fmt: skip


def _unless_stopped(teller: Teller, found: Callable[[], Iterable[Any]]) -> tuple[Any, ...]:
    """What takes long and can be done without; nothing where the user asks for the end."""
    teller.deaf = False
    try:
        return tuple(found())
    except Stopped:
        return ()
    finally:
        teller.deaf = True


def _judged(
    setup: Setup, residuals: Residuals, best: Best, start: Array, before: Sequence[Any], status: str, teller: Teller,
    *, profiled: bool,
) -> Result:  # fmt: skip
    teller.stage("judgement")
    layout, trained, complete = setup.layout, best.x, status == "complete"
    if not complete:
        residuals.weights = [[Weights(w.noise) for w in channel] for channel in residuals.weights]
    after = [residuals_of(setup, trained, track) for track in range(len(setup.tracks))]
    fits = _channels(setup, residuals, trained, before, after, doubted=complete)
    misfit = verdict(fits) if complete else []
    causes = _causes(setup, residuals, trained, start, fits, teller) if misfit else []
    x, found, met, finer = _final(setup, residuals, trained, start, status)
    told, combined = estimates(residuals, x, found, met, still_joints(setup.fitted))
    whole = residuals.ends is not setup.ends
    if complete and not whole and _held_any(setup) and not all(one.explained_whole for one in fits):
        misfit.append("no values explain whole recordings: estimates are from the part that is not held out")
    misfit += ties_that_are_none(residuals, x, found) if complete else []
    if misfit:
        missed, channel = max((max(1.0 - one.explained, 0.0) ** 0.5, one.key) for one in fits)
        told = doubted(told, missed, channel)
    known = [one.verdict in (IDENTIFIED, WEAK) for one in told]
    if moved := _moved(residuals, setup, trained, x, np.where(known, found.deviation, np.inf)):
        misfit, causes = misfit or ["estimates change with the part of the recording"], [*causes, *moved]
    teller.stage("profiles")
    shapes = _unless_stopped(teller, lambda: profiles(residuals, x, found)) if profiled and complete else ()
    held = setup.fitted[0].held
    return Result(
        task=setup.task, estimates=tuple(told), combinations=tuple(combined), correlation=correlations(found.covariance),
        covariance=found.covariance, channels=tuple(fits), misfit=tuple(misfit), causes=tuple(causes),
        remarks=tuple(remarks_of(setup, best, layout, finer)), evaluations=residuals.counter.evaluations,
        seconds=clock.perf_counter() - teller.began, how=best.how, attempts=best.attempts, successes=best.successes,
        status=status, x=x, layout=layout, ends=tuple(setup.ends), series=_series(setup, before, after),
        scenario=setup.scenario, robot=setup.robot, whole=whole,
        played={
            c.source: "hold" if c.hold or c.key in held else "smooth" for track in setup.tracks for c in track.data.commands
        },
        substeps=best.substeps, profiles=shapes,
    )  # fmt: skip


def _channels(
    setup: Setup, residuals: Residuals, x: Array, before: Sequence[Any], after: Sequence[Any], *, doubted: bool
) -> list[ChannelFit]:
    """Errors of each channel; doubted: with what the estimates' uncertainty makes of them, where they are large unseen."""
    tracks, ends = setup.tracks, setup.ends
    fits = channel_fits(
        tracks, ends, before, after, [track.shaken(setup.layout.table(x, i)) for i, track in enumerate(tracks)]
    )  # fmt: skip
    if not doubted or not any(HELD in text for text in verdict(fits)):
        return fits
    roughly = uncertainty(residuals, x, bounds_met(setup.layout, x)).covariance
    return with_unsure(fits, tracks, ends, lambda there, track: residuals_of(setup, there, track), x, roughly)


def _causes(
    setup: Setup, residuals: Residuals, x: Array, start: Array, fits: Sequence[ChannelFit], teller: Teller
) -> list[str]:
    """What may be missing where the model does not fit."""
    teller.stage("what may be missing")
    noise = [[Weights(channel.noise) for channel in track.channels] for track in setup.tracks]
    plain = Residuals(setup.fitted, setup.layout, noise, setup.ends, residuals.counter)
    return [*foreign(fits), *_unless_stopped(teller, lambda: missing_causes(plain, x, start))]


def _final(
    setup: Setup, residuals: Residuals, trained: Array, start: Array, status: str
) -> tuple[Array, Uncertainty, list[bool], str]:
    """The estimate of a complete fit from whole recordings, how sure it is, which entries are at bounds, and what is said of
    finer substeps; else what there is.
    """
    if status != "complete":
        # What is only looked at may begin at a bound, as a delay of 0: it has not ended there.
        met = [status != "checked" and one for one in bounds_met(setup.layout, trained)]
        return trained, uncertainty(residuals, trained, met, foreseen=status == "checked"), met, ""
    x = unbiased(residuals, _whole(setup, residuals, trained))
    met = bounds_met(setup.layout, x)
    found = uncertainty(residuals, x, met)
    there = settled(residuals, x, start, found, [i for i, one in enumerate(met) if not one])
    if there is not x:
        x, met = there, bounds_met(setup.layout, there)
        found = uncertainty(residuals, x, met)
    found, finer = with_substeps(residuals, x, with_played(residuals, x, found))
    return x, found, met, finer


def _held_any(setup: Setup) -> bool:
    """Whether a part of a recording was held out."""
    return any(0.0 < end < track.data.duration for track, end in zip(setup.tracks, setup.ends, strict=True))


def _series(setup: Setup, before: Sequence[Any], after: Sequence[Any]) -> tuple[tuple[dict[str, Any], ...], ...]:
    """Of each recording and channel, for pictures."""
    return tuple(
        tuple(
            {
                "key": channel.key, "unit": channel.unit, "time": channel.time, "recorded": channel.values,
                "before": None if old is None else old[i] + channel.values,
                "after": None if new is None else new[i] + channel.values,
            }
            for i, channel in enumerate(track.channels)
        )
        for track, old, new in zip(setup.tracks, before, after, strict=True)
    )  # fmt: skip
