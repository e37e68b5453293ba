"""How to learn: the `ilc:` block of a scenario, with what it leaves to the model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import exp

from asrsim.errors import Problem, ScenarioError
from asrsim.learning.contraction import choose_gains, safe_filter
from asrsim.learning.linear import Linearised
from asrsim.scenario.learning_keys import Filter, Learning

OF_FIXED_GAIN = ("gain", "gain_decay", "joint_gains", "filter")
"""Keys without effect under `law: auto`."""


def decided(learning: Learning, joints: Sequence[str], linear: Linearised) -> Learning:
    """The `ilc:` block with a number for the gain of each joint, and with filter and first guess, where the model chooses them.

    Raises ScenarioError for gains of unknown joints.
    """
    unknown = [joint for joint in learning.joint_gains if joint not in joints]
    if unknown:
        raise ScenarioError(
            [Problem("this joint does not learn", key=f"ilc.joint_gains.{joint}", choices=tuple(joints)) for joint in unknown]
        )
    asked = [learning.joint_gains.get(joint, learning.gain) for joint in joints]
    best, by_model = choose_gains(linear), "model" in asked
    gains = [model if gain == "model" else float(gain) for gain, model in zip(asked, best, strict=False)]
    settings = replace(learning, first_guess=learning.first_guess or ("inverse_dynamics" if learning.law == "auto" else "zero"))
    if learning.filter is None and (learning.law == "filtered" or (learning.law == "paper" and by_model)):
        safe, cutoff = safe_filter(linear, gains, Filter.order)
        settings, gains = replace(settings, filter=Filter(cutoff=cutoff)), list(safe)
    return replace(settings, joint_gains=dict(zip(joints, gains, strict=True)))


def gains_at(settings: Learning, joints: Sequence[str], update: int = 0) -> tuple[float, ...]:
    """Gains of update number 0, 1, ..., each K exp(-update / gain_decay), of settings that are :func:`decided`."""
    factor = 1.0 if settings.gain_decay is None else exp(-update / settings.gain_decay)
    return tuple(float(settings.joint_gains[joint]) * factor for joint in joints)
