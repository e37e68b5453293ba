"""Reads files that consist of one block of declared keys."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TypeVar

from asrsim.document.block import Block
from asrsim.document.mistaken import DOCUMENTS, mistaken
from asrsim.document.node import Node
from asrsim.document.reading import DocumentReading, Rejected
from asrsim.document.yaml_reader import read_yaml
from asrsim.errors import InputError, Problem

T = TypeVar("T")


def read_document(
    path: Path, wanted: str, *, error: type[InputError] = InputError, faults: list[Problem] | None = None
) -> tuple[Node, str]:
    """Root node and text of a YAML file, as from `asrsim.document.yaml_reader.read_yaml`. Rejects files of another kind."""
    other = mistaken(path, wanted) if path.suffix.lower() not in DOCUMENTS else None
    if other is not None:
        raise error([other])
    root, text = read_yaml(path, error=error, faults=faults)
    other = mistaken(path, wanted, root)
    if other is not None:
        raise error([other])
    return root, text


def read_file(block: Block[T], path: Path) -> T:
    """Object built from the keys of a file. Raises InputError with every problem."""
    faults: list[Problem] = []
    root, _ = read_document(path, block.noun, faults=faults)
    reading = DocumentReading(base=path.parent)
    found: T | None = None
    with suppress(Rejected):
        found = block.read(root, (), reading)
    if faults or reading.problems or found is None:
        raise InputError([*faults, *reading.problems])
    return found
