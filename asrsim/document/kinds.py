"""Kinds of values in documents. Each kind reads a node, and has a description and a JSON Schema."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Generic, TypeVar, cast

from asrsim.document.node import Node
from asrsim.document.reading import DocumentReading, KeyPath, Rejected
from asrsim.errors import did_you_mean

T = TypeVar("T")
T_co = TypeVar("T_co", covariant=True)
Schema = dict[str, Any]


class Kind(ABC, Generic[T_co]):
    """Kind of a value in a document."""

    @abstractmethod
    def read(self, node: Node, path: KeyPath, reading: DocumentReading) -> T_co:
        """Value of the node. Raises Rejected after recording the problems in `reading`.

        Some kinds with parts return the valid parts: the document is valid only if `reading` has no problems.
        """

    @abstractmethod
    def schema(self) -> Schema:
        """JSON Schema of the allowed values."""

    @property
    @abstractmethod
    def text(self) -> str:
        """Short description for messages and for tables in the documentation."""

    @property
    def parts(self) -> tuple[tuple[str, Kind[Any]], ...]:
        """Kinds of the parts: (suffix of the part's path, such as `.name` or `[]`; kind)."""
        return ()

    def merge(self, base: Node, over: Node) -> Node:
        """Value of a variant: `over`; if the kind has parts, the parts of `over` replace those of `base`."""
        return over


@dataclass(frozen=True, kw_only=True)
class Number(Kind[float]):
    """Kind of value: a real number, finite unless `finite` is False."""

    minimum: float | None = None
    above: float | None = None
    """Exclusive lower limit."""
    maximum: float | None = None
    finite: bool = True
    noun: ClassVar[str] = "number"
    json_type: ClassVar[str] = "number"

    def read(self, node: Node, path: KeyPath, reading: DocumentReading) -> float:
        value = node.value
        if not self.finite and value in ("inf", "+inf", "-inf"):
            value = float(str(value))
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise reading.fault(node, path, f"must be a {self.noun}", code="type")
        number = float(value) if isinstance(value, float) or abs(value) < 1 << 1023 else math.inf  # larger integers overflow
        if math.isnan(number) or (self.finite and math.isinf(number)):
            raise reading.fault(node, path, "must be a finite number", code="range")
        if (
            (self.minimum is not None and number < self.minimum)
            or (self.above is not None and number <= self.above)
            or (self.maximum is not None and number > self.maximum)
        ):
            raise reading.fault(node, path, f"must be a {self.text}", code="range")
        return number

    def schema(self) -> Schema:
        limits = {"minimum": self.minimum, "exclusiveMinimum": self.above, "maximum": self.maximum}
        schema = {"type": self.json_type, **{key: value for key, value in limits.items() if value is not None}}
        return schema if self.finite else {"anyOf": [schema, {"enum": ["inf", "+inf", "-inf"]}]}

    @property
    def text(self) -> str:
        limits = ((">=", self.minimum), (">", self.above), ("<=", self.maximum))
        bounds = [f"{sign} {limit:g}" for sign, limit in limits if limit is not None]
        return " ".join([self.noun, " and ".join(bounds)]).strip()


NUMBER = Number()
POSITIVE = Number(above=0.0)
NOT_NEGATIVE = Number(minimum=0.0)
SHARE = Number(minimum=0.0, maximum=1.0)


class Integer(Number):
    """Kind of value: a whole number."""

    noun = "whole number"
    json_type = "integer"

    def read(self, node: Node, path: KeyPath, reading: DocumentReading) -> int:
        if isinstance(node.value, float) and not node.value.is_integer():
            raise reading.fault(node, path, f"must be a {self.noun}", code="type")
        super().read(node, path, reading)
        return int(cast("float", node.value))


@dataclass(frozen=True)
class Boolean(Kind[bool]):
    """Kind of value: `true` or `false`."""

    def read(self, node: Node, path: KeyPath, reading: DocumentReading) -> bool:
        if not isinstance(node.value, bool):
            raise reading.fault(node, path, "must be true or false", code="type")
        return node.value

    def schema(self) -> Schema:
        return {"type": "boolean"}

    @property
    def text(self) -> str:
        return "true or false"


@dataclass(frozen=True, kw_only=True)
class Text(Kind[str]):
    """Kind of value: non-empty text."""

    noun: str = "text"
    """Noun for the text, for messages and tables."""

    def read(self, node: Node, path: KeyPath, reading: DocumentReading) -> str:
        if isinstance(node.value, bool | int | float):  # for example 1 as the name of a joint
            return str(node.plain()).lower() if isinstance(node.value, bool) else str(node.value)
        if not isinstance(node.value, str) or not node.value.strip():
            raise reading.fault(node, path, f"must be {self.noun}", code="type")
        return node.value

    def schema(self) -> Schema:
        return {"type": ["string", "number", "boolean"]}

    @property
    def text(self) -> str:
        return self.noun


@dataclass(frozen=True)
class Choice(Kind[str]):
    """Kind of value: one of several words. A function may give the words, so that a registry is imported only when needed."""

    options: tuple[str, ...] | Callable[[], Iterable[str]]
    noun: str = ""
    """Noun for the words in tables; "": tables list the words."""
    missing: str = ""
    """Hint for an unknown word."""

    @property
    def words(self) -> tuple[str, ...]:
        """Valid words."""
        return tuple(self.options() if callable(self.options) else self.options)

    def read(self, node: Node, path: KeyPath, reading: DocumentReading) -> str:
        value = str(node.value) if isinstance(node.value, str | int) and not isinstance(node.value, bool) else None
        words = self.words
        if value not in words:
            hint = did_you_mean(str(node.value), words) or self.missing or None
            raise reading.fault(node, path, "is not one of the choices", choices=words, hint=hint, code="choice")
        return value

    def schema(self) -> Schema:
        return {"enum": list(self.words)}

    @property
    def text(self) -> str:
        return self.noun or " or ".join(f"`{word}`" for word in self.words)


@dataclass(frozen=True, kw_only=True)
class File(Kind[Path]):
    """Kind of value: path of a file, relative to the document's folder. The file is added to the document's attachments."""

    noun: str = "file"
    attach: bool = True
    folder: bool = False
    """True: a folder is valid too."""
    exists: bool = True
    """True: the file must exist when the document is read."""
    beside: str = ""
    """Ending of a document about the file, such as `.yaml` for `lab.csv.yaml`. An existing document is attached too."""

    def read(self, node: Node, path: KeyPath, reading: DocumentReading) -> Path:
        if not isinstance(node.value, str) or not node.value.strip() or "\0" in node.value:
            raise reading.fault(node, path, f"must be the path of a {self.noun}", code="type")
        place = reading.locate(node.value, folder=self.folder)
        if not self.exists:
            return place
        try:
            there = place.is_file() or (self.folder and place.is_dir())
        except OSError:
            there = False
        if not there:
            raise reading.fault(node, path, f"there is no {self.noun} {place}", code="no-file", show=False)
        if self.attach:
            reading.attach(node, place)
            described = place.with_name(place.name + self.beside)
            if self.beside and described.is_file():
                reading.attachments[f"{reading.renamed[id(node)]}{self.beside}"] = described
        return place

    def schema(self) -> Schema:
        return {"type": "string"}

    @property
    def text(self) -> str:
        return f"path of a {self.noun}"


@dataclass(frozen=True)
class Optional(Kind[T | None], Generic[T]):
    """Kind of value: a value or null. `word`, such as none, may stand for null."""

    kind: Kind[T]
    word: str | None = None

    def read(self, node: Node, path: KeyPath, reading: DocumentReading) -> T | None:
        if node.value is None or (self.word is not None and node.value == self.word):
            return None
        return self.kind.read(node, path, reading)

    def schema(self) -> Schema:
        return {"anyOf": [self.kind.schema(), {"enum": [None, self.word] if self.word else [None]}]}

    @property
    def text(self) -> str:
        return self.kind.text + (f" or `{self.word}`" if self.word else "")

    @property
    def parts(self) -> tuple[tuple[str, Kind[Any]], ...]:
        return (("", self.kind),)

    def merge(self, base: Node, over: Node) -> Node:
        return self.kind.merge(base, over)


def attempt(kind: Kind[T], node: Node, path: KeyPath, reading: DocumentReading) -> tuple[T] | None:
    """Tuple (value,) with the node's value; None for an invalid value, after recording its problem and path in `reading`."""
    try:
        return (kind.read(node, path, reading),)
    except Rejected:
        reading.unread.append(path)
        return None
