"""The state of reading one document: where files are found, what was wrong."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from asrsim.document.node import Node
from asrsim.errors import Problem

KeyPath = tuple[str, ...]


class Rejected(Exception):  # noqa: N818 - internal: its problem is recorded already, readers go on with the next key
    """A value was refused; the problem is recorded in the reading."""


@dataclass(kw_only=True)
class Reading:
    """Collects problems and the files that a document names."""

    base: Path = field(default_factory=Path)
    """Folder from which relative paths count."""
    files: Mapping[str, Path] = field(default_factory=dict)
    """Files by the name that the document uses, before the folder is searched (attachments of a log)."""
    problems: list[Problem] = field(default_factory=list)
    attachments: dict[str, Path] = field(default_factory=dict)
    """Files named so far, by a unique short name; those in a folder as `folder/file`."""
    unread: list[KeyPath] = field(default_factory=list)
    """Paths of the values that have a fault: what is read goes without them."""
    renamed: dict[int, object] = field(default_factory=dict)
    """id of a node with a file name -> its name among the attachments."""

    def fault(
        self,
        node: Node | None,
        path: KeyPath,
        message: str,
        *,
        line: int | None = None,
        code: str = "value",
        show: bool = True,
        choices: tuple[str, ...] = (),
        hint: str | None = None,
        meant: str | None = None,
    ) -> Rejected:
        """Record a problem and give back the exception to raise (or to drop, to go on)."""
        self.problems.append(
            Problem(
                message,
                file=node.file if node else None,
                line=line if line is not None else (node.line if node else None),
                key=".".join(path) or None,
                value=node.describe() if node is not None and show else None,
                code=code,
                choices=choices,
                hint=hint,
                meant=meant,
            )
        )
        return Rejected(message)

    def locate(self, text: str, *, folder: bool) -> Path:
        """The file that a name in the document means; `folder`: or the folder that was attached with its files."""
        if text in self.files:
            return self.files[text]
        inside = next((path for name, path in self.files.items() if name.startswith(f"{text}/")), None)
        if folder and inside is not None:
            return inside.parent
        path = Path(text).expanduser()
        return path if path.is_absolute() else self.base / path

    def attach(self, node: Node, path: Path) -> None:
        """Note that the document needs `path`, named by `node`; of a folder (a bag), the files in it."""
        folder = path.is_dir()
        for name, known in self.attachments.items():
            if known == path or (folder and known.parent == path and name.endswith(f"/{known.name}")):
                self.renamed[id(node)] = name.rpartition("/")[0] if folder else name
                return
        taken = {name.partition("/")[0] for name in self.attachments}
        name, count = path.name, 1
        while name in taken:
            count += 1
            name = f"{path.stem}-{count}{path.suffix}"
        if folder:
            self.attachments |= {f"{name}/{file.name}": file for file in sorted(path.iterdir()) if file.is_file()}
        else:
            self.attachments[name] = path
        self.renamed[id(node)] = name
