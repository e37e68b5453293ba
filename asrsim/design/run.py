"""A design from beginning to end: files are read, earlier recordings counted, gains tried, and the motion is found."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.design.limits import Limits, located, read_limits
from asrsim.design.plant import Plant, Reference
from asrsim.design.search import FIRST, PRIOR, Found, Search
from asrsim.document.mistaken import kind_of
from asrsim.errors import InputError, Problem
from asrsim.identification.keys import CLOCK, free_parameters, parameters_of
from asrsim.identification.layout import Entry, Layout, make_layout
from asrsim.identification.problem import Problem as Fit
from asrsim.identification.problem import jacobian
from asrsim.identification.setup import set_up
from asrsim.identification.task import Experiment, Task, task_of
from asrsim.identification.track import NOT_THE_ROBOTS
from asrsim.robot.model import Robot
from asrsim.samples import Array
from asrsim.scenario.data import Scenario
from asrsim.workers import one_thread

ROUNDS = 30
"""Rounds of the search; a fifth of them for each choice of gains."""
SHORTEST, PROBE = 0.5, 0.2
"""s of an experiment, at least; s in which a robot must keep the limits while its references stand still."""
CHECKS, FACTOR = 24, 2.0
"""Further robots on which a robust design keeps its limits; factor by which their numbers are off at most."""
MANY = 27
"""Choices of gains that are tried, at most."""
WANTED = 0.05
"""Half-width of the interval for which the needed time is computed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Design:
    """A motion, and what it promises."""

    task: Task
    scenario: Scenario
    references: tuple[Reference, ...]
    step: float
    gains: Mapping[str, float]
    keys: tuple[str, ...]
    found: Found
    intervals: Mapping[str, Array]
    """`design`, plain motions, further sensors -> half-width of each key's 95 % interval, over its value or typical size."""
    remarks: tuple[str, ...]
    interrupted: bool

    @property
    def seconds(self) -> float:
        """Length of the motion."""
        return float(self.found.motion.shape[1] - 1) * self.step

    @property
    def needed(self) -> Array:
        """s after which each half-width is :data:`WANTED`, if the motion is repeated."""
        return np.asarray(self.seconds * (self.intervals["design"] / WANTED) ** 2)


def design(
    scenario: str | Path,
    limits: str | Path,
    *,
    seconds: float = 10.0,
    after: Sequence[str | Path] = (),
    robust: int = 0,
    rounds: int = ROUNDS,
    seed: int = 0,
    progress: Callable[[float], None] = lambda _: None,
    stop: Callable[[], bool] = lambda: False,
    **options: Any,
) -> Design:
    """The motion of the references, within limits, after which the free numbers are known best.

    Args:
        scenario: Scenario, with `free` among the options, or a fit file, whose recordings count as made.
        limits: File with `limits:`, and `noise:` and `choose:`.
        seconds: Length of the experiment.
        after: Recordings that exist.
        robust: Number of further robots, each number off by up to a factor of 2, for which the motion is designed too.
        rounds, seed: Of the search.
        progress: Receives the fraction that is done. stop: is called often; True ends the search with the best so far.
        options: As :func:`asrsim.identification.task_of` takes them.

    Raises:
        InputError: What is wrong with the files; a free number changes nothing that is recorded; no motion keeps the limits.
    """
    path, read = Path(limits), read_limits(Path(limits))
    task = _task(Path(scenario), after, options)
    with one_thread(), ExitStack() as stack:
        ready, robot, layout, remarks = _read(task, read)
        known = np.zeros((len(layout), len(layout)))
        if task.experiments:
            known = _of_recordings(set_up(task, stack).problem, layout)
            remarks.append(f"designed to follow {', '.join(one.file.name for one in task.experiments)}")
        if not seconds >= SHORTEST:
            message = f"is too short for any segment: a motion that begins and ends at rest takes {SHORTEST:g} s"
            raise InputError(message, key="seconds", value=seconds, code="seconds")
        try:
            plant = Plant(ready, robot, layout, read, seconds)
            stack.callback(plant.close)
            generator = np.random.default_rng(seed)
            robots = [np.zeros(len(layout)), *(off(layout, generator) for _ in range(robust))]
            checks = [off(layout, generator, corner=i % 2 == 0) for i in range(CHECKS if robust else 0)]
            searches = []
            for gains in _choices(read):
                substeps = plant.substeps_of(gains, robots + checks)
                searches.append(Search(plant, gains, robots, checks, substeps, known, np.random.default_rng(seed), stop))
            _probe(searches[0])
        except InputError as error:
            raise InputError(located(error.problems, path)) from None
        search, best, plain, tried = _searched(searches, rounds, progress)
        sizes = np.array([_size(entry) for entry in layout.entries])

        def interval(matrix: Array) -> Array:
            variance = np.diagonal(np.linalg.inv(matrix + known + PRIOR * np.eye(len(layout))))
            return np.asarray(1.96 * np.sqrt(variance) * sizes)

        intervals = {"design": interval(best.information[0, 0])}
        intervals |= {one.name: interval(one.information[0, 0]) for one in plain}
        for group, sensor in enumerate(read.sensors, start=1):
            intervals[f"with {sensor}"] = interval(best.information[0, 0] + best.information[0, group])
        keys = tuple(entry.name for entry in layout.entries)
        remarks += tried
        unknown = [key for key, half in zip(keys, intervals["design"], strict=True) if half > 1.0]
        if unknown:
            remarks.append(f"this motion does not show by itself: {', '.join(unknown)}")
        missing = [name for name in ("one step", "chirp") if name not in intervals]
        remarks += [f"{name}: no size that was tried keeps the limits, or its information is not believed" for name in missing]
        if best.name != "design":
            remarks.append(f"nothing better was found than {best.name}")
        return Design(
            task=task, scenario=ready, references=plant.references, step=plant.step, gains=search.gains, keys=keys, found=best,
            intervals=intervals, remarks=tuple(remarks), interrupted=stop(),
        )  # fmt: skip


def _task(scenario: Path, after: Sequence[str | Path], options: Mapping[str, Any]) -> Task:
    files = tuple(Experiment(file=Path(one).absolute()) for one in after)
    if kind_of(scenario) == "fit":
        task = task_of(scenario, **options)
        return replace(task, experiments=task.experiments + files)
    # A task needs a recording, and a design may come before the first one: the scenario stands in its place.
    return replace(task_of(scenario, [scenario], **options), experiments=files)


def _read(task: Task, limits: Limits) -> tuple[Scenario, Robot, Layout, list[str]]:
    """Scenario, robot as its file says, what is free, remarks. Raises InputError."""
    from asrsim.scenario import apply_to_robot, checked_robot, load_scenario, only_variant

    scenario = only_variant(load_scenario(task.scenario, variant=task.variant, overrides=task.overrides))
    given, _ = checked_robot(scenario)
    robot = apply_to_robot(scenario, given)
    joints = [joint.name for joint in robot.moving_joints]
    known = parameters_of(
        robot, [f"{joint}.reference_{i}" for joint in joints for i in (1, 2)],
        {f"{joint}.{name}": "" for joint in joints for name in ("link_position", "motor_1_position", "motor_2_position")},
    )  # fmt: skip
    free, ties = free_parameters(task, known)
    own = [one.key for one in free if one.own or one.key == CLOCK or one.key.rpartition(".")[2] in NOT_THE_ROBOTS]
    free = [one for one in free if one.key not in own]
    if not free:
        raise InputError("nothing of the robot is free", key="free", hint="Name some: --free 'joint_1.spring_*'", code="free")
    wrong = [key for key in limits.gains if key not in known]
    if wrong:
        raise InputError([Problem("is no parameter of the robot", key=f"choose.{key}", code="choose") for key in wrong])
    remarks = [f"{key} belongs to a recording: no motion is designed for it" for key in own]
    return scenario, given, make_layout(free, ties, ["design"], [{}]), remarks


def _of_recordings(fit: Fit, layout: Layout) -> Array:
    """(n, n) Fisher matrix of recordings, after what belongs to the recordings themselves is estimated too."""
    whole = fit.whole
    slopes = jacobian(whole, np.zeros(len(whole.layout)))
    matrix = slopes.T @ slopes
    keys = [entry.parameter.key for entry in layout.entries]
    shared = [entry.parameter.key if entry.track is None else "" for entry in whole.layout.entries]
    mine, others = [shared.index(key) for key in keys], [i for i, key in enumerate(shared) if key not in keys]
    cross = matrix[np.ix_(mine, others)]
    return np.asarray(matrix[np.ix_(mine, mine)] - cross @ np.linalg.pinv(matrix[np.ix_(others, others)]) @ cross.T)


def off(layout: Layout, generator: np.random.Generator, *, corner: bool = False) -> Array:
    """A robot whose numbers are each off by a factor of :data:`FACTOR` at most; corner: each by all of it."""
    exponents = generator.choice([-1.0, 1.0], len(layout)) if corner else generator.uniform(-1.0, 1.0, len(layout))
    places = [entry.place(entry.value(0.0) * FACTOR**e) for entry, e in zip(layout.entries, exponents, strict=True)]
    return np.clip(places, *layout.bounds)


def _choices(limits: Limits) -> Iterator[dict[str, float]]:
    table = list(product(*limits.gains.values()))
    if len(table) > MANY:
        raise InputError(f"{len(table)} choices of gains are more than {MANY}", key="choose", code="choose")
    return (dict(zip(limits.gains, values, strict=True)) for values in table)


def _probe(search: Search) -> None:
    """Raises InputError where the start breaks limits, no segment keeps them, or a number changes nothing."""
    plant = search.plant
    home = np.array([[one.home] * (round(PROBE / plant.step) + 1) for one in plant.references])
    resting = search.play(home, checked=True)
    if resting is None:
        raise InputError("the motion at the start is not sane", key="limits", code="start-limit")
    if resting.use.max(initial=0.0) > 1.0:
        bound = plant.bounds[int(np.argmax(resting.use))]
        message = f"the robot exceeds it at {resting.when:.3g} s while its references stand still: {bound.quantity} reaches "
        message += f"{resting.use.max():.3g} times its limit"
        hint = None if plant.scenario.initial_equilibrium else "Let it begin at rest: `initial: equilibrium` in the scenario"
        raise InputError(message, key=f"limits.{bound.joint}.{bound.quantity}", hint=hint, code="start-limit")
    search.extend(FIRST)
    if not search.library:
        raise InputError("no motion keeps them", key="limits", code="limits")
    seen = np.diagonal(sum(one.information[0].sum(axis=0) for one in search.library) + search.known)
    none = [entry.name for entry, shown in zip(plant.layout.entries, seen, strict=True) if shown < 1e-8]
    if none:
        message = "no motion shows it: nothing that is recorded depends on it"
        raise InputError([Problem(message, key=key, hint="Do not free it, or record more", code="no-effect") for key in none])


def _searched(
    searches: Sequence[Search], rounds: int, progress: Callable[[float], None]
) -> tuple[Search, Found, list[Found], list[str]]:
    """The search with the best gains, its best motion, plain motions, and a remark about each choice of gains."""
    tried: list[tuple[Search, Found]] = []
    several = len(searches) > 1
    for i, one in enumerate(searches if several else []):
        if (short := one.run(rounds // 5)) is not None:
            tried.append((one, short))
        progress(0.5 * (i + 1) / len(searches))
    search = min(tried, key=lambda pair: pair[1].score)[0] if tried else searches[0]
    longest = search.run(rounds, lambda share: progress(0.5 + 0.5 * share if several else share))
    plain = search.plain()
    candidates = [*(found for one, found in tried if one is search), *([longest] if longest else []), *plain]
    if not candidates:
        message = (
            "no motion that was tried keeps the limits, with information that small and larger changes of numbers agree on"
        )
        raise InputError(message, key="limits", code="limits")
    remarks = [f"gains: {_named(search.gains)}"] if several else []
    remarks += [f"with {_named(one.gains)}: ± {196.0 * np.exp(found.score):.2g} % in the mean" for one, found in tried]
    return search, min(candidates, key=lambda one: one.score), plain, remarks


def _named(gains: Mapping[str, float]) -> str:
    return ", ".join(f"{key} = {value:g}" for key, value in gains.items())


def _size(entry: Entry) -> float:
    """Change by a step of the vector, over the value, or over its typical size where the value is zero."""
    return float(entry.slope(0.0) / (abs(entry.value(0.0)) or entry.parameter.size))
