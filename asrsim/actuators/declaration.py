"""Problems of classes that are derived from `Actuator` but do not follow its interface."""

from __future__ import annotations

import inspect
import math
import re
import sys
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

from asrsim.actuators import Actuator
from asrsim.actuators.parameters import Parameter
from asrsim.errors import Problem
from asrsim.quantities import MOST_MOTORS


def declaration_problems(actuator: type[Actuator]) -> tuple[Problem, ...]:
    """Problems of a class that does not follow the interface of `Actuator`. Laws are checked only if all attributes are
    valid."""
    wrong = [
        declaration_problem(actuator, f"must be {text}", "bad-declaration", key=key, value=getattr(actuator, key, None))
        for key, (text, is_valid) in ATTRIBUTES.items()
        if not is_valid(getattr(actuator, key, None))
    ]
    if wrong:
        return tuple(wrong)
    if actuator.housed >= actuator.motors:
        message = f"must be less than the number of motors, {actuator.motors}: a motor must drive the link"
        return (declaration_problem(actuator, message, "bad-declaration", key="housed", value=actuator.housed),)
    names = [parameter.name for parameter in actuator.all_parameters()]
    twice = [
        declaration_problem(actuator, "another parameter has this name", "bad-parameter", key=f"parameters.{parameter.name}")
        for parameter in actuator.parameters
        if names.count(parameter.name) > 1
    ]
    return tuple(twice or _laws(actuator))


ATTRIBUTES: dict[str, tuple[str, Callable[[Any], bool]]] = {
    "name": (
        "lower-case letters, digits and underscores, as in lib<name>_plugin.so",
        lambda value: isinstance(value, str) and re.fullmatch(r"[a-z][a-z0-9_]*", value) is not None,
    ),
    "title": ("a text", lambda value: isinstance(value, str)),
    "source": ("a text", lambda value: isinstance(value, str)),
    "motors": (f"1 to {MOST_MOTORS}", range(1, MOST_MOTORS + 1).__contains__),
    "housed": (f"0 to {MOST_MOTORS - 1}", range(MOST_MOTORS).__contains__),
    "typical_preset": ("a finite number", lambda value: isinstance(value, int | float) and math.isfinite(value)),
    "parameters": (
        "a tuple of Parameter(...)",
        lambda value: isinstance(value, tuple) and all(isinstance(parameter, Parameter) for parameter in value),
    ),
}
"""Attributes of an actuator's class: description of valid values, and function that validates a value."""


def _laws(actuator: type[Actuator]) -> Iterable[Problem]:
    """Problems of laws that are missing, do not take the right arguments, or return too few or too many numbers when they are
    called at rest."""
    positions = dict.fromkeys((f"theta_{i + 1}" for i in range(actuator.positions())), 0.0)
    spring = {"q": 0.0, **positions, "parameters": tuple(parameter.default for parameter in actuator.parameters)}
    taken: dict[str, tuple[Mapping[str, object], int]] = {
        "elastic_torques": (spring, max(2, actuator.motors)),
        "stiffness": (spring, 1),
        "elastic_energy": (spring, 1),
        "motor_references": ({"equilibrium": 0.0, "preset": 0.0}, len(positions)),
        "equilibrium_position": (positions, 1),
    }
    why = {"elastic_torques": "every actuator needs this law", "stiffness": "every actuator needs this law"}
    why |= {"elastic_energy": "an actuator with three motors needs this law"} if actuator.motors > 2 else {}
    why |= {"elastic_energy": "an actuator with motors on the housing needs this law"} if actuator.housed else {}
    for law, (arguments, count) in taken.items():
        own, problem = inspect.getattr_static(actuator, law), partial(declaration_problem, actuator, key=law)
        if arguments is spring and own is inspect.getattr_static(Actuator, law):
            if law in why:
                yield problem(f"is missing; {why[law]}", "missing-law")
            continue
        if not isinstance(own, staticmethod):
            yield problem("must be a @staticmethod: laws have no state", "bad-law")
            continue
        try:
            result = own.__func__(*arguments.values())
        except (Exception, SystemExit) as error:
            yield problem(f"raised {type(error).__name__}: {error}; the law must take {', '.join(arguments)}", "law-raised")
            continue
        numbers = result if count > 1 and isinstance(result, tuple) else (result,)
        if len(numbers) != count or not all(isinstance(number, (int, float)) for number in numbers):
            wanted = f"{count} numbers" if count > 1 else "one number"
            yield problem(f"must give {wanted}", "law-result", value=result)


def file_of(actuator: type[Any]) -> Path | None:
    """File in which the class is defined."""
    file = getattr(sys.modules.get(actuator.__module__), "__file__", None)
    return Path(file).resolve() if file else None


def declaration_problem(actuator: type[Any], message: str, code: str, *, key: str, value: object | None = None) -> Problem:
    """Problem of a class, with file and line of the class. key: name of the wrong attribute or law."""
    line: int | None = None
    with suppress(OSError, TypeError):
        line = inspect.getsourcelines(actuator)[1]
    return Problem(message, file=file_of(actuator), line=line, key=f"{actuator.__name__}.{key}", value=value, code=code)
