"""Kinds of values in documents. Each kind reads a node, and has a description and a JSON Schema."""

from __future__ import annotations

import math
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
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

        A mapping may be returned without its invalid entries: the document is valid only if `reading` has no problems.
        """

    @abstractmethod
    def schema(self) -> Schema:
        """JSON Schema of the allowed values."""

    @property
    @abstractmethod
    def text(self) -> str:
        """Short description for messages and for tables in the documentation."""

    def part(self, name: str) -> Key | None:
        """Key of an entry of a mapping, or of an entry of a list by its index; None if there can be no such entry."""
        return None

    def chosen(self, node: Node) -> Kind[Any]:
        """Kind that reads this node: the alternative that fits the node, if the kind has alternatives."""
        return self

    def fits(self, node: Node) -> bool:
        """Whether the type of the YAML value (scalar, list or mapping) is one that this kind reads."""
        return not isinstance(node.value, dict | list)

    def merge(self, base: Node, over: Node) -> Node:
        """Value of a variant: `over`; if the kind has parts, the parts of `over` replace those of `base`."""
        return over


REQUIRED: Any = object()
"""Default of a required key."""


@dataclass(frozen=True, kw_only=True)
class Key:
    """Declaration of a key in a mapping, or of the entries of a list or of a mapping with free names."""

    name: str
    """Name of the key; "": the declaration of an entry."""
    kind: Kind[Any]
    default: Any = REQUIRED
    doc: str = ""
    unit: str = ""
    attribute: str = ""
    """Name of the constructor's argument; "": the name of the key."""
    shown: str = ""
    """Description of the default in tables; "": the value itself."""
    spread: bool = False
    """True: the value is a mapping of several constructor arguments; without the key, all of them are omitted."""

    @property
    def required(self) -> bool:
        """Whether the key is required."""
        return self.default is REQUIRED

    @property
    def argument(self) -> str:
        """Name of the constructor's argument."""
        return self.attribute or self.name

    def schema(self) -> Schema:
        """JSON Schema of the value, with its description."""
        schema = self.kind.schema()
        if self.default is None:
            schema = {"anyOf": [schema, {"type": "null"}]}
        elif isinstance(self.default, bool | int | float | str):
            schema = {**schema, "default": self.default}
        return {**schema, "description": self.doc + (f" Unit: {self.unit}." if self.unit else "")}


def key_at(kind: Kind[Any], path: Sequence[str]) -> Key | None:
    """Key that declares the value at a path inside a kind; None if no key declares it.

    The key of an entry of a list, or of a mapping with free names, is the key of the list or mapping.
    """
    declared = None
    for name in path:
        key = kind.part(name)
        if key is None:
            return None
        kind, declared = key.kind, key if key.name else declared
    return declared


def walk(kind: Kind[Any], node: Node, path: KeyPath = ()) -> Iterator[tuple[KeyPath, Kind[Any], Node]]:
    """Tuples (path, kind, node) of a node and of all nodes inside it whose kinds are declared."""
    kind = kind.chosen(node)
    yield path, kind, node
    for name, item in node.items() if kind.fits(node) else ():
        key = kind.part(name)
        if key is not None:
            yield from walk(key.kind, item, (*path, name))


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

    def fits(self, node: Node) -> bool:
        return isinstance(node.value, int | float)

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

    text = "true or false"

    def read(self, node: Node, path: KeyPath, reading: DocumentReading) -> bool:
        if not isinstance(node.value, bool):
            raise reading.fault(node, path, "must be true or false", code="type")
        return node.value

    def schema(self) -> Schema:
        return {"type": "boolean"}


@dataclass(frozen=True, kw_only=True)
class Text(Kind[str]):
    """Kind of value: non-empty text."""

    noun: str = "text"
    """Noun for the text, for messages and tables."""

    def read(self, node: Node, path: KeyPath, reading: DocumentReading) -> str:
        if isinstance(node.value, bool | int | float):  # for example 1 as the name of a joint
            return str(node.plain()).lower() if isinstance(node.value, bool) else str(node.value)
        if not isinstance(node.value, str) or not node.value.strip():
            article = "the " if self.noun.startswith("name") else ""
            raise reading.fault(node, path, f"must be {article}{self.noun}", code="type")
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

    def fits(self, node: Node) -> bool:
        return isinstance(node.value, str)

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

    def fits(self, node: Node) -> bool:
        return node.value is None or self.kind.fits(node)

    def part(self, name: str) -> Key | None:
        return self.kind.part(name)

    def chosen(self, node: Node) -> Kind[Any]:
        return self.kind.chosen(node)

    def merge(self, base: Node, over: Node) -> Node:
        return self.kind.merge(base, over)


def attempt(kind: Kind[T], node: Node, path: KeyPath, reading: DocumentReading) -> tuple[T] | None:
    """Tuple (value,) with the node's value; None for an invalid value, after recording its problem and path in `reading`."""
    try:
        return (kind.read(node, path, reading),)
    except Rejected:
        reading.unread.append(path)
        return None


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
        several = re.sub(r"^(whole )?\w+", r"\g<0>s", self.of.text)
        several = re.sub(r"^names of an? (\w+)$", r"names of \1s", several)
        return f"list of {several}" if self.length is None else f"list of {self.length} {several}"

    def fits(self, node: Node) -> bool:
        return isinstance(node.value, list)

    def part(self, name: str) -> Key | None:
        return Key(name="", kind=self.of) if name.isdecimal() else None


@dataclass(frozen=True, kw_only=True)
class MapOf(Kind[dict[str, T]], Generic[T]):
    """Kind of value: a mapping from free names (mostly joints) to values of one kind. Faulty entries are left out."""

    of: Kind[T]
    noun: str = "joint"
    """Noun for the things that have these names, for messages."""
    star: bool = True
    """True: the name `*` may stand for all names."""
    bare: bool = False
    """True: a value that is not a mapping applies to all names."""

    def read(self, node: Node, path: KeyPath, reading: DocumentReading) -> dict[str, T]:
        if node.value is None:
            return {}
        if not isinstance(node.value, dict):
            if self.bare and self.of.chosen(node).fits(node):
                return {"*": self.of.read(node, path, reading)}
            article = "" if self.bare else "a "
            raise reading.fault(node, path, f"must be {article}{self.text}", code="type")
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

    def fits(self, node: Node) -> bool:
        return isinstance(node.value, dict)

    def part(self, name: str) -> Key | None:
        return Key(name="", kind=self.of)

    def chosen(self, node: Node) -> Kind[Any]:
        return self.of.chosen(node) if self.bare and not isinstance(node.value, dict) else self

    def merge(self, base: Node, over: Node) -> Node:
        return merge_items(base, over, self.part)


@dataclass(frozen=True)
class Either(Kind[Any]):
    """Kind of value: one of several kinds, chosen by the type of the YAML value."""

    options: tuple[Kind[Any], ...]
    """Kinds; the first that fits a node reads the node."""

    def read(self, node: Node, path: KeyPath, reading: DocumentReading) -> Any:
        for kind in self.options:
            if kind.fits(node):
                return kind.read(node, path, reading)
        raise reading.fault(node, path, f"must be {self.text}", code="type")

    def schema(self) -> Schema:
        return {"anyOf": [kind.schema() for kind in self.options]}

    @property
    def text(self) -> str:
        return ", or ".join(kind.text for kind in self.options)

    def part(self, name: str) -> Key | None:
        return next((key for kind in self.options if (key := kind.part(name)) is not None), None)

    def chosen(self, node: Node) -> Kind[Any]:
        return next((kind.chosen(node) for kind in self.options if kind.fits(node)), self)

    def merge(self, base: Node, over: Node) -> Node:
        kind = self.chosen(over)
        return kind.merge(base, over) if kind is not self and kind is self.chosen(base) else over


def merge_items(base: Node, over: Node, part: Callable[[str], Key | None]) -> Node:
    """Mapping `base` with the keys of `over`. A null value in `over` removes the key. part: declaration of each key."""
    if not isinstance(base.value, dict) or not isinstance(over.value, dict):
        return over
    items = dict(base.value)
    lines = dict(base.key_lines or {})
    for name, value in over.value.items():
        lines[name] = over.key_line(name)
        if value.value is None:
            items.pop(name, None)
            continue
        key = part(name)
        items[name] = key.kind.merge(items[name], value) if key is not None and name in items else value
    return Node(items, over.line if over.line is not None else base.line, lines, over.file or base.file)
