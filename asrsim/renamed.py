"""Names that have changed since the last version: the old names still work in this version, with a warning."""

from __future__ import annotations

import functools
import sys
import warnings
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, ParamSpec, TypeVar

if TYPE_CHECKING:
    from asrsim.document.node import Node

P = ParamSpec("P")
R = TypeVar("R")

OPTIONS = {
    "design": {"--seconds": "--duration", "--after": "--experiment"},
    "export": {"--timestep": "--step", "--to": "--format"},
    "identify": {"--time": "--duration"},
    "ilc": {"--next": "--experiment", "--lag": "--align"},
    "init": {"--force": "--overwrite", "-f": "--overwrite"},
    "live": {"--rate": "--publish-rate"},
    "plot": {"--lag": "--align"},
    "sweep": {"--design": "--sampler"},
    "twin": {"--lag": "--clock-offset"},
    "view": {"--lag": "--align"},
}
"""New name of each option that has changed, by command and old name."""
NAMES = {"asrsim": {"repeat": "rerun"}, "asrsim.identification": {"Result": "FitResult"}}
"""New name of each name that has changed, by package and old name."""
STUDY_KEYS = {"design": "sampler"}
"""New name of each key of a study that has changed, by old name."""
KEYS = {"effects": "imperfections", "substep_cap": "max_substeps"}
"""New name of each key of a scenario that has changed, by old name. In logs, the old names work forever."""
OLD_KEYS = STUDY_KEYS | KEYS
"""New name of each key of any document that has changed, by old name."""


class OldKeyWarning(FutureWarning):
    """A key of a scenario is written by its old name. The command line prints the message on a separate line."""


def tell(old: str, new: str) -> str:
    """Sentence that tells the user about a changed name."""
    return f"{old} is called {new} now; the next version drops the old name"


def new_name(package: str, old: str) -> str:
    """New name of the member that `package` once called `old`, with a warning. Raises AttributeError if `package` had no such
    name."""
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


def _caller() -> int:
    """Level of the stack at which code outside of asrsim called asrsim, as `warnings.warn` in the calling function counts
    levels."""
    level, found, frame = 1, 1, sys._getframe(1)
    while frame.f_back is not None:
        frame, level = frame.f_back, level + 1
        if frame.f_globals.get("__name__", "").partition(".")[0] == __package__:
            found = level
    return found + 1


def new_key(key: str, names: Mapping[str, str] = KEYS, place: str = "") -> str:
    """Dotted key of a document by its present name; warns if `key` is an old name. place: file and line of the key, if
    known."""
    head, dot, rest = key.partition(".")
    if head not in names:
        return key
    start = f"{place}: " if place else ""
    warnings.warn(tell(f"{start}the key `{head}`", f"`{names[head]}`"), OldKeyWarning, stacklevel=_caller())
    return f"{names[head]}{dot}{rest}"


def with_new_keys(root: Node, names: Mapping[str, str] = KEYS, *, told: bool = True) -> Node:
    """Document whose keys, including the keys of its variants, have their present names. told: whether to warn about old names,
    with file and line. If a document has the old and the new name of a key, the old name stays, and counts as an unknown key.
    """
    if not isinstance(root.value, dict):
        return root
    items: dict[str, Node] = {}
    lines = dict(root.key_lines or {})
    for key, node in root.value.items():
        name = key
        if key in names and names[key] not in root.value:
            name = names[key]
            lines[name] = lines.pop(key, None)
            if told:
                new_key(key, names, "" if root.file is None else f"{root.file}:{lines[name]}")
        if key == "variants" and isinstance(node.value, dict):
            node = replace(node, value={variant: with_new_keys(one, names, told=told) for variant, one in node.value.items()})
        items[name] = node
    return replace(root, value=items, key_lines=lines)
