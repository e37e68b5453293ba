"""A design from beginning to end: files read, the information of earlier recordings, gains tried, the motion found and told."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.design.limits import Limits, located, read_limits
from asrsim.design.plant import PROBE, Plant, Reference
from asrsim.design.search import PRIOR, Found, Search
from asrsim.document.mistaken import kind_of
from asrsim.errors import InputError, Problem
from asrsim.identification.keys import CLOCK, free_parameters, parameters_of
from asrsim.identification.layout import Layout, make_layout
from asrsim.identification.problem import jacobian
from asrsim.identification.setup import set_up
from asrsim.identification.task import Experiment, Task, task_of
from asrsim.identification.track import NOT_THE_ROBOTS
from asrsim.samples import Array
from asrsim.scenario.data import Scenario
from asrsim.workers import one_thread

ROUNDS = 30
"""Rounds of the search; a fifth of them for each choice of gains."""
SHORTEST = 0.5
"""s of an experiment."""
CHECKS = 24
"""Further robots on which a robust design keeps its limits."""
FACTOR = 2.0
"""By which numbers may be off that a robust design knows about."""
MANY = 27
"""Choices of gains that are tried."""
WANTED = 0.05
"""Interval for which the needed time is told."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Design:
    """A motion, and what it promises."""

    task: Task
    scenario: Scenario
    references: tuple[Reference, ...]
    step: float
    seconds: float
    gains: Mapping[str, float]
    keys: tuple[str, ...]
    found: Found
    plain: tuple[Found, ...]
    """The best step and chirp within the same limits."""
    intervals: Mapping[str, Array]
    """`design`, plain motions, sensors: half of the 95 % interval of each key, as a share of its value or typical size."""
    choices: tuple[tuple[Mapping[str, float], float], ...]
    """Gains, and the geometric mean of the intervals that a short search found with them."""
    untold: tuple[str, ...]
    remarks: tuple[str, ...]
    interrupted: bool

    @property
    def needed(self) -> Array:
        """s after which each interval is :data:`WANTED`, if the motion is repeated."""
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
    """The motion of the references that tells most of the free numbers, within limits.

    Args:
        scenario: Scenario, with `free` among the options, or a fit file, whose recordings count as made.
        limits: File with `limits:`, and `noise:` and `choose:`.
        seconds: Length of the experiment.
        after: Recordings that there are.
        robust: Further draws of the free numbers, each within a factor of 2, on which the motion is to tell much and keep its
            limits.
        rounds, seed: Of the search.
        progress: Told the share that is done. stop: asked; True ends the search with the best so far.
        options: As :func:`asrsim.identification.task_of` takes them.

    Raises:
        InputError: What is wrong with the files; nothing that is free moves anything; no motion keeps the limits.
    """
    read = read_limits(Path(limits))
    task = _task(Path(scenario), after, options)
    with one_thread(), ExitStack() as stack:
        layout, known, remarks, ready, given = _prepared(task, read, stack)
        if not seconds >= SHORTEST:
            message = f"is too short for any segment: a motion that begins and ends at rest takes {SHORTEST:g} s"
            raise InputError(message, key="seconds", value=seconds, code="seconds")
        try:
            plant = Plant(ready, given, layout, read, seconds)
        except InputError as error:
            raise InputError(located(error.problems, Path(limits))) from None
        stack.callback(plant.close)
        if not plant.references:
            raise InputError("no joint with a reference has limits", file=Path(limits), key="limits", code="nothing-driven")
        generator = np.random.default_rng(seed)
        draws = [np.zeros(len(layout)), *(_draw(layout, generator) for _ in range(robust))]
        checks = [_draw(layout, generator, corner=i % 2 == 0) for i in range(CHECKS if robust else 0)]
        table = [dict(zip(read.gains, values, strict=True)) for values in product(*read.gains.values())]
        if len(table) > MANY:
            message = f"{len(table)} choices of gains are more than {MANY}"
            raise InputError(message, file=Path(limits), key="choose", code="choose")
        searches = [
            Search(plant, gains, draws, checks, plant.substeps_of(gains, draws + checks), known, stop) for gains in table
        ]
        _probe(searches[0], Path(limits))
        return _designed(task, ready, read, searches, layout, remarks, rounds, seed, progress)


def _task(scenario: Path, after: Sequence[str | Path], options: Mapping[str, Any]) -> Task:
    files = tuple(Experiment(file=Path(one).absolute()) for one in after)
    if kind_of(scenario) == "fit":
        task = task_of(scenario, **options)
        return replace(task, experiments=task.experiments + files)
    # A task needs a recording; that there is none yet is what a design is for.
    return replace(task_of(scenario, [scenario], **options), experiments=files)


def _prepared(task: Task, limits: Limits, stack: ExitStack) -> tuple[Layout, Array, list[str], Scenario, Any]:
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
    remarks = [f"{key} is of a recording, and not designed for" for key in own]
    layout = make_layout(free, ties, ["design"], [{}])
    found = np.zeros((len(layout), len(layout)))
    if task.experiments:
        found = _of_recordings(set_up(task, stack).problem, layout)
        remarks.append(f"designed as what follows after {', '.join(one.file.name for one in task.experiments)}")
    wrong = [key for key in limits.gains if key not in known]
    if wrong:
        raise InputError([Problem("is no parameter of the robot", key=f"choose.{key}", code="choose") for key in wrong])
    return layout, found, remarks, scenario, given


def _of_recordings(problem: Any, layout: Layout) -> Array:
    """(n, n) Fisher matrix of recordings, without what is to be estimated of the recordings themselves."""
    whole = problem.whole
    slopes = jacobian(whole, np.zeros(len(whole.layout)), central=True)
    matrix = slopes.T @ slopes
    keys = [entry.parameter.key for entry in layout.entries]
    shared = [entry.parameter.key if entry.track is None else "" for entry in whole.layout.entries]
    mine, others = [shared.index(key) for key in keys], [i for i, key in enumerate(shared) if key not in keys]
    cross = matrix[np.ix_(mine, others)]
    return np.asarray(matrix[np.ix_(mine, mine)] - cross @ np.linalg.pinv(matrix[np.ix_(others, others)]) @ cross.T)


def _draw(layout: Layout, generator: np.random.Generator, *, corner: bool = False) -> Array:
    """Numbers each off by a factor of :data:`FACTOR` at most; corner: all of them by it."""
    exponents = generator.choice([-1.0, 1.0], len(layout)) if corner else generator.uniform(-1.0, 1.0, len(layout))
    places = [entry.place(entry.value(0.0) * FACTOR**e) for entry, e in zip(layout.entries, exponents, strict=True)]
    return np.clip(places, *layout.bounds)


def _probe(search: Search, limits: Path) -> None:
    """Raises InputError where the start breaks limits, or a number moves nothing."""
    plant, layout = search.plant, search.plant.layout
    home = np.array([[one.home] * (round(PROBE / plant.step) + 1) for one in plant.references])
    resting = search.told(home, information=False, everywhere=True)
    if resting is None or resting.use.max() > 1.0:
        joint = "" if resting is None else plant.joints[int(np.argmax(resting.use))]
        message = (
            "the robot breaks it at the start, at rest at its references" if joint else "the motion at the start is not sane"
        )
        raise InputError(located([Problem(message, key=f"limits.{joint}", code="start-limit")], limits))
    found = search.run(0, 0)
    if found is None:
        raise InputError("no motion keeps them", file=limits, key="limits", code="limits")
    seen = np.diagonal((found.information.sum(axis=1) + search.known)[0])
    none = [entry.name for entry, told in zip(layout.entries, seen, strict=True) if told < 1e-8]
    if none:
        message = "no motion shows it: nothing that is recorded depends on it"
        raise InputError([Problem(message, key=key, hint="Do not free it, or record more", code="no-effect") for key in none])


def _designed(
    task: Task, scenario: Scenario, limits: Limits, searches: Sequence[Search], layout: Layout, remarks: list[str], rounds: int,
    seed: int, progress: Callable[[float], None],
) -> Design:  # fmt: skip
    tried: list[tuple[Search, Found]] = []
    if len(searches) > 1:
        for i, one in enumerate(searches):
            if (short := one.run(rounds // 5, seed)) is not None:
                tried.append((one, short))
            progress(0.5 * (i + 1) / len(searches))
    search = min(tried, key=lambda pair: pair[1].score)[0] if tried else searches[0]
    ran = [found for one, found in tried if one is search]
    longest = search.run(rounds, seed, lambda share: progress(0.5 + 0.5 * share if tried else share))
    plain: dict[str, Found] = {}
    for motion in search.plain():
        if motion.name not in plain or motion.score < plain[motion.name].score:
            plain[motion.name] = motion
    everything = [*ran, *([longest] if longest else []), *plain.values()]
    if not everything:
        raise InputError("no motion keeps the limits that was tried", key="limits", code="limits")
    # What people record is a design, too, where nothing better was found.
    best = min(everything, key=lambda one: one.score)
    sizes = np.array([_relative(entry) for entry in layout.entries])

    def interval(matrix: Array) -> Array:
        variance = np.diagonal(np.linalg.inv(matrix + search.known + PRIOR * np.eye(len(layout))))
        return np.asarray(1.96 * np.sqrt(variance) * sizes)

    intervals = {"design": interval(best.information[0, 0])}
    intervals |= {name: interval(one.information[0, 0]) for name, one in plain.items()}
    for group, sensor in enumerate(limits.sensors, start=1):
        intervals[f"with {sensor}"] = interval(best.information[0, 0] + best.information[0, group])
    untold = [entry.name for entry, half in zip(layout.entries, intervals["design"], strict=True) if half > 1.0]
    return Design(
        task=task, scenario=scenario, references=search.plant.references, step=search.plant.step,
        seconds=(search.plant.rows - 1) * search.plant.step, gains=search.gains,
        keys=tuple(entry.name for entry in layout.entries), found=best, plain=tuple(plain.values()), intervals=intervals,
        choices=tuple((one.gains, float(1.96 * np.exp(found.score))) for one, found in tried), untold=tuple(untold),
        remarks=tuple(remarks), interrupted=search.stop(),
    )  # fmt: skip


def _relative(entry: Any) -> float:
    """Share of the value, or of its typical size where it is none, by which a step of the vector changes it."""
    return float(entry.slope(0.0) / (abs(entry.value(0.0)) or entry.parameter.size))
