"""State while a document is read: folder of the document, problems found so far, attachments."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from asrsim.document.node import Node
from asrsim.errors import Problem

KeyPath = tuple[str, ...]


class Rejected(Exception):  # noqa: N818 - internal: the problem is already recorded, and readers continue with the next key
    """Raised for an invalid value, after the value's problem has been recorded in the reading."""


@dataclass(kw_only=True)
class DocumentReading:
    """Collects the problems of a document, and the files that it names, while it is read."""

    base: Path = field(default_factory=Path)
    """Folder to which paths in the document are relative."""
    files: Mapping[str, Path] = field(default_factory=dict)
    """Files by their name in the document, for a document from a log's attachments. They take precedence over files in
    `base`."""
    problems: list[Problem] = field(default_factory=list)
    attachments: dict[str, Path] = field(default_factory=dict)
    """File that the document names, by a unique short name; files in a folder have short names `folder/file`."""
    names: dict[Path, str] = field(default_factory=dict)
    """Short name of the attachment for each file or folder that the document names."""
    unread: list[KeyPath] = field(default_factory=list)
    """Paths of the keys with invalid values, which are left out of the result."""
    named: list[tuple[KeyPath, str, str]] = field(default_factory=list)
    """Names in the document of things outside it: path of the key, name, and noun, such as `joint`. `*` stands for all
    things."""
    renamed: dict[int, object] = field(default_factory=dict)
    """Short name of the attachment for each node that names a file, by id of the node."""

    def fault(self, node: Node, path: KeyPath, message: str, *, show: bool = True, **details: Any) -> Rejected:
        """Exception for an invalid value; its problem has been recorded. Callers raise it, or ignore it to continue reading.

        show: whether the message states the value. details: further fields of the `Problem`, such as its code.
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
        """Path of the file with this name in the document. folder: whether the name may be the name of an attached folder."""
        if text in self.files:
            return self.files[text]
        inside = next((path for name, path in self.files.items() if name.startswith(f"{text}/")), None)
        if folder and inside is not None:
            return inside.parent
        return self.base / Path(text).expanduser()

    def attach(self, node: Node, path: Path) -> None:
        """Record that the document needs the file `path`, or all files of the folder `path` (a bag). node: the node that names
        it."""
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
