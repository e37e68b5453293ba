"""A twin of the robot: the plant's masses, stiffnesses, losses and delay, fitted to recorded trials.

Least squares on simulations of the varied plant, with normal priors, since a trial excites little. The spread of the posterior,
with the misfit of the fit as noise, estimates how far the twin's forecast of the next trial may be off.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from asrsim.learning.optimal import averaged
from asrsim.learning.plant import Plant
from asrsim.learning.trial import Trial
from asrsim.robot.model import INERTIAS, Robot
from asrsim.samples import Array

SPREAD, LOSSES = 0.25, 0.7
"""Prior standard deviations of the logarithms of masses and stiffnesses, and of friction and damping."""
DELAY = 0.02
"""s, prior of the delay."""
NOISE = 1e-3
"""rad, misfit that a plant of the right structure leaves at least."""
SAMPLES = 250
"""Times at which the motion is compared."""
INDEPENDENT = 40
"""Misfits among those of a joint's samples that count as independent: what a model lacks lasts for some samples."""
ROUNDS = 4
"""Steps at most."""
NUDGE = 0.2
"""Step of the slopes, of the priors."""
LITTLE = 0.1
"""Share of the misfit whose gain ends the fit."""
DIVERGED = 1e3
"""rad, misfit where a plant diverged."""
LIKELY = 6
"""Plants drawn from the posterior."""

Forecast = Callable[[Array], Array]
"""Inputs (n, joints) -> expected outputs (n, joints)."""
Group = Mapping[tuple[str, str], float]
"""(joint or link, name) -> value, of numbers that are scaled together."""


@dataclass(frozen=True, kw_only=True)
class Twin:
    """The fitted plant."""

    plant: Plant = field(repr=False)
    changes: Mapping[str, float]
    """Group of numbers -> relative change; `delay` in s."""
    residual: float
    """rad, root mean square of the recorded motion that the twin does not explain."""
    before: float
    """rad, the same of the plant before the fit."""
    likely: tuple[Plant, ...] = field(repr=False)
    """Drawn from the posterior."""

    def forecasts(self, best: Trial) -> list[Forecast]:
        """By the twin, then by each likely plant: the best trial's outputs, changed as the plant's outputs change."""
        return [_forecast(plant, best) for plant in (self.plant, *self.likely)]


def _forecast(plant: Plant, best: Trial) -> Forecast:
    known = plant.outputs(best.inputs)
    return lambda inputs: np.asarray(best.outputs + plant.outputs(inputs) - known)


def fit_twin(plant: Plant, trials: Sequence[Trial], start: Mapping[str, float] | None = None) -> Twin:
    """The plant that gives the trials' outputs for their inputs; start: changes of an earlier twin to begin with."""
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

    # What a model lacks lasts for some samples, so that fewer of them count.
    scale = NOISE * np.sqrt(SAMPLES / INDEPENDENT)
    given = start or {}
    begin = np.array([*(np.log1p(given.get(name, 0.0)) for name in groups), given.get("delay", 0.0)])
    lowest = np.append(np.full(len(groups), -np.inf), -1e-9)
    found = least_squares(
        weighted, begin, slopes, bounds=(lowest, np.inf), x_scale=priors, ftol=LITTLE, max_nfev=ROUNDS + 1
    )  # fmt: skip
    residual, before = (float(np.sqrt(np.mean(misfit(x) ** 2))) for x in (found.x, np.zeros(len(priors))))
    jacobian = found.jac[: measured.size] * (NOISE / max(NOISE, residual))
    root = np.linalg.inv(np.linalg.cholesky(np.asarray(jacobian.T @ jacobian + np.diag(priors**-2))))
    steps = np.random.default_rng(0).standard_normal((LIKELY, len(priors))) @ root
    changes = {name: float(np.expm1(value)) for name, value in zip(groups, found.x, strict=False)}
    return Twin(
        plant=plant_of(found.x), changes=changes | {"delay": max(float(found.x[-1]), 0.0)}, residual=residual, before=before,
        likely=tuple(plant_of(found.x + step) for step in steps),
    )  # fmt: skip


def _groups(plant: Plant) -> dict[str, Group]:
    """What is fitted of each joint: the mass that it moves as one body, its springs, its friction and motors', its damping."""
    robot = plant.prepared.robot
    blocks = {block.joint: block.values() for block in robot.actuators}
    found: dict[str, Group] = {}
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


def _body(robot: Robot, joint: str) -> Group:
    """Masses and inertias of the links that the joint moves as one body."""
    body, waiting = {robot.joint(joint).child}, [robot.joint(joint).child]
    while waiting:
        fixed = [item.child for item in robot.carried.get(waiting.pop(), ()) if item.kind == "fixed"]
        body.update(fixed)
        waiting += fixed
    return {
        (link.name, name): value
        for link in robot.links if link.name in body and link.mass is not None and link.inertia is not None
        for name, value in (("mass", link.mass), *zip(INERTIAS, link.inertia, strict=True))
    }  # fmt: skip
