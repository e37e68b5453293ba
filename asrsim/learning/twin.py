"""A twin of the robot: a plant whose masses, stiffnesses, losses and delay are fitted to recorded trials.

The fit is a least-squares problem on simulations, with normal priors, since a trial excites few parameters. The posterior, with
the misfit as noise, gives the uncertainty of the predicted next trial.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from asrsim.learning.optimal import averaged
from asrsim.learning.plant import Plant
from asrsim.learning.trial import Trial
from asrsim.metrics.values import root_mean_square
from asrsim.robot.model import INERTIAS, Robot
from asrsim.samples import Array

SPREAD, LOSSES = 0.25, 0.7
"""Prior standard deviations of logarithms: of masses and stiffnesses, and of friction and damping."""
DELAY = 0.02
"""Prior standard deviation of the delay, s."""
NOISE = 1e-3
"""Smallest misfit that the uncertainty assumes, rad; even a plant with the right structure has this misfit."""
SAMPLES = 250
"""Number of points in time at which recorded and simulated motion are compared."""
INDEPENDENT = 40
"""Number of independent misfits for which each joint counts, since model errors are correlated over several samples."""
ROUNDS = 4
"""Largest number of steps of the fit."""
NUDGE = 0.2
"""Step of finite differences, as a fraction of the prior standard deviations."""
LITTLE = 0.1
"""Relative reduction of the misfit below which the fit ends."""
DIVERGED = 1e3
"""Misfit that is assigned to a plant that diverged, rad."""
LIKELY = 6
"""Number of plants drawn from the posterior."""

Forecast = Callable[[Array], Array]
"""Function from inputs (n, joints) to expected outputs (n, joints)."""
ParameterGroup = Mapping[tuple[str, str], float]
"""Values of parameters that are scaled together, by pairs (joint or link, name)."""


@dataclass(frozen=True, kw_only=True)
class LearningTwin:
    """A plant fitted to the robot, and the uncertainty of the fit."""

    plant: Plant = field(repr=False)
    changes: Mapping[str, float]
    """Relative change of each group of parameters, by name of the group; `delay`: change in s."""
    residual: float
    """Root mean square difference between the recorded motion and the twin's motion, rad."""
    before: float
    """Root mean square difference between recorded and simulated motion before the fit, rad."""
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
        """Predictions by the twin and by each likely plant: the best trial's outputs plus the change of the plant's outputs."""
        return [_forecast(plant, best) for plant in (self.plant, *self.likely)]


@dataclass(frozen=True, kw_only=True)
class Unexplained:
    """Part of recorded motions that a twin does not explain, rad. Predictions assume that it equals the unexplained part of the
    best trial.
    """

    most: float
    """Largest difference between the best trial and the twin's motion."""
    misses: tuple[tuple[float, float], ...]
    """A pair for each trial except the best one: its largest distance from the best trial, and the largest error of its
    prediction.
    """

    def of_change(self, size: float) -> float:
        """Bound of the error of a prediction whose motion differs by `size` rad from the best trial.

        The bound is the smallest of three: the predicted change, the unexplained part of the best trial, and the error of the
        prediction of a recorded trial that differs from the best trial at least as much.
        """
        return min(size, self.most, *(miss for distance, miss in self.misses if distance >= size))


def largest(values: Array) -> float:
    """Largest magnitude; infinite if a value is not finite."""
    return float(np.abs(values).max()) if np.isfinite(values).all() else np.inf


def _forecast(plant: Plant, best: Trial) -> Forecast:
    known = plant.outputs(best.inputs)
    return lambda inputs: np.asarray(best.outputs + plant.outputs(inputs) - known)


def fit_twin(plant: Plant, trials: Sequence[Trial], start: Mapping[str, float]) -> LearningTwin:
    """Plant fitted to the inputs and outputs of trials. start: changes of an earlier twin, where the fit starts; empty: the
    unchanged plant.
    """
    from scipy.optimize import least_squares

    rows = np.linspace(0.0, float(plant.time[-1]), SAMPLES + 1)[1:]
    measured = np.concatenate([averaged(plant.time, trial.outputs, rows) for trial in trials])
    groups = _groups(plant)
    lossy = [name.startswith(("friction", "damping")) for name in groups]
    priors = np.append(np.where(lossy, LOSSES, SPREAD), DELAY)

    def plant_of(x: Array) -> Plant:
        numbers: dict[str, dict[str, float]] = {}
        for group, value in zip(groups.values(), x, strict=False):
            for (owner, name), known in group.items():
                numbers.setdefault(owner, {})[name] = known * float(np.exp(value))
        return plant.varied(numbers, max(float(x[-1]), 0.0))

    def misfit(x: Array) -> Array:
        robot = plant_of(x)
        found = np.concatenate([averaged(plant.time, robot.outputs(trial.inputs), rows) for trial in trials])
        return np.asarray(np.nan_to_num(found - measured, nan=DIVERGED).ravel())

    def weighted(x: Array) -> Array:
        return np.concatenate([misfit(x) / scale, x / priors])

    def slopes(x: Array) -> Array:
        here = weighted(x)
        return np.column_stack([(weighted(x + nudge) - here) / nudge.max() for nudge in np.diag(NUDGE * priors)])

    # Model errors are correlated over several samples, so the number of independent samples is smaller.
    scale = NOISE * np.sqrt(SAMPLES / INDEPENDENT)
    begin = np.array([*(np.log1p(start.get(name, 0.0)) for name in groups), start.get("delay", 0.0)])
    lowest = np.append(np.full(len(groups), -np.inf), -1e-9)
    found = least_squares(weighted, begin, slopes, bounds=(lowest, np.inf), x_scale=priors, ftol=LITTLE, max_nfev=ROUNDS + 1)
    residual, before = (root_mean_square(misfit(x)) for x in (found.x, np.zeros(len(priors))))
    jacobian = found.jac[: measured.size] * (NOISE / max(NOISE, residual))
    root = np.linalg.inv(np.linalg.cholesky(np.asarray(jacobian.T @ jacobian + np.diag(priors**-2))))
    steps = np.random.default_rng(0).standard_normal((LIKELY, len(priors))) @ root
    changes = {name: float(np.expm1(value)) for name, value in zip(groups, found.x, strict=False)}
    return LearningTwin(
        plant=plant_of(found.x),
        changes=changes | {"delay": max(float(found.x[-1]), 0.0)},
        residual=residual,
        before=before,
        likely=tuple(plant_of(found.x + step) for step in steps),
    )


def _groups(plant: Plant) -> dict[str, ParameterGroup]:
    """Fitted groups of parameters of each joint: mass of its body, springs, friction of joint and motors, damping."""
    robot = plant.prepared.robot
    blocks = {block.joint: block.values() for block in robot.actuators}
    found: dict[str, ParameterGroup] = {}
    for drive in plant.drives:
        joint = drive.name
        found[f"mass.{joint}"] = _body(robot, joint)
        units = {one.name: one.unit for one in drive.actuator.parameters} if drive.actuator else {}
        springs = {(joint, name): blocks[joint][name] for name, unit in units.items() if "N m" in unit}
        found[f"stiffness.{joint}"] = springs
        rubbing = {(joint, name): v for name, v in blocks[joint].items() if name.endswith("_friction_torque")}
        found[f"friction.{joint}"] = {(joint, "friction"): robot.joint(joint).friction, **rubbing}
        found[f"damping.{joint}"] = {(joint, "damping"): robot.joint(joint).damping}
    return {name: group for name, group in found.items() if any(group.values())}


def _body(robot: Robot, joint: str) -> ParameterGroup:
    """Masses and inertias of the links that move with the joint as one body."""
    body, waiting = {robot.joint(joint).child}, [robot.joint(joint).child]
    while waiting:
        fixed = [item.child for item in robot.carried.get(waiting.pop(), ()) if item.kind == "fixed"]
        body.update(fixed)
        waiting += fixed
    return {
        (link.name, name): value
        for link in robot.links
        if link.name in body and link.mass is not None and link.inertia is not None
        for name, value in (("mass", link.mass), *zip(INERTIAS, link.inertia, strict=True))
    }
