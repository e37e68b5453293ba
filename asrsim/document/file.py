"""A whole file that is one block of declared keys."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TypeVar

from asrsim.document.block import Block
from asrsim.document.reading import Reading, Rejected
from asrsim.document.yaml_reader import read_yaml
from asrsim.errors import InputError, Problem

T = TypeVar("T")


def read_file(block: Block[T], path: Path) -> T:
    """What the file's keys make. Raises InputError with every problem."""
    faults: list[Problem] = []
    root, _ = read_yaml(path, faults=faults)
    reading = Reading(base=path.parent)
    found: T | None = None
    with suppress(Rejected):
        found = block.read(root, (), reading)
    if faults or reading.problems or found is None:
        raise InputError([*faults, *reading.problems])
    return found


def has_key(path: Path, key: str) -> bool:
    """Whether a file has a key at its top, which tells what kind of file it is. Raises InputError where it cannot be read."""
    root, _ = read_yaml(path)
    return isinstance(root.value, dict) and key in root.value
