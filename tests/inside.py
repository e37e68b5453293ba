"""What functions inside asrsim gave while a session ran, as lines of text for :mod:`test_seen`.

A page or a table shows a part of what is computed, and rounded. These lines show it where it is made: of every function of the
package what its first calls gave, or, of one that gives nothing, what it was left with in its arguments.
"""

from __future__ import annotations

import pkgutil
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from importlib import import_module
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

from given import Detail, value_line
from seen import differences, steady

import asrsim

PACKAGE = f"{Path(__file__).parents[1] / 'asrsim'}/"
LOOKS = 8
"""Calls of a function that are looked at, in a session."""
KEPT = 6
"""Different lines of a function that are kept, over all sessions."""
LONGEST = 160
"""Characters of a line."""
DETAIL = Detail(elements=4, words=32)
PASSING = re.compile(r"PROJECT/|\.\./|'/\w|e\+1[2-9]|[0-9a-f]{12}|environment:")
"""Places, addresses and digests, which are those of one checkout and one machine."""
APART = ("runs/lock ", "log/storage McapStorage._write", "compiling ", "versions ", "live/", "workers/local Processes.")
"""Modules and functions whose values depend on when something happens, or on what else is open."""

Lines = dict[str, list[str]]
"""Function -> what it gave."""


class Inside:
    """A profile function: hears what functions of the package return."""

    def __init__(self, folder: Path) -> None:
        self.heard: Lines = {}
        self._folder = folder
        self._names: dict[int, tuple[str, CodeType]] = {}
        self._looks: dict[str, int] = {}

    def __call__(self, frame: FrameType, event: str, value: Any) -> None:
        if event != "return":
            return
        code = frame.f_code
        name = (self._names.get(id(code)) or self._named(code))[0]
        if not name or self._looks.get(name, 0) >= LOOKS:
            return
        self._looks[name] = self._looks.get(name, 0) + 1
        # What shows a value may call the package, too.
        sys.setprofile(None)
        if value is None:
            names = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
            value = {one: frame.f_locals.get(one) for one in names if one not in ("self", "cls")}
        # An error of this would end the program that is listened to.
        line = "cannot be shown"
        with suppress(Exception):
            line = " ".join(steady(value_line("", value, DETAIL), self._folder))[:LONGEST].strip()
        if not PASSING.search(line) and line not in self.heard.setdefault(name, []):
            self.heard[name].append(line)
        sys.setprofile(self)

    def _named(self, code: CodeType) -> tuple[str, CodeType]:
        """The module and name of a function of the package; the code is held, since its id is of use only while it lives."""
        own = code.co_filename.startswith(PACKAGE) and not code.co_name.startswith(("<", "__"))
        name = f"{code.co_filename[len(PACKAGE) : -3]} {code.co_qualname}" if own else ""
        name = "" if name.startswith(APART) else name
        self._names[id(code)] = name, code
        return self._names[id(code)]


@cache
def _import_all() -> None:
    """What modules do when they are imported belongs to no session."""
    for module in pkgutil.walk_packages(asrsim.__path__, "asrsim."):
        with suppress(ImportError):
            import_module(module.name) if not module.name.endswith("__main__") else None


@contextmanager
def inside(folder: Path, *, on: bool = True) -> Iterator[Inside]:
    """Listens from here, if it is on. What this process remembers of calls before is forgotten: all sessions begin alike."""
    listening = Inside(folder)
    if not on:
        yield listening
        return
    _import_all()
    for name, module in list(sys.modules.items()):
        for value in list(vars(module).values()) if name.startswith("asrsim.") else ():
            if hasattr(value, "cache_clear"):
                value.cache_clear()
    before = sys.getprofile()
    sys.setprofile(listening)
    try:
        yield listening
    finally:
        sys.setprofile(before)


def read(path: Path) -> Lines:
    """A record."""
    found: Lines = {}
    for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else ():
        name, _, value = line.partition(" -> ")
        found.setdefault(name, []).append(value)
    return found


def write(path: Path, heard: Lines, again: Lines) -> None:
    """Records what both of two runs gave, and other sessions' records do not hold often enough already."""
    others = [read(other) for other in sorted(path.parent.glob("*.txt")) if other != path]
    lines = []
    for name, values in sorted(heard.items()):
        kept = {value for other in others for value in other.get(name, ())}
        if values == again.get(name) and not set(values) <= kept and len(kept) < KEPT:
            lines += [f"{name} -> {value}" for value in values]
    path.parent.mkdir(exist_ok=True)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def otherwise(path: Path, heard: Lines, differ: Callable[[list[str], list[str]], list[str]] = differences) -> list[str]:
    """What functions gave otherwise than recorded."""
    found = []
    for name, values in read(path).items():
        if name not in heard:
            found.append(f"{name} was not called")
        else:
            found += [f"{name}: {text}" for text in differ(heard[name], values)]
    return found
