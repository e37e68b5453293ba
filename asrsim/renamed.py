"""Names of the last version that have changed: they still work in this version, and say so."""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")

OPTIONS = {
    "design": {"--seconds": "--duration", "--after": "--experiment"},
    "export": {"--timestep": "--step"},
    "identify": {"--time": "--duration"},
    "ilc": {"--next": "--experiment", "--lag": "--align"},
    "live": {"--rate": "--publish-rate"},
    "plot": {"--lag": "--align"},
    "twin": {"--lag": "--clock-offset"},
    "view": {"--lag": "--align"},
}
"""Options of each command: old and new name."""
NAMES = {"asrsim": {"repeat": "rerun"}, "asrsim.identification": {"Result": "FitResult"}}
"""Names of each package: old and new name."""
KEYS = {"effects": "imperfections", "substep_cap": "max_substeps"}
"""Keys of a scenario: old and new name. Logs keep the old names for ever."""


class OldKeyWarning(FutureWarning):
    """A key of a scenario is written by its old name. The command line prints the message as a line of its own."""


def tell(old: str, new: str) -> str:
    """Sentence about a name that has changed."""
    return f"{old} is called {new} now; the next version drops the old name"


def new_name(package: str, old: str) -> str:
    """New name of what a package called `old`, with a warning. Raises AttributeError if there never was such a name."""
    new = NAMES[package].get(old)
    if new is None:
        raise AttributeError(f"module '{package}' has no attribute '{old}'")
    warnings.warn(tell(f"{package}.{old}", f"{package}.{new}"), DeprecationWarning, stacklevel=3)
    return new


def renamed(**names: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Decorator for a function that still takes keywords by their old names. names: new name of each old name."""

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        @functools.wraps(function)
        def call(*given: P.args, **named: P.kwargs) -> R:
            for old in names.keys() & named.keys():
                warnings.warn(tell(old, names[old]), DeprecationWarning, stacklevel=2)
                named[names[old]] = named.pop(old)
            return function(*given, **named)

        return call

    return decorate


def new_key(key: str, place: str = "") -> str:
    """Dotted key of a scenario by its present name; warns if it is given by an old name. place: file and line, if known."""
    head, dot, rest = key.partition(".")
    if head not in KEYS:
        return key
    warnings.warn(tell(f"{place}{': ' if place else ''}the key `{head}`", f"`{KEYS[head]}`"), OldKeyWarning, stacklevel=3)
    return f"{KEYS[head]}{dot}{rest}"
