"""Options of an environment, and their validation."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypedDict

import numpy as np

from asrsim.errors import InputError, Problem, did_you_mean

if TYPE_CHECKING:
    from asrsim.environment.task import State


class Options(TypedDict, total=False):
    """Options that both `asrsim.make_env` and `asrsim.make_vec_env` accept."""

    variant: str | None
    overrides: Any
    control_rate: float
    observe: str | Sequence[str]
    act: str | Sequence[str] | None
    reward: Callable[[State], float] | None
    terminated: Callable[[State], bool] | None
    randomise: Mapping[str, Any]
    initial: Mapping[str, Any]
    goal: Mapping[str, Any]
    tip: tuple[str, Sequence[float]] | None


def _is_names(value: Any) -> bool:
    # Sets are rejected: their order differs from process to process.
    return isinstance(value, str) or (isinstance(value, Sequence) and all(isinstance(name, str) for name in value))


def _is_action(value: Any) -> bool:
    return value is None or (_is_names(value) and len(value) > 0)


def _is_laws(value: Any) -> bool:
    return isinstance(value, Mapping) and all(isinstance(key, str) for key in value)


def _is_function(value: Any) -> bool:
    return value is None or callable(value)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float | np.number) and not isinstance(value, bool)


def _is_tip(value: Any) -> bool:
    return value is None or (isinstance(value, Sequence) and len(value) == 2 and isinstance(value[0], str))


_LAWS: Any = ({}, _is_laws, "a mapping from keys to laws, such as {'joint_1.motor_1_inertia': 'uniform(0.01, 0.02)'}")
_FUNCTION: Any = (None, _is_function, "a function of the state, or None")
_NAMES = "a name or a list of names"
_FORMS: dict[str, tuple[Any, Callable[[Any], bool], str]] = {
    "variant": (None, lambda _: True, ""), "overrides": ((), lambda _: True, ""),
    "control_rate": (50.0, _is_number, "a number of Hz"), "observe": (("link_position", "link_velocity"), _is_names, _NAMES),
    "act": (None, _is_action, _NAMES), "reward": _FUNCTION, "terminated": _FUNCTION, "randomise": _LAWS, "initial": _LAWS,
    "goal": _LAWS, "tip": (None, _is_tip, "a link's name and a point on it, such as ('link_2', (0.1, 0, 0))"),
}  # fmt: skip
"""Options by name: default, function that validates a value, and description of valid values."""


def checked(given: Mapping[str, Any]) -> dict[str, Any]:
    """All options; options that are not given get their defaults. Raises InputError that lists all unknown or wrong options."""
    problems = [
        Problem(
            "is not an option", key=name, choices=tuple(_FORMS), hint=did_you_mean(name, list(_FORMS)), code="unknown-option"
        )
        for name in given.keys() - _FORMS.keys()
    ]
    options = {name: given.get(name, default) for name, (default, _, _) in _FORMS.items()}
    problems += [
        Problem(f"must be {kind}", key=name, value=options[name], code="option-type")
        for name, (_, is_kind, kind) in _FORMS.items()
        if not is_kind(options[name])
    ]
    if problems:
        raise InputError(problems)
    return options
