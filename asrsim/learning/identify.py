"""A twin of the robot: the plant's masses, stiffnesses, losses and delay, fitted to the trials recorded so far.

Least squares on simulations of the perturbed plant, with normal priors, since a trial excites little. The posterior's spread,
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
    from scipy.optimize import least_squares

    rows = np.linspace(0.0, float(plant.time[-1]), SAMPLES + 1)[1:]
    measured = np.concatenate([averaged(plant.time, trial.outputs, rows) for trial in trials])
    factors: list[tuple[str, ...]] = [(f"mass.{joint}",) for joint in plant.joints]
    factors += [tuple(f"parameters.{joint}.{name}" for name in stiffness_parameters(plant, joint)) for joint in plant.joints]
    springs = len(factors)
    losses = [(what, joint) for joint in plant.joints for what in ("friction", "damping")]
    factors += [(f"{what}.{joint}",) for what, joint in losses if getattr(plant.robot.joint(joint), what) > 0.0]
    priors = np.array([SPREAD] * springs + [LOSSES] * (len(factors) - springs) + [DELAY])

    def draw_of(x: Array) -> Draw:
        draw = {name: float(np.expm1(value)) for names, value in zip(factors, x, strict=False) for name in names}
        return draw | {"delay": max(float(x[-1]), 0.0)}

    def misfit(x: Array) -> Array:
        robot = perturbed(plant, draw_of(x))
        found = np.concatenate([averaged(plant.time, robot.outputs(trial.inputs), rows) for trial in trials])
        return np.asarray(np.nan_to_num(found - measured, nan=DIVERGED).ravel())

    def weighed(x: Array) -> Array:
        return np.concatenate([misfit(x) / scale, x / priors])

    def slopes(x: Array) -> Array:
        here = weighed(x)
        return np.column_stack([(weighed(x + nudge) - here) / nudge.max() for nudge in np.diag(NUDGE * priors)])

    def size(left: Array) -> float:
        return float(np.sqrt(np.mean(left**2)))

    begun = np.zeros(len(priors))
    before = size(misfit(begun))
    if start is not None:
        begun = np.array([np.log1p(start.get(names[0], 0.0)) for names in factors] + [start.get("delay", 0.0)])
    # What a model lacks lasts for some samples, so that fewer of them count.
    independent = np.sqrt(SAMPLES / INDEPENDENT)
    scale = NOISE * independent
    lowest = np.append(np.full(len(factors), -np.inf), -1e-9)
    found = least_squares(
        weighed, begun, slopes, bounds=(lowest, np.inf), x_scale=priors, ftol=LITTLE, max_nfev=ROUNDS + 1
    )  # fmt: skip
    residual = size(misfit(found.x))
    jacobian = found.jac[: measured.size] * (scale / (max(NOISE, residual) * independent))
    root = np.linalg.inv(np.linalg.cholesky(np.asarray(jacobian.T @ jacobian + np.diag(priors**-2))))
    steps = np.random.default_rng(0).standard_normal((LIKELY, len(priors))) @ root
    draw = draw_of(found.x)
    return Twin(
        plant=perturbed(plant, draw),
        draw=draw,
        residual=residual,
        before=before,
        likely=tuple(perturbed(plant, draw_of(found.x + step)) for step in steps),
    )
