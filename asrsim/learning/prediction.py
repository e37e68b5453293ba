"""Predicting the next trial's error from the linearised joints along the trajectory."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from asrsim.kinematics.compensation import JointDrive
from asrsim.learning.iterate import LearningProblem, Predict
from asrsim.learning.linear import DynamicModel, JointDynamics, linearise
from asrsim.samples import Array

KNOTS = 41
"""Postures along the trajectory at which the joints are linearised; between, shares are straight lines."""


def postures(
    model: DynamicModel,
    drives: Sequence[JointDrive],
    presets: Sequence[float],
    damping: dict[str, float],
    inputs: Array,
    outputs: Array,
    *,
    knots: int = KNOTS,
) -> list[JointDynamics]:
    """The joints linearised at `knots` samples of a trial (inputs and outputs (n, joints), in the order of `drives`)."""
    rows = np.unique(np.linspace(0, len(outputs) - 1, knots).round().astype(int))
    names = [drive.joint for drive in drives]
    return [
        linearise(model, drives, dict(zip(names, outputs[row], strict=True)), inputs[row], presets, damping) for row in rows
    ]


def predictor(
    problem: LearningProblem,
    model: DynamicModel,
    drives: Sequence[JointDrive],
    presets: Sequence[float],
    damping: dict[str, float],
) -> Predict:
    """A :data:`Predict` for slow motions: the change of the input arrives at the links through the static shares."""

    def predict(inputs: Array, outputs: Array, following: Array) -> float:
        error = problem.reference - outputs
        rows = np.unique(np.linspace(0, len(outputs) - 1, KNOTS).round().astype(int))
        shares = np.array([item.response(0.0).real for item in postures(model, drives, presets, damping, inputs, outputs)])
        change = (following - inputs)[rows]
        left = error[rows] - np.einsum("nij,nj->ni", shares, change)
        before = float(np.linalg.norm(error[rows], axis=1).max())
        return float(np.linalg.norm(left, axis=1).max()) / before if before else 0.0

    return predict
