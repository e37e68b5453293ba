"""What tests are told, held against what it was when somebody last read it: every problem and every output of a command,
what the functions that a test calls give, the files and the pictures.

A test asks for a word of a message; this asks for all of it, its place, its cure, its numbers, and that nothing else is said.
A test without a record is not compared. `ASRSIM_RECORD=1 python -m pytest tests/test_scenario.py` records modules that have a
file in `seen/told` anew, in one process (an empty file begins a record): read the difference before you keep it.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
from given import listen_to, watch_files
from seen import differences, steady

from asrsim.errors import Problem

ROOT = Path(__file__).parents[1]
RECORDED = ROOT / "tests" / "seen" / "told"
PASSING = re.compile(r"(?:/tmp/|[^\s'\"]*\.\./\.\./)[^\s'\",:;)]*|0x[0-9a-f]{6,}|(?<=\.py):\d+")
"""Places of one run."""
CALLED = re.compile(r"python -m (?:pytest\.)?asrsim")
"""The command's name follows from how pytest was called."""
APART = re.compile(r"(?<=\bpip) --python \S+")
"""An environment with and one without a pip of its own."""
SHARED = "/shared/"
"""Not every clone has this folder, and what is in it is not ours to repeat."""
LONGEST = 240
"""Characters of a line that are kept."""
MOST = 40
"""Lines of a test that are kept."""
GIVEN = 14
"""Lines of a test about what it was given."""
MARK = "> "
"""Before these; a record from before they were kept has none, and asks for none."""
_heard: list[str] = []
_given: list[str] = []


def hear(text: str) -> None:
    """What a command wrote belongs to what the test is told."""
    _heard.append(text)


def _path(module: str) -> Path:
    return RECORDED / f"{module}.txt"


@cache
def _recorded(module: str) -> dict[str, list[str]]:
    """Test -> lines."""
    path, found = _path(module), dict[str, list[str]]()
    for part in path.read_text(encoding="utf-8").split("\n== ")[1:] if path.exists() else ():
        name, *lines = filter(None, part.splitlines())
        found[name] = lines
    return found


def _lines(heard: list[str], folder: Path) -> list[str]:
    """Different lines, without the places of one run."""
    text = CALLED.sub("asrsim", "\n".join(heard).replace(str(ROOT), "ROOT").replace(str(folder), "FOLDER"))
    text = APART.sub("", text)
    return list(dict.fromkeys(line for line in steady(PASSING.sub("PLACE", text), folder) if line.strip()))


def listening(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A fixture's body: the test, and then the comparison."""
    _heard.clear()
    _given.clear()
    module, name = request.path.stem, request.node.name.encode("unicode_escape").decode()
    recorded = _recorded(module).get(name)
    # Hypothesis draws other examples every time.
    restless = hasattr(request.function, "hypothesis") or request.node.get_closest_marker("restless")
    anew = "ASRSIM_RECORD" in os.environ and _path(module).exists() and not restless
    # Without PyBullet the other engine is the default, and its name stands in what is said.
    if not (anew or recorded is not None) or find_spec("pybullet") is None:
        yield
        return
    folder = request.getfixturevalue("tmp_path") if "tmp_path" in request.fixturenames else ROOT
    made = Problem.__init__

    def told(problem: Problem, *arguments: Any, **values: Any) -> None:
        made(problem, *arguments, **values)
        listed = f"{problem.code} {problem}"
        # Whoever did not know the file had made the same without its place.
        bare = listed.replace(f" {problem.file}:{problem.line}:", "", 1)
        if bare in _heard and bare != listed:
            _heard.remove(bare)
        _heard.append(listed)

    monkeypatch.setattr(Problem, "__init__", told)
    listen_to(request.module, _given)
    watch_files(monkeypatch, _given)
    yield
    lines = [line[:LONGEST] for line in _lines(_heard, folder)][:MOST]
    if anew or any(line.startswith(MARK) for line in recorded or []):
        lines += [MARK + line for line in _lines(_given, folder)[:GIVEN]]
    if anew and not any(SHARED in line for line in (*_heard, *_given)):
        _recorded(module)[name] = lines
        parts = ["\n".join([f"\n== {test}", *said]) for test, said in _recorded(module).items()]
        _path(module).write_text("".join(parts) + "\n", encoding="utf-8")
    if anew:
        return
    found = differences(lines, recorded or [])
    assert not found, "\n".join(found[:20])
