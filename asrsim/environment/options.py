"""Options of an environment, and the check of their values."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict

import numpy as np

from asrsim.errors import InputError, Problem, did_you_mean

if TYPE_CHECKING:
    from asrsim.environment.task import State


class Options(TypedDict, total=False):
    """Options that both `asrsim.make_env` and `asrsim.make_vec_env` accept."""

    variant: str | None
    overrides: Any
    plugins: Any
    control_rate: float
    observe: str | Sequence[str]
    act: str | Sequence[str] | None
    reward: Callable[[State], Any] | None
    terminated: Callable[[State], Any] | None
    batched: bool
    adaptive: bool
    randomise: Mapping[str, Any]
    fit: str | Path | None
    push: Mapping[str, Any]
    delay: Any
    noise: Mapping[str, float]
    history: int
    initial: Mapping[str, Any]
    goal: Mapping[str, Any]
    tip: tuple[str, Sequence[float]] | None


def _is_tip(value: Any) -> bool:
    if value is None:
        return True
    try:
        link, point = value
        return isinstance(link, str) and np.shape(point) == (3,) and bool(np.isfinite(point).all())
    except (TypeError, ValueError):
        return False


def _fits(value: Any, types: Any) -> bool:
    """Whether a value has one of the types. The entries of a list, and the keys of a mapping, must be texts."""
    if isinstance(value, bool):
        return types in (bool, object)
    named = types is not object and isinstance(value, Sequence | Mapping)
    return isinstance(value, types) and (not named or all(isinstance(name, str) for name in value))


_NAMES = "a name or a list of names"
_LAWS: Any = {}, Mapping, "a mapping from keys to laws, such as {'joint_1.motor_1_inertia': 'uniform(0.01, 0.02)'}"
_FUNCTION: Any = None, Callable | None, "a function of the state, or None"
# Use sequences of names, since the order of a set would differ from process to process.
_FORMS: dict[str, tuple[Any, Any, str]] = {
    "variant": (None, object, ""),
    "overrides": ((), object, ""),
    "plugins": ((), object, ""),
    "control_rate": (50.0, int | float | np.number, "a number of Hz"),
    "observe": (("link_position", "link_velocity"), Sequence, _NAMES),
    "act": (None, Sequence | None, _NAMES),
    "reward": _FUNCTION,
    "terminated": _FUNCTION,
    "randomise": _LAWS,
    "initial": _LAWS,
    "goal": _LAWS,
    "batched": (False, bool, "True or False"),
    "adaptive": (False, bool, "True or False"),
    "fit": (None, str | Path | None, "the path of a fit.json"),
    "push": ({}, Mapping, "a mapping from joints to laws of a torque in N m, such as {'joint_1': 'uniform(-0.1, 0.1)'}"),
    "delay": (None, object, ""),
    "noise": ({}, Mapping, "a mapping from observed quantities to standard deviations in their units"),
    "history": (0, int, "a number of control periods"),
    "tip": (None, object, ""),
}
"""Default, types of valid values, and description of valid values of each option, by name."""


def checked(given: Mapping[str, Any]) -> dict[str, Any]:
    """Values of all options; an option that is not given gets its default. Raises InputError with all unknown or wrong
    options."""
    problems = [
        Problem(
            "is not an option", key=name, choices=tuple(_FORMS), hint=did_you_mean(name, list(_FORMS)), code="unknown-option"
        )
        for name in given.keys() - _FORMS.keys()
    ]
    options = {name: given.get(name, default) for name, (default, _, _) in _FORMS.items()}
    problems += [
        Problem(f"must be {kind}", key=name, value=options[name], code="option-type")
        for name, (_, types, kind) in _FORMS.items()
        if not _fits(options[name], types)
    ]
    if not _is_tip(options["tip"]):
        message = "must be a link's name and a point of three finite numbers in m, such as ('link_2', (0.1, 0, 0))"
        problems.append(Problem(message, key="tip", value=options["tip"], code="option-type"))
    if problems:
        raise InputError(problems)
    return options
