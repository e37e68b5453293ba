"""Design of an experiment: information of earlier recordings, choice of gains, and search for the motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.designs.limits import located, read_limits
from asrsim.designs.plant import DesignPlant, Reference
from asrsim.designs.search import DESIGN, PRIOR, SMALL, Found, Search
from asrsim.document.file import kind_of
from asrsim.errors import InputError, Problem
from asrsim.identification.parameters import Layout, free_parameters, make_layout, numbers_of, parameters_of
from asrsim.identification.problem import FitProblem, jacobian, read_scenario, set_up
from asrsim.identification.task import Experiment, Task, task_of
from asrsim.progress import Progress, Stop, Tell, never, tell_nobody
from asrsim.quantities import each_motor
from asrsim.renamed import renamed
from asrsim.robot.model import Robot
from asrsim.samples import Array
from asrsim.scenario.data import Scenario
from asrsim.workers import one_thread

ROUNDS = 10
"""Number of rounds of the search with the best gains. First, each choice of gains is tried for a fifth of this number."""
SHORTEST, PROBE = 0.5, 0.2
"""SHORTEST: duration of the shortest experiment, s.
PROBE: time for which a robot must keep the limits while its references are constant, s.
"""
TRIED = 12
"""Number of random pieces that are tried after the chirps. A parameter counts as without effect if it had no effect in any of
them.
"""
CHECKS, FACTOR = 48, 2.0
"""CHECKS: number of further robots on which a robust design must keep the limits.
FACTOR: largest factor by which the parameters of further robots differ from the model.
"""
WANTED = 0.05
"""Half width of a 95 % interval, relative to the value, for which the necessary duration is computed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Design:
    """A designed motion, with the predicted intervals of the parameters."""

    scenario: Scenario
    references: tuple[Reference, ...]
    step: float
    gains: Mapping[str, float]
    keys: tuple[str, ...]
    found: Found
    intervals: Mapping[str, Array]
    """Half widths (n,) of the 95 % intervals, relative to each parameter's value or typical size. The keys are `design`, the
    names of plain motions, and `with SENSOR` for each additional sensor.
    """
    remarks: tuple[str, ...]
    interrupted: bool

    @property
    def seconds(self) -> float:
        """Duration of the motion, s."""
        return float(self.found.motion.shape[1] - 1) * self.step

    @property
    def needed(self) -> Array:
        """For each parameter, the duration for which the motion must be repeated so that the half width of the parameter's
        interval falls to `WANTED`, s. It is at least `SHORTEST`.
        """
        return np.asarray(np.maximum(SHORTEST, self.seconds * (self.intervals[DESIGN] / WANTED) ** 2))


@renamed(seconds="duration", after="experiments")
def design(
    scenario: str | Path,
    limits: str | Path,
    *,
    duration: float = 10.0,
    experiments: Sequence[str | Path] = (),
    robust: int = 0,
    rounds: int = ROUNDS,
    seed: int = 0,
    progress: Tell = tell_nobody,
    stop: Stop = never,
    **options: Any,
) -> Design:
    """Design of the motion within limits that gives the smallest intervals of the free parameters.

    Args:
        scenario: Scenario, for which `options` contain `free`; or a fit file, whose recordings count as earlier experiments.
        limits: Limits file, with the keys `limits`, `noise`, `rate` and `choose`.
        duration: Duration of the experiment, s.
        experiments: Recordings of earlier experiments.
        robust: Number of further robots for which the motion is also designed. Their parameters differ from the model by up to
        a factor of 2.
        rounds, seed: Number of rounds of the search, and its random seed.
        progress: Function that is called with the finished fraction of the search.
        stop: Function that is called often. If it returns True, the search ends with the best motion so far.
        options: Options of `asrsim.identification.task_of`.

    Raises:
        InputError: A file is wrong, no recorded quantity depends on one of the free parameters, or no motion keeps the limits.
    """
    path, read = Path(limits), read_limits(Path(limits))
    if not duration >= SHORTEST:
        message = f"is too short: a motion that begins and ends at rest takes at least {SHORTEST:g} s"
        raise InputError(message, key="duration", value=duration, code="duration")
    task = design_task(Path(scenario), experiments, options)
    with one_thread(), ExitStack() as stack:
        ready, robot, layout, remarks = read_task(task)
        known = np.zeros((len(layout), len(layout)))
        if task.experiments:
            known = _of_recordings(set_up(task, stack).problem, layout)
            remarks.append(f"designed for a fit together with {', '.join(one.file.name for one in task.experiments)}")
        with located(path):
            generator = np.random.default_rng(seed)
            robots = [np.zeros(len(layout)), *(altered(layout, generator) for _ in range(robust))]
            robots += [altered(layout, generator, corner=i % 2 == 0) for i in range(CHECKS if robust else 0)]
            plant = DesignPlant(ready, robot, layout, read, duration, robots)
            stack.callback(plant.close)
            choices = [plant.under(dict(zip(read.gains, gains, strict=True))) for gains in product(*read.gains.values())]
            searches = [Search(one, 1 + robust, known, np.random.default_rng(seed), stop) for one in choices]
            _probe(searches[0])
        search, best, tried = _searched(searches, rounds, progress)
        # The interval of a parameter is relative to its value or, if the value is 0, to the parameter's typical size.
        sizes = np.array([one.slope(0.0) / (abs(one.value(0.0)) or one.size) for one in layout.entries])
        known_by = {DESIGN: best.information}
        known_by |= {name: one.information for name, one in search.motions.items() if name != DESIGN}
        for sensor in read.sensors:
            more = search.plant.play(best.motion, search.robots, changes=SMALL, sensor=sensor)
            if more is not None and more.information is not None:
                known_by[f"with {sensor}"] = best.information + more.information
        intervals = {name: 1.96 * search.deviations(one)[0] * sizes for name, one in known_by.items()}
        keys = tuple(entry.name for entry in layout.entries)
        unknown = [key for key, half in zip(keys, intervals[DESIGN], strict=True) if half > 1.0]
        remarks += [*tried, *([f"this motion does not identify: {', '.join(unknown)}"] if unknown else [])]
        if best.name != DESIGN:
            remarks.append(f"no designed motion is better than this plain motion: {best.name}")
        return Design(
            scenario=ready,
            references=plant.references,
            step=plant.step,
            gains=search.plant.gains,
            keys=keys,
            found=best,
            intervals=intervals,
            remarks=tuple(remarks),
            interrupted=stop(),
        )


def design_task(scenario: Path, experiments: Sequence[str | Path], options: Mapping[str, Any]) -> Task:
    """Task of `asrsim identify` from a scenario or a fit file, with the earlier recordings. Raises InputError."""
    files = tuple(Experiment(file=Path(one).absolute()) for one in experiments)
    if kind_of(scenario) == "fit":
        task = task_of(scenario, **options)
        return replace(task, experiments=task.experiments + files)
    # `task_of` requires a recording, but a design may precede the first recording. Therefore name the scenario as a recording,
    # and replace it.
    return replace(task_of(scenario, [scenario], **options), experiments=files)


def read_task(task: Task) -> tuple[Scenario, Robot, Layout, list[str]]:
    """Scenario of a task, robot of the robot file, layout of the free parameters, and remarks. Raises InputError."""
    scenario, given, robot = read_scenario(task)
    joints = [joint.name for joint in robot.moving_joints]
    known = parameters_of(
        robot,
        [f"{joint}.{name}" for joint in joints for name in each_motor("reference_{}")],
        {f"{joint}.{name}": "" for joint in joints for name in ("link_position", *each_motor("motor_{}_position"))},
    )
    free, ties = free_parameters(task, known)
    own = [one.key for one in free if one.own or not numbers_of({one.key: one.start})]
    free = [one for one in free if one.key not in own]
    if not free:
        raise InputError(
            "no parameter of the robot is free", key="free", hint="Name parameters: --free 'joint_1.spring_*'", code="free"
        )
    remarks = [f"{key} belongs to a recording, so the design ignores it" for key in own]
    return scenario, given, make_layout(free, ties, ["design"], [{}], [{}]), remarks


def _of_recordings(fit: FitProblem, layout: Layout) -> Array:
    """Fisher matrix (n, n) of the robot's parameters from recordings. The parameters of the recordings, such as offsets, are
    estimated, too.
    """
    whole = fit.whole
    slopes = jacobian(whole, np.zeros(len(whole.layout)))
    covariance = np.linalg.inv(slopes.T @ slopes + PRIOR * np.eye(slopes.shape[1]))
    shared = [entry.key if entry.track is None else "" for entry in whole.layout.entries]
    mine = [shared.index(entry.key) for entry in layout.entries]
    return np.asarray(np.linalg.inv(covariance[np.ix_(mine, mine)]) - PRIOR * np.eye(len(mine)))


def altered(layout: Layout, generator: np.random.Generator, *, corner: bool = False) -> Array:
    """Parameter vector of a robot that differs from the model. Each parameter is multiplied or divided by a random factor of up
    to `FACTOR`. corner: whether the factor is always `FACTOR`.
    """
    exponents = generator.choice([-1.0, 1.0], len(layout)) if corner else generator.uniform(-1.0, 1.0, len(layout))
    places = [entry.place(entry.value(0.0) * FACTOR**e) for entry, e in zip(layout.entries, exponents, strict=True)]
    return np.clip(places, *layout.bounds)


def _probe(search: Search) -> None:
    """Raise InputError if the robot exceeds limits at rest, if no motion keeps the limits, or if no recorded quantity depends
    on one of the parameters.
    """
    plant = search.plant
    home = np.array([[one.home] * (round(PROBE / plant.step) + 1) for one in plant.references])
    resting = plant.play(home, len(plant.robots))
    if resting is None:
        raise InputError("the simulation of the resting robot diverges", key="limits", code="start-limit")
    if resting.use.max(initial=0.0) > 1.0:
        bound = plant.bounds[int(np.argmax(resting.use))]
        message = "the robot exceeds this limit while its references are constant: "
        message += f"{bound.quantity} reaches {resting.use.max():.3g} times its limit"
        hint = None if plant.scenario.initial_equilibrium else "Let it begin at rest: `initial: equilibrium` in the scenario"
        raise InputError(message, key=f"limits.{bound.joint}.{bound.quantity}", hint=hint, code="start-limit")
    search.start()
    search.try_fresh(TRIED)
    tried = [*search.motions.values(), *search.library]
    if not tried:
        raise InputError("every motion that was tried exceeds the limits", key="limits", code="limits")
    seen = np.diagonal(sum(one.information[0] for one in tried) + search.known)
    none = [entry.name for entry, shown in zip(plant.layout.entries, seen, strict=True) if shown < 1e-8]
    if none:
        message, hint = (
            "no motion identifies it: no recorded quantity depends on it",
            "Do not free it, or record more quantities",
        )
        raise InputError([Problem(message, key=key, hint=hint, code="no-effect") for key in none])


def _searched(searches: Sequence[Search], rounds: int, progress: Tell) -> tuple[Search, Found, list[str]]:
    """Search with the best gains, its best motion, and a remark on each choice of gains. Raises InputError."""
    several, remarks = len(searches) > 1, []
    for i, one in enumerate(searches if several else []):
        one.run(rounds // 5)
        progress(Progress(task="search", fraction=0.5 * (i + 1) / len(searches)))
        if one.best is not None:
            named = ", ".join(f"{key} = {value:g}" for key, value in one.plant.gains.items())
            remarks.append(f"with {named}: intervals of ± {196.0 * np.exp(one.rank(one.best)):.2g} % on average")
    search = min(searches, key=lambda one: np.inf if one.best is None else one.rank(one.best))
    begin = 0.5 if several else 0.0
    best = search.run(rounds, lambda told: progress(replace(told, fraction=begin + (1.0 - begin) * told.fraction)))
    if best is None:
        message = (
            "every motion that was tried exceeds the limits, or its intervals differ between small and large changes of the "
            "parameters"
        )
        hint = "Widen the limits, free fewer parameters, or add damping to the scenario"
        raise InputError(message, key="limits", hint=hint, code="limits")
    if several:
        remarks.insert(0, "gains: " + ", ".join(f"{key} = {value:g}" for key, value in search.plant.gains.items()))
    return search, best, remarks
