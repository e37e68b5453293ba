"""Detects files of the wrong kind, and names the command for their kind."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from asrsim.document.node import Node
from asrsim.document.yaml_reader import read_yaml
from asrsim.errors import InputError, Problem

COMMANDS = {
    "robot": "asrsim init {path}",
    "scenario": "asrsim run {path}",
    "fit": "asrsim identify {path}",
    "limits": "asrsim design SCENARIO.yaml --limits {path}",
    "study": "asrsim sweep {path}",
    "log": "asrsim plot {path}",
    "recording": "asrsim init ROBOT.urdf --experiment {path}",
    "summary": "asrsim report {folder}",
}
"""Command that reads each kind of file."""
ENDINGS = {
    ".urdf": "robot", ".xacro": "robot", ".mcap": "log", ".csv": "recording", ".tsv": "recording", ".bag": "recording",
    ".db3": "recording", ".mat": "recording", ".npz": "recording", ".npy": "recording", ".xlsx": "recording",
    ".parquet": "recording", ".feather": "recording",
}  # fmt: skip
"""Kind of file for each file ending."""
FOLDERS = {"log.mcap": "log", "study.json": "study"}
"""Kind of a folder, by the name of a file that the folder contains."""
KEYS = {
    "summary": {"generator"},
    "scenario": {"robot", "references", "duration"},
    "limits": {"limits"},
    "fit": {"free", "experiments", "ties", "validate"},
    "study": {"over", "scenario"},
}
"""Top-level keys of each kind of file. Any of these keys identifies the kind; the first match wins."""
DOCUMENTS = (".yaml", ".yml", ".json")
"""Endings of files whose kind is detected by their keys."""


def kind_of(path: Path, root: Node | None = None) -> str | None:
    """Kind of a file by its ending, else by its keys; None if both are unknown. root: Root node, if already read."""
    if path.is_dir():
        return next((kind for name, kind in FOLDERS.items() if (path / name).exists()), None)
    if not path.exists():
        return None
    if kind := ENDINGS.get(path.suffix.lower()):
        return kind
    if root is None and path.suffix.lower() in DOCUMENTS:
        try:
            root, _ = read_yaml(path)
        except InputError:
            return None
    keys: Collection[str] = root.value if root is not None and isinstance(root.value, dict) else ()
    return next((kind for kind, known in KEYS.items() if known.intersection(keys)), None)


def mistaken(path: Path, wanted: str, root: Node | None = None) -> Problem | None:
    """Problem if the file or folder is clearly of another kind than `wanted`; None otherwise."""
    kind = kind_of(path, root)
    if kind is None or kind == wanted:
        return None
    command = COMMANDS[kind].format(path=path, folder=path.parent)
    return Problem(f"is a {kind}, no {wanted}", file=path, hint=f"Use it with: {command}", code="other-kind")
