"""What functions of asrsim give to a test, and what files and pictures are written, as lines of text for :mod:`told`."""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import wraps
from inspect import getattr_static, isfunction
from itertools import islice
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
import pytest
from matplotlib.figure import Figure
from seen import CHANGING, _extent, figure_lines, page_lines

import asrsim
from asrsim.samples import Samples

ROOT = Path(__file__).parents[1]
HERE = re.compile(r"[^\s'\"]*/pytest-of-[^/]+/pytest-\d+/(?:popen-gw\d+/)?[^/\s'\"]+/")
"""A test's own folder; places are named before texts are cut, which would else be cut elsewhere in another checkout."""
WORDS = 60
"""Of a value or a file, which are kept."""
SPEED = CHANGING[0][0]
DRAWN = 12
"""Lines of a figure."""
TEXTS = (".json", ".csv", ".html", ".yaml", ".urdf")
TIMED = {
    "wall_time", "simulating_time", "speed", "seconds", "busy", "generator", "versions", "folder", "path", "digest", "started",
    "python", "numpy", "scipy", "mujoco", "pybullet", "numba", "matplotlib",
}  # fmt: skip
"""Names of what differs from run to run."""


class Detail(NamedTuple):
    """How much of a value is shown."""

    elements: int = 6
    """Of a list."""
    words: int = WORDS
    least: float = 1e-7
    """Numbers below it are 0."""


BRIEF = Detail()


def value_line(label: str, value: Any, detail: Detail = BRIEF) -> str:
    """A value, whatever it is."""
    return " ".join((label, *islice(_words(value, detail, 0), detail.words)))


def _words(value: Any, detail: Detail, depth: int) -> Iterator[str]:
    if isinstance(value, np.ndarray) and value.dtype.kind in "biuf" and value.size > detail.elements:
        yield f"{value.shape} {_extent(value.astype(float).ravel())}"
    elif isinstance(value, np.ndarray | np.generic):
        yield from _words(value.tolist(), detail, depth)
    elif value is None or isinstance(value, bool | Enum):
        yield str(value)
    elif isinstance(value, int | float):
        yield "0" if abs(value) < detail.least else f"{value:.4g}"
    elif isinstance(value, str):
        # Of a page in one word the search for places would take minutes.
        yield repr(SPEED.sub("SPEED", HERE.sub("FOLDER/", value[:2000].replace(str(ROOT), "ROOT")))[:60])
    elif isinstance(value, Path):
        yield value.name
    elif depth > 5:
        yield "..."
    elif isinstance(_kept(value), Samples):
        yield from _words(value.samples, detail, depth)
    elif is_dataclass(value):
        yield type(value).__name__
        for field in fields(value):
            yield from _named(field.name, getattr(value, field.name, None), detail, depth)
    elif isinstance(value, Mapping):
        for name, one in islice(value.items(), 3 * detail.elements):
            yield from _named(str(name), one, detail, depth)
    elif isinstance(value, Set):
        yield from _words(sorted(map(str, value)), detail, depth)
    elif isinstance(value, Sequence) and not isinstance(value, bytes | bytearray | memoryview):
        yield f"[{len(value)}"
        for one in value[: detail.elements]:
            yield from _words(one, detail, depth + 1)
        yield "]"
    else:
        yield getattr(value, "__name__", type(value).__name__)


def _kept(value: Any) -> Any:
    """Its samples, where they are there: a property may make them, and change what it is of."""
    return None if isinstance(getattr_static(type(value), "samples", None), property) else getattr(value, "samples", None)


def _named(name: str, value: Any, detail: Detail, depth: int) -> Iterator[str]:
    if value is not None and not name.startswith("_") and name not in TIMED:
        yield f"{name}:"
        yield from _words(value, detail, depth + 1)


def listen_to(module: ModuleType, heard: list[str]) -> None:
    """From now on every function of asrsim that a test module calls by its name leaves in `heard` what it gives."""
    for name, function in list(vars(module).items()):
        if isfunction(function) and function.__module__.startswith("asrsim") and not hasattr(function, "__wrapped__"):
            setattr(module, name, _listened(name, function, heard))
        elif function is asrsim:
            setattr(module, name, _Listened(function, heard))
        elif hasattr(function, "cache_info") and function.__module__ == module.__name__:
            setattr(module, name, _unheard(function, heard))


class _Listened:
    """The package itself, as a test knows it."""

    def __init__(self, package: ModuleType, heard: list[str]) -> None:
        self._package, self._own = package, heard

    def __getattr__(self, name: str) -> Any:
        found = getattr(self._package, name)
        return _listened(name, found, self._own) if isfunction(found) else found

    def __dir__(self) -> list[str]:
        return dir(self._package)


def _listened(name: str, function: Callable[..., Any], heard: list[str]) -> Callable[..., Any]:
    @wraps(function)
    def call(*arguments: Any, **options: Any) -> Any:
        value = function(*arguments, **options)
        if value is not None:
            heard.append(value_line(f"{name} ->", value))
        return value

    return call


def _unheard(function: Callable[..., Any], heard: list[str]) -> Callable[..., Any]:
    """What the module computes once is given to whichever test happens to be the first."""

    def call(*arguments: Any, **options: Any) -> Any:
        before = len(heard)
        value = function(*arguments, **options)
        del heard[before:]
        return value

    return call


def watch_files(monkeypatch: pytest.MonkeyPatch, heard: list[str]) -> None:
    """During a test every text that `asrsim.outfile` puts in place, and every figure that is drawn into a file, is heard."""
    replace, save = Path.replace, Figure.savefig

    def replaced(path: Path, target: Any) -> Path:
        found = replace(path, target)
        if path.name.startswith(".asrsim-") and found.suffix in TEXTS:
            heard.extend(_file_lines(found))
        return found

    def saved(figure: Figure, *arguments: Any, **options: Any) -> None:
        heard.extend(figure_lines(figure)[:DRAWN])
        save(figure, *arguments, **options)

    monkeypatch.setattr(Path, "replace", replaced)
    monkeypatch.setattr(Figure, "savefig", saved)


def _file_lines(path: Path) -> list[str]:
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".json":
        return [value_line(f"{path.name}:", json.loads(text), Detail(words=3 * WORDS))]
    if path.suffix == ".csv":
        rows = list(csv.reader(io.StringIO(text)))
        return [f"{path.name} {len(rows)}: {','.join(row)}" for row in (*rows[:2], *rows[2 :: max(len(rows) // 3, 1)])]
    words = " ".join(page_lines(text) if path.suffix == ".html" else [text]).split()
    return [" ".join((f"{path.name}:", *words[: 3 * WORDS]))]
