"""How to learn: the `ilc:` block of a scenario as data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from asrsim.errors import Problem, ScenarioError
from asrsim.scenario.learning_keys import FirstGuess, LawName, Learning

MODEL = "model"
"""Word for a gain that is chosen from the linearised joint dynamics."""
OF_FIXED_GAIN = ("gain", "gain_decay", "joint_gains", "derivative", "filter", "forgetting")
"""Keys without effect under `law: auto`."""


@dataclass(frozen=True, kw_only=True)
class LearningSettings:
    """The law, and for the laws of a fixed gain paper equation 13 and what the project adds to it."""

    law: LawName = "paper"
    gains: tuple[float, ...]
    """K of each joint, the weight of the last error at the first update."""
    gain_decay: float | None = 10.0
    """Updates after which the gain has fallen to 1/e; None: it stays."""
    derivative: float = 0.0
    """s: the error's rate counts with gain times this."""
    filter_cutoff: float | None = None
    """Hz, of a zero-phase Butterworth low-pass on the learned input; None: no filter."""
    filter_order: int = 2
    forgetting: float = 0.0
    """Share of the way back to the first guess at each update."""
    first_guess: FirstGuess = "zero"
    tolerance: float = 0.08
    """rad: learning ends when the largest error of every joint is within it."""
    max_iterations: int = 50
    """Updates at most."""
    patience: int = 3
    """Learning gives up when the error has grown, or no progress was made, for so many trials in a row."""

    def gain_at(self, update: int) -> tuple[float, ...]:
        """Gains of update number 0, 1, ...: K exp(-update / gain_decay)."""
        from math import exp

        factor = 1.0 if self.gain_decay is None else exp(-update / self.gain_decay)
        return tuple(gain * factor for gain in self.gains)


def wants_model_gains(learning: Learning, joints: Sequence[str]) -> bool:
    """Whether any joint's gain is to be chosen from the model."""
    return any(_gain(learning, joint) == MODEL for joint in joints)


def wants_safe_filter(learning: Learning, joints: Sequence[str]) -> bool:
    """Whether cutoff and gains are to be made safe by the model: always but with equation 13 or a cutoff as given."""
    if learning.filter is not None:
        return False
    return learning.law == "filtered" or (learning.law == "paper" and wants_model_gains(learning, joints))


def parse_settings(
    learning: Learning,
    joints: Sequence[str],
    model_gains: Sequence[float] | None = None,
    safe: tuple[Sequence[float], float] | None = None,
) -> LearningSettings:
    """Settings from a scenario's `ilc:` block.

    model_gains: one a joint, put where the block says `model`. safe: gains and cutoff in Hz that replace both.
    Raises ScenarioError for gains of unknown joints.
    """
    unknown = [joint for joint in learning.joint_gains if joint not in joints]
    if unknown:
        raise ScenarioError(
            [Problem("this joint does not learn", key=f"ilc.joint_gains.{joint}", choices=tuple(joints)) for joint in unknown]
        )
    gains = []
    for index, joint in enumerate(joints):
        gain = _gain(learning, joint)
        if gain == MODEL:
            if model_gains is None:
                raise ScenarioError("a gain from the model needs a model", key="ilc.gain", code="no-model-gain")
            gain = model_gains[index]
        gains.append(float(gain))
    settings = LearningSettings(
        law=learning.law,
        gains=tuple(gains),
        gain_decay=learning.gain_decay,
        derivative=learning.derivative,
        forgetting=learning.forgetting,
        first_guess=learning.first_guess or ("inverse_dynamics" if learning.law == "auto" else "zero"),
        tolerance=learning.tolerance,
        max_iterations=learning.max_iterations,
        patience=learning.patience,
    )
    if safe is not None:
        return replace(settings, gains=tuple(safe[0]), filter_cutoff=safe[1])
    if learning.filter is not None:
        return replace(settings, filter_cutoff=learning.filter.cutoff, filter_order=learning.filter.order)
    return settings


def _gain(learning: Learning, joint: str) -> float | str:
    return learning.joint_gains.get(joint, learning.gain)
