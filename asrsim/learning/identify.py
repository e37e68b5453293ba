"""A twin of the robot: the plant's masses, stiffnesses, losses and delay, fitted to the trials recorded so far.

Gauss-Newton on simulations of the perturbed plant, with normal priors, since a trial excites little. The posterior's spread,
with the misfit of the fit as noise, says how far the twin's forecast of the next trial may be off.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from asrsim.learning.optimal import Answer, averaged
from asrsim.learning.plant import Plant
from asrsim.learning.transfer import Draw, perturbed
from asrsim.learning.trial import Trial
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
ROUNDS = 3
"""Gauss-Newton steps at most."""
NUDGES = (0.05, 0.005)
"""Steps of the slopes: of the logarithms, and of the delay in s."""
LIKELY = 6
"""Plants drawn from the posterior."""


@dataclass(frozen=True, kw_only=True)
class Twin:
    """The fitted plant."""

    plant: Plant = field(repr=False)
    draw: Draw
    residual: float
    """rad, root mean square of the recorded motion that the twin does not explain."""
    before: float
    """rad, the same of the plant before the fit."""
    likely: tuple[Plant, ...] = field(repr=False)
    """Drawn from the posterior."""

    def answers(self, best: Trial) -> list[Answer]:
        """Forecasts of the twin, then of each likely plant: the best trial's outputs, changed as the plant's outputs change."""
        return [_answer(plant, best) for plant in (self.plant, *self.likely)]


def _answer(plant: Plant, best: Trial) -> Answer:
    known = plant.outputs(best.inputs)
    return lambda inputs: np.asarray(best.outputs + plant.outputs(inputs) - known)


def stiffness_parameters(plant: Plant, joint: str) -> tuple[str, ...]:
    """Parameters of a joint's spring that scale its torque: those with a torque in their unit."""
    drive = plant.drives[plant.joints.index(joint)]
    return tuple(parameter.name for parameter in drive.actuator.parameters if "N m" in parameter.unit)


def identify(plant: Plant, trials: Sequence[Trial], start: Mapping[str, float] | None = None) -> Twin:
    """The plant that gives the trials' outputs for their inputs; start: an earlier draw to begin with."""
    rows = np.linspace(0.0, float(plant.time[-1]), SAMPLES + 1)[1:]
    measured = [averaged(plant.time, trial.outputs, rows) for trial in trials]
    factors: list[tuple[str, ...]] = [(f"mass.{joint}",) for joint in plant.joints]
    factors += [tuple(f"parameters.{joint}.{name}" for name in stiffness_parameters(plant, joint)) for joint in plant.joints]
    springs = len(factors)
    factors += [
        (f"{loss}.{joint}",)
        for joint in plant.joints for loss in ("friction", "damping") if getattr(plant.robot.joint(joint), loss) > 0.0
    ]  # fmt: skip
    priors = np.array([SPREAD] * springs + [LOSSES] * (len(factors) - springs) + [DELAY])
    nudges = np.array([NUDGES[0]] * len(factors) + [NUDGES[1]])

    def draw_of(x: Array) -> Draw:
        draw = {name: float(np.expm1(value)) for names, value in zip(factors, x, strict=False) for name in names}
        return draw | {"delay": max(float(x[-1]), 0.0)}

    def residual(x: Array) -> Array:
        robot = perturbed(plant, draw_of(x))
        found = [averaged(plant.time, robot.outputs(trial.inputs), rows) for trial in trials]
        return np.concatenate([(one - seen).ravel() for one, seen in zip(found, measured, strict=True)])

    def noise(left: Array) -> float:
        return max(NOISE, float(np.sqrt(np.mean(left**2)))) * float(np.sqrt(SAMPLES / INDEPENDENT))

    x = np.zeros(len(priors))
    left = residual(x)
    before = float(np.sqrt(np.mean(left**2)))
    if start is not None:
        begun = np.array([np.log1p(start.get(names[0], 0.0)) for names in factors] + [start.get("delay", 0.0)])
        there = residual(begun)
        if np.sum(there**2) < np.sum(left**2):
            x, left = begun, there
    normal = np.diag(priors**-2)
    for _ in range(ROUNDS):
        scale = max(NOISE, 0.1 * float(np.sqrt(np.mean(left**2)))) * np.sqrt(SAMPLES / INDEPENDENT)
        slopes = np.column_stack(
            [(residual(x + nudge) - left) / step for nudge, step in zip(np.diag(nudges), nudges, strict=True)]
        )
        if not np.isfinite(slopes).all():
            break
        normal = slopes.T @ slopes / scale**2 + np.diag(priors**-2)
        move = np.clip(-np.linalg.solve(normal, slopes.T @ left / scale**2 + x / priors**2), -1.5 * priors, 1.5 * priors)

        def cost(left: Array, x: Array, scale: float = scale) -> float:
            value = float(np.sum((left / scale) ** 2) + np.sum((x / priors) ** 2))
            return value if np.isfinite(value) else np.inf

        first = cost(left, x)
        for share in (1.0, 0.5, 0.25):
            tried = x + share * move
            tried[-1] = max(tried[-1], 0.0)
            there = residual(tried)
            if cost(there, tried) < first:
                break
        else:
            break
        gained = 1.0 - cost(there, tried) / first
        normal = slopes.T @ slopes / noise(there) ** 2 + np.diag(priors**-2)
        x, left = tried, there
        if gained < 0.2:
            break
    root = np.linalg.inv(np.linalg.cholesky(normal))
    steps = np.random.default_rng(0).standard_normal((LIKELY, len(x))) @ root
    draw = draw_of(x)
    return Twin(
        plant=perturbed(plant, draw),
        draw=draw,
        residual=float(np.sqrt(np.mean(left**2))),
        before=before,
        likely=tuple(perturbed(plant, draw_of(x + step)) for step in steps),
    )
