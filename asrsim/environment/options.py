"""Options of an environment, held against what they must be before anything is built."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from asrsim.errors import InputError, Problem


def _is_names(value: Any) -> bool:
    # A set has another order in every process.
    return isinstance(value, str) or (isinstance(value, Sequence) and all(isinstance(name, str) for name in value))


def _is_laws(value: Any) -> bool:
    return isinstance(value, Mapping) and all(isinstance(key, str) for key in value)


def _is_function(value: Any) -> bool:
    return value is None or callable(value)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float | np.number) and not isinstance(value, bool)


def _is_tip(value: Any) -> bool:
    return value is None or (isinstance(value, Sequence) and len(value) == 2 and isinstance(value[0], str))


_LAWS = (_is_laws, "a mapping from keys to laws, such as {'joint_1.motor_1_inertia': 'uniform(0.01, 0.02)'}")
_NAMES = (_is_names, "a name or a list of names")
_FUNCTION = (_is_function, "a function of the state, or None")
_FORMS: dict[str, tuple[Callable[[Any], bool], str]] = {
    "control_rate": (_is_number, "a number of Hz"), "observe": _NAMES, "act": _NAMES, "reward": _FUNCTION,
    "terminated": _FUNCTION, "randomise": _LAWS, "initial": _LAWS, "goal": _LAWS,
    "tip": (_is_tip, "a link's name and a point on it, such as ('link_2', (0.1, 0, 0))"),
}  # fmt: skip


def check_options(options: Mapping[str, Any]) -> None:
    """Raises InputError with every option that is none of its kind."""
    problems = [
        Problem(f"must be {_FORMS[name][1]}", key=name, value=value, code="option-type")
        for name, value in options.items()
        if not _FORMS[name][0](value)
    ]
    if problems:
        raise InputError(problems)
