"""How to learn: the `ilc:` block of a scenario, with what it leaves to the model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from asrsim.errors import Problem, ScenarioError
from asrsim.scenario.learning_keys import Filter, Learning

MODEL = "model"
"""Word for a gain that is chosen from the linearised joint dynamics."""
OF_FIXED_GAIN = ("gain", "gain_decay", "joint_gains", "derivative", "filter", "forgetting")
"""Keys without effect under `law: auto`."""


def wants_model_gains(learning: Learning, joints: Sequence[str]) -> bool:
    """Whether any joint's gain is to be chosen from the model."""
    return any(_gain(learning, joint) == MODEL for joint in joints)


def wants_safe_filter(learning: Learning, joints: Sequence[str]) -> bool:
    """Whether cutoff and gains are to be made safe by the model: always but with equation 13 or a cutoff as given."""
    if learning.filter is not None:
        return False
    return learning.law == "filtered" or (learning.law == "paper" and wants_model_gains(learning, joints))


def decided(
    learning: Learning,
    joints: Sequence[str],
    model_gains: Sequence[float] | None = None,
    safe: tuple[Sequence[float], float] | None = None,
) -> Learning:
    """The `ilc:` block with a number for the gain of each joint, and with filter and first guess.

    model_gains: one a joint, put where the block says `model`. safe: gains and cutoff in Hz that replace the block's.
    Raises ScenarioError for gains of unknown joints.
    """
    unknown = [joint for joint in learning.joint_gains if joint not in joints]
    if unknown:
        raise ScenarioError(
            [Problem("this joint does not learn", key=f"ilc.joint_gains.{joint}", choices=tuple(joints)) for joint in unknown]
        )
    gains = {joint: _gain(learning, joint) for joint in joints}
    if model_gains is not None:
        gains = {
            joint: best if gains[joint] == MODEL else gains[joint] for joint, best in zip(joints, model_gains, strict=True)
        }
    elif MODEL in gains.values():
        raise ScenarioError("a gain from the model needs a model", key="ilc.gain", code="no-model-gain")
    guess = learning.first_guess or ("inverse_dynamics" if learning.law == "auto" else "zero")
    settings = replace(learning, joint_gains=gains, first_guess=guess)
    return (
        settings
        if safe is None
        else replace(settings, joint_gains=dict(zip(joints, safe[0], strict=True)), filter=Filter(cutoff=safe[1]))
    )


def gains_at(settings: Learning, joints: Sequence[str], update: int = 0) -> tuple[float, ...]:
    """Gains of update number 0, 1, ..., each K exp(-update / gain_decay), of settings that are :func:`decided`."""
    from math import exp

    factor = 1.0 if settings.gain_decay is None else exp(-update / settings.gain_decay)
    return tuple(float(_gain(settings, joint)) * factor for joint in joints)


def _gain(learning: Learning, joint: str) -> float | str:
    return learning.joint_gains.get(joint, learning.gain)
