"""A model of the arm that a trial tells of: masses and stiffnesses of each joint and one delay, fitted to what was recorded.

Gauss-Newton on simulations of the perturbed model, with priors, since a trial excites little: 0.25 on the logarithms of
masses and stiffnesses, 20 ms on the delay. What is left over tells whether the model's structure is right.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from asrsim.learning.optimal import averaged
from asrsim.learning.perturb import perturbed
from asrsim.learning.plant import Plant
from asrsim.learning.transfer import Draw
from asrsim.learning.trial import Trial
from asrsim.samples import Array

SPREAD = 0.25
"""Prior of the logarithms of masses and stiffnesses."""
DELAY = 0.02
"""s, prior of the delay."""
NOISE = 2e-3
"""rad, what the model leaves over where its structure is right."""
SAMPLES = 250
"""Times at which the motion is compared."""
ROUNDS = 3
"""Fits one after the other, each about the one before."""
NUDGES = (0.05, 0.005)
"""Steps of the slopes: of the logarithms, and of the delay in s."""


@dataclass(frozen=True, kw_only=True)
class Identified:
    """What was found."""

    plant: Plant = field(repr=False)
    """The learned plant with the masses, stiffnesses and delay that were found."""
    draw: Draw
    residual: float
    """rad, root mean square of what the model does not explain."""
    before: float
    """rad, the same before."""


def stiffness_parameters(plant: Plant, joint: str) -> tuple[str, ...]:
    """Parameters of a joint's spring that scale its torque: those with a torque in their unit."""
    drive = plant.drives[plant.joints.index(joint)]
    return tuple(parameter.name for parameter in drive.actuator.parameters if "N m" in parameter.unit)


def identify(plant: Plant, trial: Trial) -> Identified:
    """The plant that gives the trial's outputs for its inputs."""
    rows = np.linspace(0.0, float(plant.time[-1]), SAMPLES + 1)[1:]
    measured = averaged(plant.time, trial.outputs, rows)
    joints = len(plant.joints)

    def draw_of(x: Array) -> Draw:
        draw = {"delay": max(float(x[-1]), 0.0)}
        for index, joint in enumerate(plant.joints):
            draw[f"mass.{joint}"] = float(np.expm1(x[index]))
            for name in stiffness_parameters(plant, joint):
                draw[f"parameters.{joint}.{name}"] = float(np.expm1(x[joints + index]))
        return draw

    def residual(x: Array) -> Array:
        outputs = perturbed(plant, draw_of(x)).outputs(trial.inputs)
        return np.asarray((averaged(plant.time, outputs, rows) - measured).ravel())

    x = np.zeros(2 * joints + 1)
    priors = np.array([SPREAD] * (2 * joints) + [DELAY])
    nudges = np.array([NUDGES[0]] * (2 * joints) + [NUDGES[1]])
    left = residual(x)
    first = float(np.sqrt(np.mean(left**2)))

    def cost(left: Array, x: Array) -> float:
        value = float(np.sum((left / NOISE) ** 2) + np.sum((x / priors) ** 2))
        return value if np.isfinite(value) else np.inf

    for _ in range(ROUNDS):
        slopes = np.column_stack(
            [(residual(x + nudge) - left) / step for nudge, step in zip(np.diag(nudges), nudges, strict=True)]
        )
        if not np.isfinite(slopes).all():
            break
        normal = slopes.T @ slopes / NOISE**2 + np.diag(priors**-2)
        move = -np.linalg.solve(normal, slopes.T @ left / NOISE**2 + x / priors**2)
        for share in (1.0, 0.5, 0.25):
            trial_x = x + share * np.clip(move, -1.5 * priors, 1.5 * priors)
            trial_x[-1] = max(trial_x[-1], 0.0)
            there = residual(trial_x)
            if cost(there, trial_x) < cost(left, x):
                break
        else:
            break
        gained = 1.0 - cost(there, trial_x) / cost(left, x)
        x, left = trial_x, there
        if gained < 0.05:
            break
    draw = draw_of(x)
    return Identified(plant=perturbed(plant, draw), draw=draw, residual=float(np.sqrt(np.mean(left**2))), before=first)
