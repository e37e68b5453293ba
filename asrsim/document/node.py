"""Nodes of a document: values with their lines."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

from asrsim.errors import listed

NodeValue: TypeAlias = "bool | int | float | str | list[Node] | dict[str, Node] | None"


@dataclass(frozen=True, slots=True, eq=False)
class Node:
    """Scalar, list or mapping of a document. Two nodes are equal only if they are the same object."""

    value: NodeValue
    line: int | None = None
    """Line in the file, counted from 1; None for values that are not from a file."""
    key_lines: Mapping[str, int | None] | None = None
    """Line of each key of a mapping."""
    file: Path | None = None
    """File that contains the node; None for values that are not from a file."""

    def key_line(self, key: str) -> int | None:
        """Line of a key of the mapping; the line of the mapping if the key has none."""
        return (self.key_lines or {}).get(key, self.line)

    def items(self) -> list[tuple[str, Node]]:
        """Pairs (key, node) of a mapping, or (index, node) of a list; empty for a scalar."""
        if isinstance(self.value, list):
            return [(str(index), node) for index, node in enumerate(self.value)]
        return list(self.value.items()) if isinstance(self.value, dict) else []

    def lines(self, file: Path | None, key: str = "") -> Iterator[tuple[str, int]]:
        """Pairs (dotted key, line) of all values in the node that come from `file`. key: prefix of the dotted keys."""
        for name, item in self.items():
            line = self.key_line(name) if isinstance(self.value, dict) else item.line
            if item.file == file and line is not None:
                yield f"{key}{name}", line
            yield from item.lines(file, f"{key}{name}.")

    def plain(self, renamed: Mapping[int, object] | None = None) -> Any:
        """Value as plain data, as JSON has. renamed: value that replaces a node's value, by id of the node."""
        if renamed and id(self) in renamed:
            return renamed[id(self)]
        if isinstance(self.value, dict):
            return {key: node.plain(renamed) for key, node in self.value.items()}
        if isinstance(self.value, list):
            return [node.plain(renamed) for node in self.value]
        return self.value

    def describe(self) -> object:
        """Value for a message: scalars unchanged, lists and mappings shortened."""
        if isinstance(self.value, dict):
            return "{" + ", ".join(self.value) + "}" if self.value else "{}"
        if isinstance(self.value, list):
            return f"[{listed((item.describe() for item in self.value), 6)}]"
        return "nothing" if self.value is None else self.value


def node_from_data(data: object) -> Node:
    """Tree of nodes made of plain data. Tuples become lists; other objects, such as paths, become text."""
    if isinstance(data, Mapping):
        return Node({str(key): node_from_data(value) for key, value in data.items()})
    if isinstance(data, list | tuple):
        return Node([node_from_data(value) for value in data])
    if data is None or isinstance(data, int | float | str):
        return Node(data)
    if hasattr(data, "item"):  # data is a NumPy scalar
        return Node(data.item())
    return Node(str(data))
