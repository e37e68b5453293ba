"""The learning problem that a scenario states, its law, and what the model says beforehand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from asrsim.kinematics.inverse import Demand, InverseDynamics
from asrsim.learning.arm import ArmModel
from asrsim.learning.contraction import choose_gains, learnable
from asrsim.learning.identity import identity_of
from asrsim.learning.iterate import learn
from asrsim.learning.law import FixedGain
from asrsim.learning.linear import Linearised
from asrsim.learning.optimal import Lifted, NormOptimal
from asrsim.learning.plant import Plant
from asrsim.learning.presets import ChosenPreset, choose_presets
from asrsim.learning.settings import OF_FIXED_GAIN, decided, gains_at
from asrsim.learning.trial import Law, LearningProblem
from asrsim.runs.folder import origin_of
from asrsim.samples import Array
from asrsim.scenario.learning_keys import Learning

REACH_TRIALS = 12
"""Simulated trials, at most, that decide whether a motion that exceeds a limit can be followed."""


@dataclass(frozen=True, kw_only=True)
class Prepared:
    """Everything that `learn` needs, and what the model says beforehand."""

    plant: Plant
    model: ArmModel = field(repr=False)
    problem: LearningProblem
    settings: Learning
    """The scenario's, with the gains, the filter and the first guess decided."""
    law: Law = field(repr=False)
    inverse: InverseDynamics = field(repr=False)
    """Of the desired motion."""
    linear: Linearised = field(repr=False)
    """The joints along the desired motion."""
    demands: tuple[Demand, ...]
    """What the motion asks of the joints, highest score first."""
    notes: tuple[str, ...] = ()
    """For people: presets that were chosen, settings without effect."""

    @property
    def exceeding(self) -> tuple[Demand, ...]:
        """Demands beyond their limits. A short one may leave no error."""
        return tuple(demand for demand in self.demands if demand.score > 1.0)

    @cached_property
    def followed(self) -> float:
        """rad: the largest error of the best simulated trial, all limits in force."""
        guess = self.inverse.inputs_at(self.plant.time, self.model.delays)
        problem = replace(self.problem, first_guess=guess)
        settings = replace(self.settings, max_iterations=REACH_TRIALS)
        law = NormOptimal(problem, Lifted(problem.time, self.linear, self.model.delays))
        return learn(problem, self.plant.outputs, settings, law=law).best_trial.worst

    @property
    def out_of_reach(self) -> tuple[Demand, ...]:
        """Demands beyond their limits, where simulated learning does not come within the tolerance."""
        return self.exceeding if self.exceeding and self.followed > self.settings.tolerance else ()

    def gain_advice(self) -> tuple[float, ...]:
        """Gains that the model would choose."""
        return choose_gains(self.linear)[: len(self.plant.joints)]

    @cached_property
    def reach(self) -> float:
        """Hz below which errors shrink with the first gains, at the worst posture."""
        return learnable(self.linear, gains_at(self.settings, self.problem.joints))


def prepare_learning(plant: Plant, model: ArmModel, *, lawless: bool = False) -> Prepared:
    """The learning problem of a plant; `model` (see `learning_model`) must stay open while it is solved.

    Presets are chosen first, if the scenario asks for it: the plant of the result has them. lawless: nothing will be learned.
    Raises ScenarioError for gains of unknown joints.
    """
    learning = plant.learning
    inverse = model.inverse(plant.reference)
    notes: list[str] = []
    if learning.presets != "given":
        chosen = choose_presets(model, inverse, learning.tolerance)
        plant = plant.with_presets({item.joint: item.value for item in chosen})
        model = model.of(plant)
        inverse = model.inverse(plant.reference)
        notes += [_preset_note(item) for item in chosen]
    linear = model.linear(inverse)
    settings = decided(learning, plant.joints, linear)
    guesses: dict[str, Callable[[], Array]] = {
        "zero": lambda: np.zeros_like(plant.reference),
        "reference": lambda: plant.reference.copy(),
        "inverse_dynamics": lambda: inverse.inputs_at(plant.time, model.delays),
    }
    problem = LearningProblem(
        joints=plant.joints,
        units=tuple(map(plant.unit, plant.joints)),
        time=plant.time,
        reference=plant.reference,
        first_guess=guesses[settings.first_guess or "zero"](),
        identity=identity_of(plant),
        origin=(origin_of(plant.scenario), plant.scenario.variant),
    )
    law: Law = FixedGain(problem, settings)
    missed = model.start_error(inverse, linear)
    if settings.law == "auto" and not lawless:
        law = NormOptimal(problem, Lifted(problem.time, linear, model.delays))
    raw = plant.scenario.resolved.get("ilc") or {}
    idle = [key for key in OF_FIXED_GAIN if settings.law == "auto" and key in raw]
    if idle:
        notes.append(f"{', '.join(idle)}: of no effect with law auto")
    return Prepared(
        plant=plant,
        model=model,
        problem=problem,
        settings=settings,
        law=law,
        inverse=inverse,
        linear=linear,
        demands=tuple(sorted([*inverse.demands, *_start(plant, missed, settings.tolerance)], key=lambda one: -one.score)),
        notes=tuple(notes),
    )


def _start(plant: Plant, missed: Array, tolerance: float) -> list[Demand]:
    """The errors that the start leaves in each joint."""
    found = []
    for joint, column in zip(plant.joints, missed.T, strict=True):
        worst = int(np.argmax(np.abs(column)))
        found.append(
            Demand(
                joint=joint, what="error from the start", needed=float(column[worst]), limit=tolerance, unit=plant.unit(joint),
                time=float(plant.time[worst]),
            )
        )  # fmt: skip
    return found


def _preset_note(item: ChosenPreset) -> str:
    unheld = "" if item.score <= 1.0 else f", the best there is, but it exceeds limits or tolerance {item.score:.2g} times"
    return f"preset of {item.joint}: {item.value:.3g}{unheld}"
