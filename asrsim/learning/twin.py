"""A twin of the robot: a plant whose masses, stiffnesses, friction, damping and command delay are fitted to recorded trials.

`asrsim.identification` makes the fit. The parameters have normal priors, since a trial excites few parameters. The posterior
gives the uncertainty of the predicted next trial; the misfit counts as its noise.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from asrsim.identification.data import Channel, Data, PlayedCommand
from asrsim.identification.parameters import FitParameter, Layout, numbers_of, parameters_of
from asrsim.identification.problem import FitProblem, Meter, posterior_draws, residuals, solve
from asrsim.identification.task import Tie
from asrsim.identification.track import Playing, Track
from asrsim.learning.plant import Plant
from asrsim.learning.trial import Trial
from asrsim.metrics.values import root_mean_square
from asrsim.robot.model import INERTIAS, Robot
from asrsim.samples import Array

SPREAD, LOSSES = 0.25, 0.7
"""SPREAD: prior standard deviation of the logarithms of masses and stiffnesses.
LOSSES: prior standard deviation of the logarithms of friction and damping.
"""
DELAY, BEGIN = 0.02, 0.01
"""DELAY: prior standard deviation of the delay, s.
BEGIN: smallest delay at which the fit starts, s. From the bound 0 the search would only take small steps.
"""
NOISE = 1e-3
"""Smallest misfit that is assumed for the uncertainty, rad. Even a plant with the right structure has this misfit."""
INDEPENDENT = 40
"""Number of independent residuals to which the residuals of each joint are equivalent, since model errors are correlated over
several samples.
"""
ROUNDS, LITTLE = 10, 1e-2
"""ROUNDS: largest number of evaluations of the fit.
LITTLE: the fit ends if a step reduces the misfit by less than this fraction.
"""
LIKELY = 6
"""Number of plants that are drawn from the posterior."""

Forecast = Callable[[Array], Array]
"""Function from inputs (n, joints) to predicted outputs (n, joints)."""
ParameterGroup = Mapping[str, float]
"""Values of parameters that are scaled together, by key."""


@dataclass(frozen=True, kw_only=True)
class LearningTwin:
    """A plant that was fitted to the robot, with the uncertainty of the fit."""

    plant: Plant = field(repr=False)
    changes: Mapping[str, float]
    """Relative change of each group of parameters, by name of the group. The value of `delay` is the additional delay of
    commands, s.
    """
    residual: float
    """Root mean square difference between the recorded motion and the twin's motion, rad."""
    before: float
    """Root mean square difference between the recorded motion and the simulated motion before the fit, rad."""
    likely: tuple[Plant, ...] = field(repr=False)
    """Plants drawn from the posterior."""

    def unexplained(self, best: Trial, trials: Sequence[Trial]) -> Unexplained:
        """Part of the recorded trials that this twin does not explain."""
        forecast, others = _forecast(self.plant, best), [trial for trial in trials if trial is not best]
        return Unexplained(
            most=largest(best.outputs - self.plant.outputs(best.inputs)),
            misses=tuple((largest(t.outputs - best.outputs), largest(t.outputs - forecast(t.inputs))) for t in others),
        )

    def forecasts(self, best: Trial) -> list[Forecast]:
        """Predictions by the twin and by each likely plant. A prediction is the best trial's outputs, plus the change of the
        plant's outputs from the best trial's inputs to the new inputs.
        """
        return [_forecast(plant, best) for plant in (self.plant, *self.likely)]


@dataclass(frozen=True, kw_only=True)
class Unexplained:
    """Part of the recorded motions that a twin does not explain, rad. Predictions assume that the unexplained part of the next
    trial is equal to the unexplained part of the best trial.
    """

    most: float
    """Largest difference between the best trial and the twin's motion."""
    misses: tuple[tuple[float, float], ...]
    """For each trial except the best one, a pair: largest distance of its outputs from the best trial's outputs, and largest
    error of its prediction.
    """

    def of_change(self, size: float) -> float:
        """Bound of the error of a predicted motion that differs from the best trial by up to `size` rad.

        The bound is the smallest of these values: the predicted change `size`, the unexplained part of the best trial, and the
        prediction errors of recorded trials that differ from the best trial by at least `size`.
        """
        return min(size, self.most, *(miss for distance, miss in self.misses if distance >= size))


def largest(values: Array) -> float:
    """Largest magnitude; infinite if a value is not finite."""
    return float(np.abs(values).max()) if np.isfinite(values).all() else np.inf


def _forecast(plant: Plant, best: Trial) -> Forecast:
    known = plant.outputs(best.inputs)
    return lambda inputs: np.asarray(best.outputs + plant.outputs(inputs) - known)


def fit_twin(plant: Plant, trials: Sequence[Trial], start: Mapping[str, float]) -> LearningTwin:
    """Plant that is fitted to the inputs and outputs of trials. start: `changes` of an earlier twin, at which the fit starts;
    empty: the fit starts at the unchanged plant.
    """
    groups = _groups(plant)
    with ExitStack() as stack:
        problem = _problem(plant, trials, [*groups.values()], stack)
        *parameters, delay = problem.layout.entries
        begin = np.array(
            [*(np.log1p(start.get(name, 0.0)) for name in groups), max(start.get("delay", 0.0), BEGIN) / delay.size]
        )
        x = solve(problem, begin, rounds=ROUNDS, tolerance=LITTLE)
        size = problem.weights[0][0]
        residual, before = (size * root_mean_square(residuals(problem, one)) for one in (x, np.zeros(len(x))))
        # Draw from the posterior with the misfit as noise.
        wide = tuple(tuple(max(residual / NOISE, 1.0) * one for one in own) for own in problem.weights)
        draws = posterior_draws(replace(problem, weights=wide), x, LIKELY)

    def plant_of(x: Array) -> Plant:
        values = problem.layout.table(x, 0)
        return plant.varied(numbers_of(values), values[delay.key])

    changes = {
        name: value / one.start - 1.0 for name, one, value in zip(groups, parameters, problem.layout.values(x), strict=False)
    }
    return LearningTwin(
        plant=plant_of(x),
        changes=changes | {"delay": delay.value(float(x[-1]))},
        residual=residual,
        before=before,
        likely=tuple(map(plant_of, draws)),
    )


def _problem(plant: Plant, trials: Sequence[Trial], groups: Sequence[ParameterGroup], stack: ExitStack) -> FitProblem:
    """Problem of fitting groups of parameters and the delay of the commands to trials. One free parameter scales each group."""
    prepared, commands = plant.prepared, [f"{joint}.reference_1" for joint in plant.joints]
    known = parameters_of(prepared.robot, commands, {})
    free, ties = list[FitParameter](), list[Tie]()
    for group in groups:
        first = max(group, key=lambda key: group[key])
        spread = LOSSES if first.endswith(("friction", "friction_torque", "damping")) else SPREAD
        free.append(replace(known[first], logarithmic=True, low=0.0, high=np.inf, spread=spread))
        ties += [Tie(key=key, to=first, factor=value / group[first]) for key, value in group.items() if key != first]
    first_delay, *delays = (f"{command}.delay" for command in commands)
    delay = known[first_delay]
    free.append(replace(delay, low=0.0, spread=DELAY / delay.size))
    ties += [Tie(key=one, to=first_delay) for one in delays]
    # Increase the noise, since model errors are correlated over several samples and fewer samples are independent.
    noise = NOISE * (len(plant.time) / INDEPENDENT) ** 0.5
    tracks = [Track(prepared.scenario, plant.robot, _recorded(plant, trial, noise), stated=True) for trial in trials]
    for track in tracks:
        stack.callback(track.close)
    count = len(tracks)
    return FitProblem(
        tracks=tuple(tracks), layout=Layout(tuple(free), tuple(ties)), playing=Playing(tracks[0].door.substeps),
        weights=((noise,) * len(plant.joints),) * count, ends=(float(plant.time[-1]),) * count, meter=Meter(),
    )  # fmt: skip


def _recorded(plant: Plant, trial: Trial, noise: float) -> Data:
    """A trial as a recording. The commands of the recording are the inputs of the trial, and its channels are
    the outputs. noise: standard deviation of the channels' noise, rad or m.
    """
    joints = list(zip(plant.joints, plant.names(), map(plant.unit, plant.joints), strict=True))
    return Data(
        name=f"trial {trial.number}", path=plant.scenario.path or Path(), duration=plant.scenario.duration,
        modes={}, torques={},
        channels=tuple(
            Channel(
                joint=joint, quantity="link_position", unit=unit, time=plant.time, values=values, noise=noise, quantum=0.0
            )
            for (joint, _, unit), values in zip(joints, trial.outputs.T, strict=True)
        ),
        commands=tuple(
            PlayedCommand(
                joint=joint, quantity="reference_1", name=name, unit=unit, time=plant.time, values=values, hold=False
            )
            for (joint, name, unit), values in zip(joints, trial.inputs.T, strict=True)
        ),
    )  # fmt: skip


def _groups(plant: Plant) -> dict[str, ParameterGroup]:
    """Groups of parameters that are fitted for each joint: inertial parameters of its body, springs, friction of joint and
    motors, and damping. Groups whose parameters are all 0 are left out.
    """
    robot = plant.prepared.robot
    blocks = {block.joint: block.values() for block in robot.actuators}
    found: dict[str, ParameterGroup] = {}
    for drive in plant.drives:
        joint = drive.name
        found[f"mass.{joint}"] = _body(robot, joint)
        units = {one.name: one.unit for one in drive.actuator.parameters} if drive.actuator else {}
        found[f"stiffness.{joint}"] = {f"{joint}.{name}": blocks[joint][name] for name, unit in units.items() if "N m" in unit}
        rubbing = {f"{joint}.{name}": v for name, v in blocks[joint].items() if name.endswith("_friction_torque")}
        found[f"friction.{joint}"] = {f"{joint}.friction": robot.joint(joint).friction, **rubbing}
        found[f"damping.{joint}"] = {f"{joint}.damping": robot.joint(joint).damping}
    return {name: group for name, group in found.items() if max(group.values(), default=0.0) > 0.0}


def _body(robot: Robot, joint: str) -> ParameterGroup:
    """Masses and moments of inertia of the links that the joint moves as one body."""
    body, waiting = {robot.joint(joint).child}, [robot.joint(joint).child]
    while waiting:
        fixed = [item.child for item in robot.carried.get(waiting.pop(), ()) if item.kind == "fixed"]
        body.update(fixed)
        waiting += fixed
    return {
        f"{link.name}.{name}": value
        for link in robot.links
        if link.name in body and link.mass is not None and link.inertia is not None
        for name, value in (("mass", link.mass), *zip(INERTIAS, link.inertia, strict=True))
    }
