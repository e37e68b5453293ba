"""Blocks: mappings with declared keys. One declaration gives validation, JSON Schema and the documentation's table."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar, cast

from asrsim.document.composite import merge_items
from asrsim.document.kinds import Kind, Schema, attempt
from asrsim.document.node import Node
from asrsim.document.reading import DocumentReading, KeyPath, Rejected
from asrsim.errors import InputError, nearest

T = TypeVar("T")

REQUIRED: Any = object()
"""Default of a required key."""


@dataclass(frozen=True, kw_only=True)
class Key:
    """Declaration of a key in a mapping."""

    name: str
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

    @property
    def default_text(self) -> str:
        """Text of the default for tables."""
        if self.required:
            return "required"
        if self.shown:
            return self.shown
        value = self.default
        if value is None or value in ({}, ()):
            return ""
        if isinstance(value, bool):
            return "true" if value else "false"
        if isinstance(value, tuple):
            return f"[{', '.join(f'{item:g}' for item in value)}]"
        return f"{value:g}" if isinstance(value, float) else str(value)

    def schema(self) -> Schema:
        """JSON Schema of the value, with its description."""
        doc = self.doc + (f" Unit: {self.unit}." if self.unit else "")
        if self.default_text and not self.required:
            doc += f" Default: {self.default_text}."
        return {**self.kind.schema(), "description": doc.strip()}


def declare(
    kind: Kind[Any], *, doc: str, unit: str = "", default: Any = REQUIRED, key: str = "", shown: str = "", spread: bool = False,
    field_default: Any = None,
) -> Any:  # fmt: skip
    """Dataclass field that is also a key of a document.

    Args:
        kind: Kind of the value.
        doc: Description for tables and messages.
        unit: Unit of the value.
        default: Default in documents.
        key: Name in documents, if it differs; `base.position` is the key `position` in the mapping `base`.
        shown: Description of the default, as in `Key`.
        spread: The key sets several constructor arguments, as in `Key`.
        field_default: Default of the dataclass, if it differs; REQUIRED for none; a function makes the default.
    """
    metadata = {"key": Key(name=key, kind=kind, default=default, doc=doc, unit=unit, shown=shown, spread=spread)}
    value = default if field_default is None else field_default
    if value is REQUIRED:
        return dataclasses.field(metadata=metadata)
    if isinstance(value, dict) or callable(value):
        return dataclasses.field(default_factory=value.copy if isinstance(value, dict) else value, metadata=metadata)
    return dataclasses.field(default=value, metadata=metadata)


def key_at(kind: Kind[Any], path: Sequence[str], key: Key | None = None) -> Key | None:
    """Key that declares the value at a path inside a kind; None if no key declares it.

    For an entry of a list, or of a mapping with free names, the key of the list or mapping is returned. key: key of `kind`.
    """
    if not path:
        return key
    if isinstance(kind, Block):
        inner = next((each for each in kind.keys if each.name == path[0]), None)
        return inner and key_at(inner.kind, path[1:], inner)
    for place, part in kind.parts:
        rest = path[1:] if place else path
        found = None if place == "[]" and not path[0].isdecimal() else key_at(part, rest, key)
        if found is not None:
            return found
    return None


def declared_keys(cls: Any, groups: Sequence[Key] = ()) -> tuple[Key, ...]:
    """Keys that a dataclass declares by `declare`, in order.

    groups: Keys of the mappings that contain the keys with dotted names; their kinds are blocks without keys.
    """
    found: dict[str, Key] = {}
    named = {group.name: group for group in groups}
    for field in dataclasses.fields(cls):
        if "key" not in field.metadata:
            continue
        declared: Key = field.metadata["key"]
        head, dot, rest = (declared.name or field.name).partition(".")
        key = dataclasses.replace(declared, name=rest or head, attribute=field.name)
        if dot:
            group = found.get(head, named[head])
            block = cast("Block[Any]", group.kind)
            key = dataclasses.replace(group, kind=dataclasses.replace(block, keys=(*block.keys, key)))
        found[head] = key
    return tuple(found.values())


@dataclass(frozen=True, kw_only=True)
class Block(Kind[T], Generic[T]):
    """Kind of value: a mapping with declared keys, from which an object is built."""

    keys: Sequence[Key]
    build: Callable[..., T]
    """Constructor, called with a keyword argument for every key. Its InputErrors are reported at this block."""
    noun: str = "mapping"
    doc: str = ""
    may_be_empty: bool = True
    main: str = ""
    """Main key: a value that is no mapping sets this key (`robot: arm.urdf`); "": the block has no main key."""
    line_argument: str = ""
    """Argument of `build` that receives the line of the block; "": `build` needs no line."""
    partial: bool = False
    """True: the object is built without the faulty keys. False: a faulty key rejects the block."""
    read_before: tuple[str, ...] = ()
    """Further valid keys, which other code reads; messages list them too."""

    def read(self, node: Node, path: KeyPath, reading: DocumentReading) -> T:
        if node.value is None and self.may_be_empty and not any(key.required for key in self.keys):
            node = Node({}, node.line, None, node.file)
        node = self.opened(node)
        if not isinstance(node.value, dict):
            raise reading.fault(node, path, f"must be a mapping ({', '.join(self.names)})", code="type")
        good = self._unknown(node, path, reading)
        arguments: dict[str, Any] = {}
        for key in self.keys:
            item = node.value.get(key.name)
            if item is None or (item.value is None and not key.required):
                if key.required:
                    reading.fault(
                        node, path, f"the key '{key.name}' is missing", hint=key.doc or None, code="missing-key", show=False
                    )
                    reading.unread.append((*path, key.name))
                    good = False
                elif not key.spread:
                    arguments[key.argument] = key.default
                continue
            found = attempt(key.kind, item, (*path, key.name), reading)
            if found is not None:
                arguments.update(found[0] if key.spread else {key.argument: found[0]})
                continue
            good = False
            if not (key.required or key.spread):
                arguments[key.argument] = key.default
        if not (good or self.partial):
            raise Rejected
        if self.line_argument:
            arguments[self.line_argument] = node.line
        return self._built(arguments, node, path, reading)

    def opened(self, node: Node) -> Node:
        """Node as a mapping; a value that is not a mapping becomes that of the main key."""
        if not self.main or isinstance(node.value, dict):
            return node
        return Node({self.main: node}, node.line, {self.main: node.line}, node.file)

    def _unknown(self, node: Node, path: KeyPath, reading: DocumentReading) -> bool:
        good = True
        for name, item in node.value.items() if isinstance(node.value, dict) else ():
            if name not in self.names:
                known = (*self.names, *self.read_before)
                reading.fault(
                    item,
                    (*path, name),
                    "unknown key",
                    line=node.key_line(name),
                    choices=known,
                    meant=name,
                    code="unknown-key",
                    show=False,
                )
                reading.unread.append((*path, nearest(name, known) or name))
                good = False
        return good

    def _built(self, arguments: dict[str, Any], node: Node, path: KeyPath, reading: DocumentReading) -> T:
        try:
            return self.build(**arguments)
        except InputError as error:
            items = node.value if isinstance(node.value, dict) else {}
            for problem in error.problems:
                place = next((key.name for key in self.keys if problem.key in (key.argument, key.name)), None)
                item = items.get(place or "", node)
                inner = problem.file is not None
                text = str(dataclasses.replace(problem, key=problem.key if inner else None, choices=(), hint=None, value=None))
                reading.problems.append(
                    dataclasses.replace(
                        problem,
                        message=text,
                        file=item.file,
                        line=item.line,
                        key=".".join((*path, place) if place else path) or None,
                    )
                )
            raise Rejected from None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the block's keys."""
        return tuple(key.name for key in self.keys)

    def schema(self) -> Schema:
        required = [key.name for key in self.keys if key.required]
        schema: Schema = {
            "type": "object" if required or not self.may_be_empty else ["object", "null"],
            "properties": {key.name: key.schema() for key in self.keys},
            "additionalProperties": False,
        }
        if required:
            schema["required"] = required
        if self.main:
            main = next(key for key in self.keys if key.name == self.main)
            schema = {"anyOf": [main.kind.schema(), schema]}
        if self.doc:
            schema["description"] = self.doc
        return schema

    @property
    def text(self) -> str:
        main = "".join(f"{key.kind.text}, or " for key in self.keys if key.name == self.main)
        return main + self.noun

    @property
    def parts(self) -> tuple[tuple[str, Kind[Any]], ...]:
        return tuple((f".{key.name}", key.kind) for key in self.keys)

    def merge(self, base: Node, over: Node) -> Node:
        kinds = {key.name: key.kind for key in self.keys}
        return merge_items(self.opened(base), self.opened(over), kinds.get)


def block_of(cls: Callable[..., T], noun: str, *, main: str = "", line_argument: str = "") -> Block[T]:
    """Block with the keys that a dataclass declares."""
    return Block(keys=declared_keys(cls), build=cls, noun=noun, main=main, line_argument=line_argument)
