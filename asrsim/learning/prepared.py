"""Learning problem of a scenario, its law, and the demands of the motion on the joints."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from asrsim.kinematics.inverse import Demand
from asrsim.learning.law import FixedGain
from asrsim.learning.model import ArmModel
from asrsim.learning.optimal import NormOptimal
from asrsim.learning.plant import Plant
from asrsim.learning.state import identity_of
from asrsim.learning.trial import Law, LearningProblem, LearningResult
from asrsim.samples import Array
from asrsim.scenario.blocks import Learning

FIXED_GAIN_KEYS = ("gain", "gain_decay", "joint_gains", "filter")
"""Keys without effect under `law: auto`."""
MOST_DEMANDS = 5
"""Largest number of listed demands beyond their limits."""


@dataclass(frozen=True, kw_only=True)
class PreparedLearning:
    """A prepared learning problem: the inputs of `learn`."""

    plant: Plant
    problem: LearningProblem
    settings: Learning
    """Settings of the scenario with the chosen first guess."""
    law: Law = field(repr=False)
    demands: tuple[Demand, ...]
    """Demands of the motion on the joints, highest score first."""

    @property
    def before(self) -> list[str]:
        """Lines that are printed before the first trial."""
        lines = ["law auto: norm-optimal over three models"]
        raw = self.plant.scenario.resolved.get("ilc") or {}
        idle = [key for key in FIXED_GAIN_KEYS if key in raw]
        if self.settings.law != "auto":
            gains = ", ".join(
                f"{self.settings.joint_gains.get(joint, self.settings.gain):.3g}" for joint in self.problem.joints
            )
            cutoff = "no filter" if self.settings.filter is None else f"filter {self.settings.filter.cutoff:.3g} Hz"
            lines = [f"law paper: gains {gains}, {cutoff}"]
        elif idle:
            lines.append(f"{', '.join(idle)}: no effect with law auto")
        beyond = [f"beyond its limit: {demand}" for demand in self.demands[:MOST_DEMANDS] if demand.score > 1.0]
        most = [f"the largest demand is {100 * one.score:.0f} % of its limit: {one}" for one in self.demands[:1]]
        return [*lines, *(beyond or most)]

    def reach(self, result: LearningResult) -> str:
        """Statement whether the joints can perform the motion, from trials simulated with all limits; empty with the law
        `paper`.
        """
        if self.settings.law != "auto":
            return ""
        error = f"the best simulated trial is {self.problem.worst(result.best)} off"
        beyond = [str(demand) for demand in self.demands[:MOST_DEMANDS] if demand.score > 1.0]
        if result.converged:
            return f"within reach, although limits are exceeded: {'; '.join(beyond)}" if beyond else "within reach"
        if not beyond:
            # Friction or the initial state may prevent the motion; more trials may remove such errors.
            return f"not reached in {len(result.trials)} trials: {error}; no limit explains it, but friction or the start may"
        return f"out of reach: {error}; {'; '.join(beyond)}"


def prepare_learning(plant: Plant, model: ArmModel) -> PreparedLearning:
    """Learning problem of a plant. model: model of the plant from `learning_model`."""
    learning = plant.learning
    settings = replace(learning, first_guess=learning.first_guess or ("inverse_dynamics" if learning.law == "auto" else "zero"))
    guesses: dict[str, Callable[[], Array]] = {
        "zero": lambda: np.zeros_like(plant.reference),
        "reference": plant.reference.copy,
        "inverse_dynamics": lambda: model.guess,
    }
    problem = LearningProblem(
        joints=plant.joints, units=tuple(map(plant.unit, plant.joints)), time=plant.time, reference=plant.reference,
        first_guess=guesses[settings.first_guess or "zero"](), identity=identity_of(plant),
    )  # fmt: skip
    law: Law = FixedGain(problem, settings)
    if settings.law == "auto":
        law = NormOptimal(problem, model.lifted)
    return PreparedLearning(plant=plant, problem=problem, settings=settings, law=law, demands=model.inverse.demands)
