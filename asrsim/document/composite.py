"""Kinds of values with parts: lists, mappings with free names, and alternatives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from asrsim.document.kinds import Kind, Schema, attempt
from asrsim.document.node import Node
from asrsim.document.reading import DocumentReading, KeyPath, Rejected

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class ListOf(Kind[tuple[T, ...]], Generic[T]):
    """Kind of value: a list of values of one kind."""

    of: Kind[T]
    minimum: int = 0
    length: int | None = None
    """Exact length; None: any length."""
    names: tuple[str, ...] = ()
    """Names of the entries of a list with fixed length, for messages and tables."""

    def read(self, node: Node, path: KeyPath, reading: DocumentReading) -> tuple[T, ...]:
        if not isinstance(node.value, list):
            raise reading.fault(node, path, f"must be a {self.text}", code="type")
        if self.length is not None and len(node.value) != self.length:
            raise reading.fault(node, path, f"must be a {self.text}, but has {len(node.value)} entries", code="length")
        if len(node.value) < self.minimum:
            raise reading.fault(node, path, f"needs at least {self.minimum} entries", code="length")
        results = [attempt(self.of, item, (*path, str(index)), reading) for index, item in enumerate(node.value)]
        read = tuple(result[0] for result in results if result is not None)
        if len(read) < len(results):
            raise Rejected
        return read

    def schema(self) -> Schema:
        schema: Schema = {"type": "array", "items": self.of.schema()}
        lowest = self.length if self.length is not None else self.minimum
        if lowest:
            schema["minItems"] = lowest
        if self.length is not None:
            schema["maxItems"] = self.length
        return schema

    @property
    def text(self) -> str:
        if self.names:
            return f"list [{', '.join(self.names)}]"
        return f"list of {self.of.text}" if self.length is None else f"list of {self.length} x {self.of.text}"

    @property
    def parts(self) -> tuple[tuple[str, Kind[Any]], ...]:
        return (("[]", self.of),)


@dataclass(frozen=True, kw_only=True)
class MapOf(Kind[dict[str, T]], Generic[T]):
    """Kind of value: a mapping from free names (mostly joints) to values of one kind. Faulty entries are left out."""

    of: Kind[T]
    noun: str = "joint"
    """Noun for what the names refer to."""
    star: bool = True
    """True: the name `*` may stand for all names."""
    bare: bool = False
    """True: a value that is not a mapping applies to all names."""

    def read(self, node: Node, path: KeyPath, reading: DocumentReading) -> dict[str, T]:
        if node.value is None:
            return {}
        if self.bare and not isinstance(node.value, dict):
            return {"*": self.of.read(node, path, reading)}
        if not isinstance(node.value, dict):
            raise reading.fault(node, path, f"must be a {self.text}", code="type")
        results = {name: attempt(self.of, item, (*path, name), reading) for name, item in node.value.items()}
        if not self.star and "*" in results:
            raise reading.fault(node.value["*"], (*path, "*"), f"'*' cannot stand for a {self.noun} here", show=False)
        return {name: result[0] for name, result in results.items() if result is not None}

    def schema(self) -> Schema:
        schema: Schema = {"type": ["object", "null"], "additionalProperties": self.of.schema()}
        return {"anyOf": [self.of.schema(), schema]} if self.bare else schema

    @property
    def text(self) -> str:
        return (f"{self.of.text}, or " if self.bare else "") + f"mapping from {self.noun} to {self.of.text}"

    @property
    def parts(self) -> tuple[tuple[str, Kind[Any]], ...]:
        return ((f".<{self.noun}>", self.of),)

    def merge(self, base: Node, over: Node) -> Node:
        return merge_items(base, over, lambda _: self.of)


@dataclass(frozen=True)
class Either(Kind[Any]):
    """Kind of value: one of several kinds, chosen by the type of the YAML value."""

    options: tuple[tuple[Callable[[Node], bool], Kind[Any]], ...]
    """Pairs (function that tells whether a node fits, kind), tried in order."""

    def read(self, node: Node, path: KeyPath, reading: DocumentReading) -> Any:
        for fits, kind in self.options:
            if fits(node):
                return kind.read(node, path, reading)
        raise reading.fault(node, path, f"must be a {self.text}", code="type")

    def schema(self) -> Schema:
        return {"anyOf": [kind.schema() for _, kind in self.options]}

    @property
    def text(self) -> str:
        return ", or ".join(kind.text for _, kind in self.options)

    @property
    def parts(self) -> tuple[tuple[str, Kind[Any]], ...]:
        return tuple(("", kind) for _, kind in self.options)

    def merge(self, base: Node, over: Node) -> Node:
        for fits, kind in self.options:
            if fits(base) and fits(over):
                return kind.merge(base, over)
        return over


def is_mapping(node: Node) -> bool:
    """Whether a node is a mapping."""
    return isinstance(node.value, dict)


def is_list(node: Node) -> bool:
    """Whether a node is a list."""
    return isinstance(node.value, list)


def is_scalar(node: Node) -> bool:
    """Whether a node is a number, a text, a boolean or null."""
    return not isinstance(node.value, dict | list)


def merge_items(base: Node, over: Node, kind_of: Callable[[str], Kind[Any] | None]) -> Node:
    """Mapping `base` with the keys of `over`. A null value in `over` removes the key."""
    if not isinstance(base.value, dict) or not isinstance(over.value, dict):
        return over
    items = dict(base.value)
    lines = dict(base.key_lines or {})
    for key, value in over.value.items():
        lines[key] = over.key_line(key)
        if value.value is None:
            items.pop(key, None)
            continue
        kind = kind_of(key)
        items[key] = kind.merge(items[key], value) if kind is not None and key in items else value
    return Node(items, over.line if over.line is not None else base.line, lines, over.file or base.file)
