"""Blocks: mappings with declared keys. One declaration gives validation, JSON Schema and the documentation's table."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar, cast

from asrsim.document.kinds import REQUIRED, Key, Kind, Schema, attempt
from asrsim.document.node import Node
from asrsim.document.reading import DocumentReading, KeyPath, Rejected
from asrsim.errors import InputError, nearest
from asrsim.renamed import OLD_KEYS

T = TypeVar("T")


def declare(
    kind: Kind[Any],
    *,
    doc: str,
    unit: str = "",
    default: Any = REQUIRED,
    key: str = "",
    shown: str = "",
    spread: bool = False,
    field_default: Any = None,
) -> Any:
    """Dataclass field that is also a key of a document.

    Args:
        kind: Kind of the value.
        doc: Description for tables and messages.
        unit: Unit of the value.
        default: Default in documents.
        key: Name in documents, if it differs; `base.position` is the key `position` in the mapping `base`.
        shown: Description of the default in tables, as in `Key`.
        spread: Whether the key sets several constructor arguments, as in `Key`.
        field_default: Default of the dataclass field, if it differs; REQUIRED: no default; a function: its result is the
            default.
    """
    if not isinstance(kind, Kind):
        raise TypeError(f"declare(...) takes a kind of asrsim.document.kinds, such as Number(), not {kind!r}")
    metadata = {"key": Key(name=key, kind=kind, default=default, doc=doc, unit=unit, shown=shown, spread=spread)}
    value = default if field_default is None else field_default
    if value is REQUIRED:
        return dataclasses.field(metadata=metadata)
    if isinstance(value, dict) or callable(value):
        return dataclasses.field(default_factory=value.copy if isinstance(value, dict) else value, metadata=metadata)
    return dataclasses.field(default=value, metadata=metadata)


def declared_keys(cls: Any, groups: Sequence[Key] = ()) -> tuple[Key, ...]:
    """Keys that a dataclass declares by `declare`, in order.

    groups: Keys whose values are mappings that contain the keys with dotted names; their kinds are blocks without keys. A group
        that contains a required key is required.
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
            default = REQUIRED if key.required else group.default
            key = dataclasses.replace(group, kind=dataclasses.replace(block, keys=(*block.keys, key)), default=default)
        found[head] = key
    return tuple(found.values())


@dataclass(frozen=True, kw_only=True)
class Block(Kind[T], Generic[T]):
    """Kind of value: a mapping with declared keys, from which an object is built."""

    keys: Sequence[Key]
    build: Callable[..., T]
    """Constructor, called with one keyword argument per key. If it raises InputError, the problems are reported at this
    block."""
    noun: str = "mapping"
    doc: str = ""
    main: str = ""
    """Main key, which is set by a value that is not a mapping (`robot: arm.urdf`); "": the block has no main key."""
    read_before: tuple[str, ...] = ()
    """Further valid keys, which other code reads; messages about unknown keys list them too."""

    def read(self, node: Node, path: KeyPath, reading: DocumentReading) -> T:
        if node.value is None and not any(key.required for key in self.keys):
            node = Node({}, node.line, None, node.file)
        node = self.opened(node)
        if not isinstance(node.value, dict):
            raise reading.fault(node, path, f"must be a mapping ({', '.join(self.names)})", code="type")
        arguments: dict[str, Any] = {}
        before = len(reading.problems)
        known = (*self.names, *self.read_before)
        for name, item in node.value.items():
            if name not in self.names:
                new = OLD_KEYS.get(name)
                hint = f"It is now called '{new}', which is given, too: delete the old key" if new in node.value else None
                reading.fault(
                    item,
                    (*path, name),
                    "unknown key",
                    line=node.key_line(name),
                    choices=known,
                    hint=hint,
                    meant=name,
                    code="unknown-key",
                    show=False,
                )
                reading.unread.append((*path, nearest(name, known) or name))
        for key in self.keys:
            if not (key.required or key.spread):
                arguments[key.argument] = key.default
            given = node.value.get(key.name)
            if given is None and key.required:
                message = f"the key '{key.name}' is missing"
                reading.fault(node, path, message, hint=key.doc[:1].upper() + key.doc[1:], code="missing-key", show=False)
                reading.unread.append((*path, key.name))
            elif given is not None and (given.value is not None or key.required):
                found = attempt(key.kind, given, (*path, key.name), reading)
                if found is not None:
                    arguments.update(found[0] if key.spread else {key.argument: found[0]})
        # A block that becomes a plain mapping keeps its valid keys. An object cannot be built if one of its keys is invalid.
        if len(reading.problems) > before and self.build is not dict:
            raise Rejected
        return self._built(arguments, node, path, reading)

    def opened(self, node: Node) -> Node:
        if not self.main or isinstance(node.value, dict):
            return node
        return Node({self.main: node}, node.line, {self.main: node.line}, node.file)

    def _built(self, arguments: dict[str, Any], node: Node, path: KeyPath, reading: DocumentReading) -> T:
        try:
            return self.build(**arguments)
        except InputError as error:
            for problem in error.problems:
                head, *inner = (problem.key or "").split(".")
                own = [key.name for key in self.keys if head in (key.argument, key.name)][:1]
                # A problem in another file names a key of that file, so keep its key.
                elsewhere = problem.file is not None
                item, place = node, path
                for name in own if elsewhere or not own else (*own, *inner):
                    item, place = dict(item.items()).get(name, item), (*place, name)
                inner_key = problem.key if elsewhere else None
                message = str(dataclasses.replace(problem, key=inner_key, choices=(), hint=None, value=None))
                if item is node and (overridden := [*node.overridden()]):
                    # The values of a block contradict each other, and overrides have set some of them. The fault is in no line
                    # of the file.
                    (names, item), several = overridden[0], len(overridden) > 1
                    place = path if several else (*path, *names)
                    hint = f"Overrides set {', '.join('.'.join(one) for one, _ in overridden)}" if several else None
                    problem = dataclasses.replace(problem, value=None, hint=hint)
                key = ".".join(place) or None
                reading.problems.append(dataclasses.replace(problem, message=message, file=item.file, line=item.line, key=key))
            raise Rejected from None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the block's keys."""
        return tuple(key.name for key in self.keys)

    def schema(self) -> Schema:
        required = [key.name for key in self.keys if key.required]
        schema: Schema = {
            "type": "object" if required else ["object", "null"],
            "properties": {key.name: key.schema() for key in self.keys},
            "required": required,
            "additionalProperties": False,
        }
        if (main := self.part(self.main)) is not None:
            schema = {"anyOf": [main.kind.schema(), schema]}
        return {**schema, "description": self.doc} if self.doc else schema

    @property
    def text(self) -> str:
        main = self.part(self.main)
        return self.noun if main is None else f"{main.kind.text}, or {self.noun}"

    def fits(self, node: Node) -> bool:
        main = self.part(self.main)
        return isinstance(node.value, dict) or (main is not None and main.kind.fits(node))

    def is_whole(self, node: Node) -> bool:
        required = [key.name for key in self.keys if key.required]
        given = node.value if isinstance(node.value, dict) else {}
        return bool(required) and set(required) <= given.keys() <= set(self.names)

    def part(self, name: str) -> Key | None:
        return next((key for key in self.keys if key.name == name), None)

    def merge(self, base: Node, over: Node) -> Node:
        return super().merge(self.opened(base), self.opened(over))


def block_of(cls: Callable[..., T], noun: str, *, main: str = "") -> Block[T]:
    """Block with the keys that a dataclass declares."""
    return Block(keys=declared_keys(cls), build=cls, noun=noun, main=main)
