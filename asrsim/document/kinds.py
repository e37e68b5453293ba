"""Kinds of values in documents. Each kind reads a node, and has a description and a JSON Schema."""

from __future__ import annotations

import operator
import re
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Generic, TypeVar, cast

from asrsim.document.node import Node
from asrsim.document.reading import DocumentReading, KeyPath, Rejected
from asrsim.errors import counted, did_you_mean
from asrsim.registry import Registry

T = TypeVar("T")
T_co = TypeVar("T_co", covariant=True)
Schema = dict[str, Any]


class Kind(ABC, Generic[T_co]):
    """Kind of a value in a document."""

    @abstractmethod
    def read(self, node: Node, path: KeyPath, reading: DocumentReading) -> T_co:
        """Value of the node. Records the problems of an invalid node in `reading`, then raises Rejected.

        A mapping may be returned without its invalid entries: a document is valid only if `reading` has no problems.
        """

    @abstractmethod
    def schema(self) -> Schema:
        """JSON Schema of the allowed values."""

    @property
    @abstractmethod
    def text(self) -> str:
        """Short description for messages and for tables in the documentation."""

    def wrong(self, node: Node, path: KeyPath, reading: DocumentReading, addition: str = "") -> Rejected:
        """Exception for a value that is not of this kind; its problem has been recorded. addition: text at the end of the
        message."""
        article = "" if self.text.startswith(("text", "true", "`")) else "a "
        return reading.fault(node, path, f"must be {article}{self.text}{addition}", code="type")

    def part(self, name: str) -> Key | None:
        """Declaration of the entry with this name in a mapping, or with this index in a list; None if there can be no such
        entry."""
        return None

    def chosen(self, node: Node) -> Kind[Any]:
        """Kind that reads this node: the alternative that fits the node, or this kind itself if it has no alternatives."""
        return self

    def is_whole(self, node: Node) -> bool:
        """Whether a mapping is itself a value of this kind, so that it cannot be a mapping from names to such values."""
        return False

    def opened(self, node: Node) -> Node:
        """The node as a mapping if its value is the short form of a mapping; else the node itself."""
        return node

    def fits(self, node: Node) -> bool:
        """Whether the type of the YAML value (scalar, list or mapping) is a type that this kind reads."""
        return not isinstance(node.value, dict | list)

    def merge(self, base: Node, over: Node) -> Node:
        """Value of a variant: `over`, or for two mappings `base` with the keys of `over`. Null in `over` removes a key."""
        if not isinstance(base.value, dict) or not isinstance(over.value, dict):
            return over
        items = dict(base.value)
        lines = dict(base.key_lines or {})
        for name, value in over.value.items():
            lines[name] = over.key_line(name)
            if value.value is None:
                items.pop(name, None)
                continue
            key = self.part(name)
            items[name] = key.kind.merge(items[name], value) if key is not None and name in items else value
        return Node(items, over.line if over.line is not None else base.line, lines, over.file or base.file)


REQUIRED: Any = object()
"""Default of a required key."""


@dataclass(frozen=True, kw_only=True)
class Key:
    """Declaration of a key in a mapping, or of the entries of a list or of a mapping with free names."""

    name: str
    """Name of the key; "" in the declaration of an entry of a list or of a mapping with free names."""
    kind: Kind[Any]
    default: Any = REQUIRED
    doc: str = ""
    unit: str = ""
    attribute: str = ""
    """Name of the constructor's argument that gets the value; "": the name of the key."""
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
        elif isinstance(self.default, int | float | str):
            schema = {**schema, "default": self.default}
        return {**schema, "description": self.doc + (f". Unit: {self.unit}." if self.unit else "")}


def key_at(kind: Kind[Any], path: Sequence[str]) -> Key | None:
    """Key that declares the value at a path inside a kind; None if no key declares it.

    An entry of a list, or of a mapping with free names, has the key of the list or mapping.
    """
    declared = None
    for name in path:
        key = kind.part(name)
        if key is None:
            return None
        kind, declared = key.kind, key if key.name else declared
    return declared


def walk(kind: Kind[Any], node: Node, path: KeyPath = ()) -> Iterator[tuple[KeyPath, Kind[Any], Node]]:
    """Tuples (path, kind, node) of a node and of all nodes inside it whose kind is declared."""
    kind = kind.chosen(node)
    node = kind.opened(node)
    yield path, kind, node
    for name, item in node.items() if kind.fits(node) else ():
        key = kind.part(name)
        if key is not None:
            yield from walk(key.kind, item, (*path, name))


_LIMITS: dict[str, tuple[str, Callable[[float, float], bool]]] = {
    "minimum": (">=", operator.ge),
    "exclusiveMinimum": (">", operator.gt),
    "maximum": ("<=", operator.le),
}
"""Sign and comparison of each limit of numbers, by the limit's name in JSON Schema."""


def unit_hint(value: object) -> str | None:
    """Advice for a text that is a number with a unit; None for other values."""
    number = r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?"
    stated = isinstance(value, str) and re.fullmatch(rf"{number}\s*[^\W\d]\S*|{number}\s*[°%]\S*", value.strip())
    return "Write the number alone, in SI units (s, m, rad, N, N m)" if stated else None


@dataclass(frozen=True, kw_only=True)
class Number(Kind[float]):
    """Kind of value: a finite real number."""

    minimum: float | None = None
    above: float | None = None
    """Lower limit that the number must exceed; None: no such limit."""
    maximum: float | None = None
    noun: ClassVar[str] = "number"
    json_type: ClassVar[str] = "number"

    def fits(self, node: Node) -> bool:
        return isinstance(node.value, int | float)

    def read(self, node: Node, path: KeyPath, reading: DocumentReading) -> float:
        value = node.value
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise reading.fault(node, path, f"must be a {self.text}", hint=unit_hint(value), code="type")
        if not abs(value) <= sys.float_info.max:  # infinities, NaN, and integers beyond the range of floats
            raise reading.fault(node, path, "must be a finite number", code="range")
        if not all(_LIMITS[name][1](value, limit) for name, limit in self._limits.items()):
            raise self.wrong(node, path, reading)
        return float(value)

    def schema(self) -> Schema:
        return {"type": self.json_type, **self._limits}

    @property
    def text(self) -> str:
        bounds = [f"{_LIMITS[name][0]} {limit:g}" for name, limit in self._limits.items()]
        return " ".join([self.noun, " and ".join(bounds)]).strip()

    @property
    def _limits(self) -> dict[str, float]:
        limits = {"minimum": self.minimum, "exclusiveMinimum": self.above, "maximum": self.maximum}
        return {name: limit for name, limit in limits.items() if limit is not None}


NUMBER = Number()
POSITIVE = Number(above=0.0)
NOT_NEGATIVE = Number(minimum=0.0)
SHARE = Number(minimum=0.0, maximum=1.0)


class Integer(Number):
    """Kind of value: a whole number."""

    noun = "whole number"
    json_type = "integer"

    def read(self, node: Node, path: KeyPath, reading: DocumentReading) -> int:
        if not super().read(node, path, reading).is_integer():
            raise self.wrong(node, path, reading)
        return int(cast("float", node.value))


@dataclass(frozen=True)
class Boolean(Kind[bool]):
    """Kind of value: `true` or `false`."""

    text = "true or false"

    def read(self, node: Node, path: KeyPath, reading: DocumentReading) -> bool:
        if not isinstance(node.value, bool):
            raise self.wrong(node, path, reading)
        return node.value

    def schema(self) -> Schema:
        return {"type": "boolean"}


@dataclass(frozen=True, kw_only=True)
class Text(Kind[str]):
    """Kind of value: non-empty text."""

    text: str = "text"

    def read(self, node: Node, path: KeyPath, reading: DocumentReading) -> str:
        if isinstance(node.value, int | float):  # for example, 1 or true is the name of a joint
            return str(node.value).lower()
        if not isinstance(node.value, str) or not node.value.strip():
            raise self.wrong(node, path, reading)
        return node.value

    def schema(self) -> Schema:
        return {"type": ["string", "number", "boolean"]}


@dataclass(frozen=True, kw_only=True)
class Name(Text):
    """Kind of value: name of a thing outside of the document, such as a joint."""

    noun: str

    def read(self, node: Node, path: KeyPath, reading: DocumentReading) -> str:
        name = super().read(node, path, reading)
        reading.named.append((path, name, self.noun))
        return name


@dataclass(frozen=True)
class Choice(Kind[str]):
    """Kind of value: one of several words. The words may be given by a function, which imports a registry only when needed."""

    options: tuple[str, ...] | Callable[[], Iterable[str]]
    noun: str = ""
    """Noun for all words together, for tables; "": tables list the words."""
    missing: str = ""
    """Hint in the message about an unknown word."""

    def fits(self, node: Node) -> bool:
        return isinstance(node.value, str)

    @property
    def words(self) -> tuple[str, ...]:
        """Valid words."""
        return tuple(self.options() if callable(self.options) else self.options)

    def read(self, node: Node, path: KeyPath, reading: DocumentReading) -> str:
        value, words = str(node.value), self.words
        if value not in words:
            hint = did_you_mean(value, words) or self.missing or None
            raise reading.fault(node, path, "is not one of the choices", choices=words, hint=hint, code="choice")
        return value

    def schema(self) -> Schema:
        return {"enum": list(self.words)}

    @property
    def text(self) -> str:
        return self.noun or " or ".join(f"`{word}`" for word in self.words)


@dataclass(frozen=True)
class Entry(Kind[str]):
    """Kind of value: the name of an entry of a registry. The registry is searched only when the names are needed."""

    registry: Registry[Any]
    noun: str = ""
    """Noun for all names together, for tables; "": tables list the names."""

    def fits(self, node: Node) -> bool:
        return isinstance(node.value, str)

    def read(self, node: Node, path: KeyPath, reading: DocumentReading) -> str:
        value = str(node.value)
        if value not in self.registry:
            found = self.registry.unknown(value)
            raise reading.fault(node, path, found.message, choices=found.choices, hint=found.hint, code=found.code, show=False)
        return value

    def schema(self) -> Schema:
        return {"enum": list(self.registry.names())}

    @property
    def text(self) -> str:
        return self.noun or " or ".join(f"`{name}`" for name in self.registry.names())


@dataclass(frozen=True, kw_only=True)
class File(Kind[Path]):
    """Kind of value: path of a file, relative to the document's folder. The file becomes an attachment of the document."""

    noun: str = "file"
    attach: bool = True
    folder: bool = False
    """True: a folder is valid too."""
    exists: bool = True
    """True: the file must exist when the document is read."""
    beside: str = ""
    """Ending of a document beside the file that describes it, such as `.yaml` for `lab.csv.yaml`. If it exists, it is attached
    too."""

    def read(self, node: Node, path: KeyPath, reading: DocumentReading) -> Path:
        if not isinstance(node.value, str) or not node.value.strip() or "\0" in node.value:
            raise self.wrong(node, path, reading)
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
class Null(Kind[None]):
    """Kind of value: null, or a word that stands for null, such as none. In an `Either` it must be the first kind."""

    word: str | None = None

    def fits(self, node: Node) -> bool:
        return node.value in (None, self.word)

    def read(self, node: Node, path: KeyPath, reading: DocumentReading) -> None:
        return None

    def schema(self) -> Schema:
        return {"enum": [None, self.word] if self.word else [None]}

    @property
    def text(self) -> str:
        return f"`{self.word}`" if self.word else "null"


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
    names: tuple[str, ...] = ()
    """Names of the entries of a list with fixed length; empty for a list of any length."""

    def read(self, node: Node, path: KeyPath, reading: DocumentReading) -> tuple[T, ...]:
        if not isinstance(node.value, list):
            raise self.wrong(node, path, reading)
        count = len(node.value)
        if count < self.minimum or (self.names and count != len(self.names)):
            least = f" of at least {counted(self.minimum, 'value')}" if count < self.minimum else ""
            raise self.wrong(node, path, reading, f"{least}, but has {'1 entry' if count == 1 else f'{count} entries'}")
        results = [attempt(self.of, item, (*path, str(index)), reading) for index, item in enumerate(node.value)]
        read = tuple(result[0] for result in results if result is not None)
        if len(read) < len(results):
            raise Rejected
        return read

    def schema(self) -> Schema:
        schema: Schema = {"type": "array", "items": self.of.schema(), "minItems": len(self.names) or self.minimum}
        return {**schema, "maxItems": len(self.names)} if self.names else schema

    @property
    def text(self) -> str:
        return f"list [{', '.join(self.names or (self.of.text, '...'))}]"

    def fits(self, node: Node) -> bool:
        return isinstance(node.value, list)

    def part(self, name: str) -> Key | None:
        return Key(name="", kind=self.of) if name.isdecimal() else None


@dataclass(frozen=True, kw_only=True)
class MapOf(Kind[dict[str, T]], Generic[T]):
    """Kind of value: a mapping from free names (mostly of joints) to values of one kind. Invalid entries are left out."""

    of: Kind[T]
    noun: str = "joint"
    """Noun for the things that have these names, for messages."""
    star: bool = True
    """True: the name `*` may stand for all names."""
    bare: bool = False
    """True: a value in place of the mapping from names applies to all names."""

    def read(self, node: Node, path: KeyPath, reading: DocumentReading) -> dict[str, T]:
        if node.value is None:
            return {}
        if self._is_bare(node):
            reading.named.append(((*path, "*"), "*", self.noun))
            return {"*": self.of.read(node, path, reading)}
        if not isinstance(node.value, dict):
            raise self.wrong(node, path, reading)
        reading.named += [((*path, name), name, self.noun) for name in node.value]
        results = {name: attempt(self.of, item, (*path, name), reading) for name, item in node.value.items()}
        if not self.star and "*" in results:
            raise reading.fault(node.value["*"], (*path, "*"), f"'*' cannot stand for a {self.noun} here", show=False)
        return {name: result[0] for name, result in results.items() if result is not None}

    def schema(self) -> Schema:
        schema: Schema = {"type": ["object", "null"], "additionalProperties": self.of.schema()}
        return {"anyOf": [self.of.schema(), schema]} if self.bare else schema

    @property
    def text(self) -> str:
        if self.bare:
            return f"{self.of.text}, or mapping from {self.noun} to such values"
        return f"mapping from {self.noun} to {self.of.text}"

    def fits(self, node: Node) -> bool:
        return isinstance(node.value, dict)

    def part(self, name: str) -> Key | None:
        return Key(name="", kind=self.of)

    def opened(self, node: Node) -> Node:
        return Node({"*": node}, node.line, None, node.file) if self._is_bare(node) else node

    def merge(self, base: Node, over: Node) -> Node:
        for_all = [isinstance(node.value, dict) and self._is_bare(node) for node in (base, over)]
        if all(for_all):
            return self.of.merge(base, over)
        # A value for all names and a mapping from names replace each other instead of being merged.
        return over if any(for_all) else super().merge(base, over)

    def _is_bare(self, node: Node) -> bool:
        """Whether the node is one value for all names, rather than a mapping from names to values."""
        return self.bare and (self.of.is_whole(node) if isinstance(node.value, dict) else self.of.fits(node))


@dataclass(frozen=True)
class Either(Kind[Any]):
    """Kind of value: one of several kinds, chosen by the type of the YAML value."""

    options: tuple[Kind[Any], ...]
    """Alternatives; the first kind that fits a node reads the node."""

    def read(self, node: Node, path: KeyPath, reading: DocumentReading) -> Any:
        for kind in self.options:
            if kind.fits(node):
                before = len(reading.problems)
                try:
                    return kind.read(node, path, reading)
                except Rejected:
                    self._add_word(path, reading, before)
                    raise
        raise self.wrong(node, path, reading)

    def _add_word(self, path: KeyPath, reading: DocumentReading, before: int) -> None:
        """Add the word that stands for null to the problems of the value at `path`, from problem number `before` on. The kind
        that rejected the value does not know this word.
        """
        word = next((kind.word for kind in self.options if isinstance(kind, Null)), None)
        for number, problem in enumerate(reading.problems[before:], before):
            if word is None or problem.key != ".".join(path):
                continue
            added = {"choices": (word, *problem.choices)} if problem.choices else {"hint": problem.hint or f"Or write `{word}`"}
            reading.problems[number] = replace(problem, **added)

    def schema(self) -> Schema:
        return {"anyOf": [kind.schema() for kind in self.options]}

    @property
    def text(self) -> str:
        return ", or ".join(kind.text for kind in self.options)

    def fits(self, node: Node) -> bool:
        return any(kind.fits(node) for kind in self.options)

    def part(self, name: str) -> Key | None:
        return next((key for kind in self.options if (key := kind.part(name)) is not None), None)

    def chosen(self, node: Node) -> Kind[Any]:
        return next((kind.chosen(node) for kind in self.options if kind.fits(node)), self)
