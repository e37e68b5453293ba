"""State while a document is read: folder of its files, problems found, attachments."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from asrsim.document.node import Node
from asrsim.errors import Problem

KeyPath = tuple[str, ...]


class Rejected(Exception):  # noqa: N818 - internal: the problem is already recorded, and readers continue with the next key
    """Raised for an invalid value, after its problem was recorded in the reading."""


@dataclass(kw_only=True)
class DocumentReading:
    """Collects the problems and the files of a document."""

    base: Path = field(default_factory=Path)
    """Folder that relative paths refer to."""
    files: Mapping[str, Path] = field(default_factory=dict)
    """Files by their name in the document (attachments of a log), which take precedence over files in the folder."""
    problems: list[Problem] = field(default_factory=list)
    attachments: dict[str, Path] = field(default_factory=dict)
    """Unique short name -> file that the document names; files in a folder have names `folder/file`."""
    names: dict[Path, str] = field(default_factory=dict)
    """Name of the attachment for each file or folder."""
    unread: list[KeyPath] = field(default_factory=list)
    """Paths of the invalid values, which are left out of the result."""
    named: list[tuple[KeyPath, str, str]] = field(default_factory=list)
    """Names of things outside of the document: path, name, and noun, such as `joint`; `*` stands for all such things."""
    renamed: dict[int, object] = field(default_factory=dict)
    """Name of the attachment for each node with a file name, by id of the node."""

    def fault(self, node: Node, path: KeyPath, message: str, *, show: bool = True, **details: Any) -> Rejected:
        """Exception for an invalid value, whose problem is recorded. Callers raise it, or ignore it to continue.

        show: state the value in the message. details: further fields of the `Problem`, such as its code.
        """
        own = {
            "file": node.file,
            "line": node.line,
            "key": ".".join(path) or None,
            "code": "value",
            "value": node.describe() if show else None,
        }
        self.problems.append(Problem(message, **{**own, **details}))
        return Rejected(message)

    def locate(self, text: str, *, folder: bool) -> Path:
        """Path of the file with this name in the document. folder: the name may be that of an attached folder."""
        if text in self.files:
            return self.files[text]
        inside = next((path for name, path in self.files.items() if name.startswith(f"{text}/")), None)
        if folder and inside is not None:
            return inside.parent
        return self.base / Path(text).expanduser()

    def attach(self, node: Node, path: Path) -> None:
        """Record that the document needs the file `path`, or the files of a folder (a bag). node: contains the name."""
        if path not in self.names:
            taken = {name.partition("/")[0] for name in self.attachments}
            name, count = path.name, 1
            while name in taken:
                count += 1
                name = f"{path.stem}-{count}{path.suffix}"
            self.names[path] = name
            if path.is_dir():
                self.attachments |= {f"{name}/{file.name}": file for file in sorted(path.iterdir()) if file.is_file()}
            else:
                self.attachments[name] = path
        self.renamed[id(node)] = self.names[path]
