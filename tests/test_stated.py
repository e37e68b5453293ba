"""Every number that the code states by a name, in a table, as a default of an argument or of a field, is what it was when
somebody last read it: a threshold, a unit or a default that changes is meant to change.

`ASRSIM_RECORD=1 python -m pytest tests/test_stated.py` records them anew: read the difference before you keep it.
"""

from __future__ import annotations

import inspect
import os
import pkgutil
import re
from collections.abc import Iterator
from dataclasses import MISSING, fields, is_dataclass
from difflib import unified_diff
from importlib import import_module
from pathlib import Path
from types import ModuleType

import pytest
from given import FULL, value_line
from seen import steady

import asrsim

pytestmark = pytest.mark.once

RECORDED = Path(__file__).parent / "seen" / "stated.txt"
SILENT = ("__main__", "bullet", "environment", "fastdds", "live.ros", "foxglove", "versions")
"""Modules that not every machine can import, and those about the machine itself."""
WORDING = re.compile(r" (?:doc: )?(?:'[^'\n]*'|\"[^\"\n]*\")")
"""Words are not numbers."""
NAMED = re.compile(r"^(\w+)(?:: [^=\n]+)? = ", re.MULTILINE)
TELLING = re.compile(r"\d|True|False")


def stated(module: ModuleType) -> Iterator[str]:
    """Constants, defaults of arguments and of fields of a module."""
    for name in NAMED.findall(Path(str(module.__file__)).read_text(encoding="utf-8")):
        value = getattr(module, name, None)
        if not isinstance(value, str | type):
            yield value_line(f"  {name} =", value, FULL)
    for name, thing in vars(module).items():
        if getattr(thing, "__module__", "") == module.__name__:
            if inspect.isclass(thing):
                yield from _of_class(name, thing)
            elif inspect.isfunction(thing):
                yield from _of_function(name, thing)


def _of_class(name: str, kind: type) -> Iterator[str]:
    if is_dataclass(kind):
        given = {field.name: field.default for field in fields(kind) if field.default is not MISSING}
    else:
        given = {key: value for key, value in vars(kind).items() if isinstance(value, int | float | tuple)}
    if given:
        yield value_line(f"  {name}:", given, FULL)
    for method, function in vars(kind).items():
        if inspect.isfunction(function) and not (is_dataclass(kind) and method == "__init__"):
            yield from _of_function(f"{name}.{method}", function)


def _of_function(name: str, function: object) -> Iterator[str]:
    parameters = inspect.signature(function).parameters.values()  # type: ignore[arg-type]
    given = {one.name: one.default for one in parameters if one.default is not inspect.Parameter.empty}
    if given:
        yield value_line(f"  {name}:", given, FULL)


def test_numbers_are_those_that_somebody_read() -> None:
    lines = []
    for found in pkgutil.walk_packages(asrsim.__path__, "asrsim."):
        if not any(word in found.name for word in SILENT):
            said = [line for line in stated(import_module(found.name)) if TELLING.search(line)]
            lines += [found.name, *said] if said else []
    shown = steady(WORDING.sub("", "\n".join(lines)), Path("/nowhere"))
    if "ASRSIM_RECORD" in os.environ:
        RECORDED.write_text("\n".join(shown) + "\n", encoding="utf-8")
    recorded = RECORDED.read_text(encoding="utf-8").splitlines()
    assert not list(unified_diff(recorded, shown, "recorded", "now", n=0, lineterm=""))
