"""Reads files that consist of one block of declared keys. For a file of another kind, an error names the command that reads
it."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

from asrsim.document.block import Block
from asrsim.document.kinds import attempt
from asrsim.document.node import Node
from asrsim.document.reading import DocumentReading
from asrsim.document.yaml_reader import read_yaml
from asrsim.errors import InputError, Problem
from asrsim.renamed import with_new_keys

T = TypeVar("T")

COMMANDS = {
    "robot": "asrsim init {path}",
    "scenario": "asrsim run {path}",
    "fit": "asrsim identify {path}",
    "file of limits": "asrsim design SCENARIO.yaml --limits {path}",
    "study": "asrsim sweep {path}",
    "log": "asrsim plot {path}",
    "recording": "asrsim init ROBOT.urdf --experiment {path}",
    "summary": "asrsim report {folder}",
}
"""Command that reads each kind of file, by kind."""
ENDINGS = {
    ".urdf": "robot",
    ".xacro": "robot",
    ".mcap": "log",
    **dict.fromkeys((".csv", ".tsv", ".bag", ".db3", ".mat", ".npz", ".npy", ".xlsx", ".parquet", ".feather"), "recording"),
}
"""Kind of file for each file ending."""
FOLDERS = {"log.mcap": "log", "study.json": "study"}
"""Kind of a folder, by the name of a file that the folder contains."""
KEYS = {
    "summary": {"generator"},
    "scenario": {"robot", "references", "duration"},
    "file of limits": {"limits"},
    "fit": {"free", "experiments", "ties", "validate"},
    "study": {"over", "scenario"},
}
"""Top-level keys by which a file is recognised. One of these keys is enough. If a file has keys of several kinds, it is of the
first kind."""
DOCUMENTS = (".yaml", ".yml", ".json")
"""Endings of files whose kind is detected by their keys."""

LFS = b"version https://git-lfs.github.com/spec/"
"""Beginning of the text that Git leaves in place of a file that Git LFS stores (Git LFS specification, version 1)."""


def lfs_pointer(start: bytes, wanted: str) -> Problem | None:
    """Problem if a file is a pointer of Git LFS in place of the wanted file; None otherwise. start: first bytes of the file."""
    if not start.startswith(LFS):
        return None
    message = f"is a pointer of Git LFS, not the {wanted}: the file itself was not fetched"
    return Problem(message, code="lfs-pointer", hint="`git lfs pull` in its repository fetches it")


def kind_of(path: Path, root: Node | None = None) -> str | None:
    """Kind of a file by its ending, else by its keys; None if both are unknown. root: root node of the file, if it has already
    been read."""
    if path.is_dir():
        return next((kind for name, kind in FOLDERS.items() if (path / name).exists()), None)
    if not path.exists():
        return None
    if kind := ENDINGS.get(path.suffix.lower()):
        return kind
    if root is None and path.suffix.lower() in DOCUMENTS:
        with suppress(InputError):
            root, _ = read_yaml(path)
    keys: Collection[str] = root.value if root is not None and isinstance(root.value, dict) else ()
    return next((kind for kind, known in KEYS.items() if known.intersection(keys)), None)


def mistaken(path: Path, wanted: str, root: Node | None = None) -> Problem | None:
    """Problem if the file or folder is clearly of a kind other than `wanted`; None otherwise."""
    kind = kind_of(path, root)
    if kind is None or kind == wanted:
        return None
    command = COMMANDS[kind].format(path=path, folder=path.parent)
    return Problem(f"is a {kind}, not a {wanted}", file=path, hint=f"Use it with: {command}", code="other-kind")


def read_document(
    path: Path, wanted: str, *, error: type[InputError] = InputError, faults: list[Problem] | None = None
) -> tuple[Node, str]:
    """Root node and text of a YAML file, as from `asrsim.document.yaml_reader.read_yaml`. Rejects a file of a kind other than
    `wanted`."""

    def require(root: Node | None = None) -> None:
        if (other := mistaken(path, wanted, root)) is not None:
            raise error([other])

    if path.suffix.lower() not in DOCUMENTS:
        require()
    root, text = read_yaml(path, error=error, faults=faults)
    require(root)
    return root, text


def read_file(block: Block[T], path: Path, *, renamed: Mapping[str, str] | None = None) -> T:
    """Object built from the keys of a file. Raises InputError with all problems of the file. renamed: new name of each old
    key."""
    faults: list[Problem] = []
    root, _ = read_document(path, block.noun, faults=faults)
    reading = DocumentReading(base=path.parent)
    found = attempt(block, with_new_keys(root, renamed or {}), (), reading)
    if faults or reading.problems or found is None:
        raise InputError([*faults, *reading.problems])
    return found[0]
