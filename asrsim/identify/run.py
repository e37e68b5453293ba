"""A fit from beginning to end: recordings read, parameters searched, intervals, verdicts, and what the model does not explain."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.errors import InputError, Problem, SimulationError
from asrsim.identify.data import Data, read_data
from asrsim.identify.fit import Best, Stopped, cost_of, globally, search, solve
from asrsim.identify.intervals import correlations, uncertainty, whitened
from asrsim.identify.inverse import track_of
from asrsim.identify.judge import ChannelFit, channel_fits, coarse_joints, missing_causes, still_joints, verdict
from asrsim.identify.keys import Parameter, free_parameters, parameters_of
from asrsim.identify.layout import Layout, make_layout
from asrsim.identify.nulls import Combination
from asrsim.identify.residuals import Counter, Residuals, Weights
from asrsim.identify.task import Task, Tie, make_task
from asrsim.identify.track import Track
from asrsim.identify.verdicts import Estimate, bounds_met, estimates
from asrsim.robot.model import Robot
from asrsim.samples import Array
from asrsim.scenario.data import Scenario


@dataclass(frozen=True)
class Progress:
    """Where a fit is."""

    stage: str
    cost: float
    """Mean square residual of the best so far, in deviations of the noise."""
    evaluations: int
    elapsed: float
    """s."""
    remaining: float
    """s, of the present stage, by what the ones before took; nan: unknown."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Result:
    """What a fit gives."""

    task: Task
    estimates: tuple[Estimate, ...]
    combinations: tuple[Combination, ...]
    correlation: Array
    covariance: Array
    """Of the vector."""
    channels: tuple[ChannelFit, ...]
    misfit: tuple[str, ...]
    """Why the model does not fit; empty where it does."""
    causes: tuple[str, ...]
    """What may be missing."""
    remarks: tuple[str, ...]
    evaluations: int
    seconds: float
    how: str
    attempts: int
    successes: int
    status: str
    """complete, interrupted or checked."""
    x: Array
    layout: Layout = field(repr=False)
    ends: tuple[float, ...]
    """s, end of each recording's training part."""
    series: tuple[tuple[Mapping[str, Any], ...], ...] = field(repr=False)
    """By recording and channel: time, recorded, before, after."""
    scenario: Scenario = field(repr=False)
    robot: Robot = field(repr=False)

    @property
    def fits(self) -> bool:
        """Whether the model explains what was recorded, as far as the noise lets see."""
        return not self.misfit

    def find(self, key: str) -> Estimate:
        """The estimate of a key (its first, where each recording has its own); KeyError."""
        for one in self.estimates:
            if key in (one.key, one.name):
                return one
        raise KeyError(key)

    def values(self) -> dict[str, float]:
        """Key -> estimate of what all recordings share, ties followed."""
        return self.layout.table(self.x, 0)


@dataclass
class Setup:
    """A task read and made ready."""

    task: Task
    scenario: Scenario
    robot: Robot
    data: list[Data]
    tracks: list[Track]
    free: list[Parameter]
    ties: list[Tie]
    layout: Layout
    ends: list[float]
    """s; of recordings that are only predicted, 0."""

    @property
    def fitted(self) -> list[Track]:
        """Recordings that are fitted."""
        return [track for track in self.tracks if not track.data.held]


def set_up(task: Task, stack: ExitStack) -> Setup:
    """Read and check everything. Raises InputError with all that is wrong."""
    from asrsim.actuators.user import load_plugin_file
    from asrsim.scenario import apply_to_robot, checked_robot, load_scenario, only_variant

    for plugin in task.plugins:
        load_plugin_file(plugin)
    scenario = only_variant(load_scenario(task.scenario, variant=task.variant, overrides=task.overrides))
    given, _ = checked_robot(scenario)
    robot = apply_to_robot(scenario, given)
    data = read_data(task, scenario, robot)
    commands = list(dict.fromkeys(command.key for one in data for command in one.commands))
    channels = {channel.key: channel.unit for one in data for channel in one.channels}
    units = {command.key: command.unit for one in data for command in one.commands}
    known = parameters_of(robot, commands, {**units, **channels})
    free, ties = free_parameters(task, known)
    tracks = []
    for one in data:
        track = track_of(scenario, given, one, robot)
        stack.callback(track.close)
        tracks.append(track)
    free += _unknown_starts(tracks, free, known)
    layout = make_layout(free, ties, [one.name for one in data], [_starts(track) for track in tracks])
    # Own values of recordings that are only predicted would be guesses: clocks and starts keep theirs.
    fitted = [i for i, one in enumerate(data) if not one.held]
    layout = Layout(tuple(e for e in layout.entries if e.track is None or e.track in fitted), layout.ties, layout.tracks)
    share = 0.0 if task.validate else task.hold_out
    ends = [0.0 if t.data.held else t.onset + (t.data.duration - t.onset) * (1.0 - share) for t in tracks]
    setup = Setup(task, scenario, robot, data, tracks, free, ties, layout, ends)
    count = sum(int(np.sum(c.time <= end)) for t, end in zip(tracks, ends, strict=True) if not t.data.held for c in t.channels)
    if count <= len(layout):
        message = f"{count} samples are fewer than the {len(layout)} parameters need"
        raise InputError(Problem(message=message, file=data[0].path, key="experiments", code="few-samples"))
    return setup


def _unknown_starts(tracks: Sequence[Track], free: Sequence[Parameter], known: Mapping[str, Parameter]) -> list[Parameter]:
    """Starts of links that a recording finds elsewhere than the scenario, or in motion: free, each recording's own."""
    taken = {parameter.key for parameter in free}
    joints = dict.fromkeys(joint for track in tracks if not track.data.held for joint in track.uncertain)
    keys = [f"{joint}.{name}" for joint in joints for name in ("initial_position", "initial_velocity")]
    return [known[key] for key in keys if key not in taken]


def _starts(track: Track) -> dict[str, float]:
    joints = track.evaluation.joints
    places = {f"{joint}.initial_position": q for joint, q in zip(joints, track.positions, strict=True)}
    return places | {f"{joint}.initial_velocity": v for joint, v in zip(joints, track.velocities, strict=True)}


def identify(
    scenario: str | Path | Task,
    experiments: Sequence[str | Path] = (),
    *,
    progress: Callable[[Progress], None] | None = None,
    stop: Callable[[], bool] | None = None,
    begin: Mapping[str, float] | None = None,
    check: bool = False,
    **options: Any,
) -> Result:
    """Fit parameters to recordings: everything that `asrsim identify` does but the files.

        result = asrsim.identify("lab.yaml", ["a.csv"], free=["joint_1.spring_k_1"])
        result.find("joint_1.spring_k_1").value

    Args:
        scenario: Scenario file, or a task of :func:`make_task` or :func:`read_task`.
        experiments, options: As :func:`make_task` takes them.
        progress: Told now and then. stop: asked; True ends the search, and the best so far is judged.
        begin: Name of an entry -> value to begin at, in place of the starts: of a fit that was interrupted.
        check: Only look: sensitivities at the start.

    Raises:
        InputError: Recordings, keys or ties are wrong, all problems at once; nothing moves; too few samples.
        SimulationError: The motion is not sane at the start.
    """
    task = scenario if isinstance(scenario, Task) else make_task(scenario, experiments, **options)
    with ExitStack() as stack:
        return _identify(set_up(task, stack), progress, stop, begin or {}, check=check)


def _identify(
    setup: Setup, progress: Callable[[Progress], None] | None, stop: Callable[[], bool] | None, begin: Mapping[str, float],
    *, check: bool,
) -> Result:  # fmt: skip
    task, layout = setup.task, setup.layout
    teller = _Teller(progress, stop)
    counter = Counter(tell=teller.tick)
    teller.counter = counter
    weights = [[Weights(max(c.noise, c.quantum / np.sqrt(12.0))) for c in track.channels] for track in setup.tracks]
    residuals = Residuals(setup.fitted, layout, weights, setup.ends, counter)
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
                residuals, best, loss=task.loss, starts=task.starts, spread=task.spread, seed=task.seed, tell=teller.stage
            )
            teller.stage("weights from what is left")
            best.x = _reweighted(residuals, best.x, task)
        except Stopped:
            status = "interrupted"
            residuals.share = 1.0
    teller.deaf = True
    return _judged(setup, residuals, best, start, before, status, teller.began)


ALIKE = 1.01
"""Mean square error that weights by correlated noise may cost: more, and what is correlated is the model's fault."""


def _reweighted(residuals: Residuals, x: Array, task: Task) -> Array:
    """Once more with each channel's noise and its correlation as they are left over.

    Whitening is right for noise that is correlated; where the model is wrong it would give weight to what the model does best.
    """
    before = residuals.weights
    residuals.weights = whitened(residuals, x)
    there = solve(residuals, x, loss=task.loss, rounds=15)
    better = float(np.mean(residuals(there) ** 2)) <= float(np.mean(residuals(x) ** 2)) * (1.0 + 1e-9)
    weights = residuals.weights
    residuals.weights = before
    if better and cost_of(residuals(there), task.loss) <= ALIKE * cost_of(residuals(x), task.loss):
        residuals.weights = weights
        return there
    residuals.weights = [
        [Weights(float(np.sqrt(np.mean(r**2)))) for r in residuals.raw(x, track, residuals.until(track)) or []]
        for track in range(len(residuals.tracks))
    ]  # fmt: skip
    return x


def residuals_of(setup: Setup, x: Array, track: int) -> list[Array] | None:
    """Predicted less recorded over a whole recording."""
    one = setup.tracks[track]
    predicted = one.predict(setup.layout.table(x, track))
    return None if predicted is None else [a - c.values for a, c in zip(predicted, one.channels, strict=True)]


def _whole(setup: Setup, residuals: Residuals, x: Array) -> Array:
    """The estimate from whole recordings, once the part that was held out has judged."""
    if all(end >= track.data.duration for track, end in zip(setup.fitted, setup.ends, strict=False)):
        return x
    residuals.ends = [track.data.duration for track in setup.tracks]
    there = solve(residuals, x, loss="linear", rounds=20)
    return there if np.mean(residuals(there) ** 2) <= np.mean(residuals(x) ** 2) else x


def _moved(layout: Layout, trained: Array, x: Array, deviations: Array) -> list[str]:
    """Parameters that the held-out part makes others by more than chance."""
    values, others = layout.values(trained), layout.values(x)
    apart = np.abs(x - trained) > np.maximum(6.0 * deviations, 0.1)
    return [
        f"{entry.name} is {b:.4g} from whole recordings, but {a:.4g} without the held-out part: no value holds for all of it"
        for entry, a, b, off in zip(layout.entries, values, others, apart, strict=True) if off
    ]  # fmt: skip


def _judged(
    setup: Setup, residuals: Residuals, best: Best, start: Array, before: Sequence[Any], status: str, began: float
) -> Result:
    layout, trained, counter = setup.layout, best.x, residuals.counter
    if status != "complete":
        residuals.weights = [[Weights(w.noise) for w in channel] for channel in residuals.weights]
    after = [residuals_of(setup, trained, track) for track in range(len(setup.tracks))]
    fits = channel_fits(setup.tracks, setup.ends, before, after)
    misfit = verdict(fits) if status == "complete" else []
    plain = Residuals(setup.fitted, layout, [[Weights(c.noise) for c in t.channels] for t in setup.tracks], setup.ends, counter)
    causes = missing_causes(plain, trained, start) if misfit else []
    x = _whole(setup, residuals, trained) if status == "complete" else trained
    found = uncertainty(residuals, x, bounds_met(layout, x))
    told, known = estimates(layout, x, found, setup.fitted, still_joints(setup.fitted), coarse_joints(setup.fitted))
    if moved := _moved(layout, trained, x, found.deviation):
        misfit, causes = misfit or ["estimates change with the part of the recording"], [*causes, *moved]
    remarks = [f"{one.name}: {text}" for one in (track.data for track in setup.tracks) for text in one.remarks]
    remarks += [
        f"{track.data.name}: {joint} begins elsewhere than the scenario, or in motion: its start is estimated, too"
        for track in setup.tracks for joint in track.uncertain
    ]  # fmt: skip
    series = tuple(
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
    return Result(
        task=setup.task, estimates=tuple(told), combinations=tuple(known), correlation=correlations(found.covariance),
        covariance=found.covariance, channels=tuple(fits), misfit=tuple(misfit), causes=tuple(causes), remarks=tuple(remarks),
        evaluations=counter.evaluations, seconds=clock.perf_counter() - began, how=best.how, attempts=best.attempts,
        successes=best.successes, status=status, x=x, layout=layout, ends=tuple(setup.ends), series=series,
        scenario=setup.scenario, robot=setup.robot,
    )  # fmt: skip


class _Teller:
    """Between the search and who watches it."""

    def __init__(self, progress: Callable[[Progress], None] | None, stop: Callable[[], bool] | None) -> None:
        self._progress, self._stop = progress, stop
        self.began = self._told = clock.perf_counter()
        self._stage, self._stage_began, self._lengths = "start", self.began, [0.0]
        self.counter: Counter | None = None
        self.best: Best | None = None
        self.deaf = False
        """No more questions: what is there is judged."""

    def stage(self, name: str) -> None:
        """The search begins anew."""
        now = clock.perf_counter()
        self._lengths.append(now - self._stage_began)
        self._stage, self._stage_began = name, now

    def tick(self) -> None:
        """An evaluation is done; raises Stopped."""
        if self.deaf:
            return
        if self._stop is not None and self._stop():
            raise Stopped
        now = clock.perf_counter()
        if self._progress is not None and self.counter is not None and self.best is not None and now - self._told > 0.2:
            self._told = now
            longest = max(self._lengths)
            left = longest - (now - self._stage_began) if len(self._lengths) > 2 else float("nan")
            self._progress(Progress(self._stage, self.best.cost, self.counter.evaluations, now - self.began, max(left, 0.0)))
