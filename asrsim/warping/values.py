"""Values in translated code: their types, and the text of their expressions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite, isnan
from typing import Any

from asrsim.errors import SimulationError
from asrsim.records import columns, own_fields


class TranslationError(SimulationError):
    """Code that has no translation to Warp."""


@dataclass(frozen=True)
class NumberType:
    """Type of a number: `float`, `int` or `bool`, as Warp names it."""

    name: str

    @property
    def annotation(self) -> str:
        """Annotation of an argument of this type."""
        return self.name


FLOAT, INT, BOOL = NumberType("float"), NumberType("int"), NumberType("bool")
ORDER = {BOOL: 0, INT: 1, FLOAT: 2}
"""Types in order: a name that is assigned values of several types has the last of these types."""


@dataclass(frozen=True)
class Row:
    """Type of a row of numbers in a table: an array, and the index in it at which the row begins. size: number of the row's
    numbers, if it is known; record: class of the record whose numbers the row has (`asrsim.records`)."""

    number: NumberType
    size: int | None = None
    record: Any = None

    @property
    def annotation(self) -> str:
        """Annotation of the array."""
        return f"wp.array(dtype={self.number.name})"


@dataclass(frozen=True)
class Group:
    """Type of a tuple of values."""

    kinds: tuple[Any, ...]


@dataclass(frozen=True)
class Value:
    """A value in translated code. text: its expression; for a row, the name of its array; `at`: expression of the index at
    which the row begins; items: members of a tuple; known: a constant or function that is known without running the code."""

    kind: Any
    text: str = ""
    at: str = "0"
    items: tuple[Value, ...] = ()
    known: Any = None

    def part(self, index: str) -> Value:
        """Number of the row at an index."""
        return Value(self.kind.number, f"{self.text}[{summed(self.at, index)}]")

    def from_place(self, index: str, record: Any = None) -> Value:
        """The row that begins within this row, or the record there."""
        return Value(Row(self.kind.number, record=record), self.text, summed(self.at, index))

    def field(self, name: str) -> Value:
        """Number, or record, of this name in a record. Raises TranslationError."""
        for one in own_fields(self.kind.record):
            if one.name == name:
                inner = one.metadata.get("record")
                if inner is None:
                    return self.part(str(columns(self.kind.record)[name]))
                first = next(iter(columns(inner)))
                return self.from_place(str(columns(self.kind.record)[f"{name}.{first}"]), inner)
        raise TranslationError(f"a record has no number '{name}'")

    @property
    def arguments(self) -> list[str]:
        """Expressions by which the value is passed to a function."""
        if isinstance(self.kind, Row):
            return [self.text, self.at]
        if isinstance(self.kind, Group):
            return [text for item in self.items for text in item.arguments]
        return [self.text]


def summed(first: str, second: str) -> str:
    """Sum of two expressions of indices in an array."""
    return second if first == "0" else first if second == "0" else f"{first} + {second}"


def constant(value: Any) -> Value:
    """A constant: number or tuple of constants."""
    if isinstance(value, tuple):
        return group([constant(one) for one in value])
    if isinstance(value, bool):
        return Value(BOOL, str(value), known=value)
    if isinstance(value, int):
        return Value(INT, f"({value})" if value < 0 else str(value), known=value)
    if isinstance(value, float):
        return Value(FLOAT, _float(value), known=value)
    raise TranslationError(f"the constant {value!r} is not a number")


LARGEST = 3.4e38
"""Largest number of single precision."""


def _float(value: float) -> str:
    if isnan(value):
        return "wp.nan"
    if not isfinite(value) or abs(value) > LARGEST:
        return "wp.inf" if value > 0.0 else "(-wp.inf)"
    return f"({value!r})" if value < 0.0 else repr(value)


def group(items: Sequence[Value]) -> Value:
    """A tuple of values."""
    return Value(Group(tuple(item.kind for item in items)), items=tuple(items))


def joined(first: Any, second: Any) -> Any:
    """Common type for a variable that is assigned values of two types. Raises TranslationError."""
    if first is None or first == second:
        return second
    if isinstance(first, Group) and isinstance(second, Group) and len(first.kinds) == len(second.kinds):
        return Group(tuple(map(joined, first.kinds, second.kinds)))
    if first in ORDER and second in ORDER:
        return max(first, second, key=ORDER.__getitem__)
    if isinstance(first, Row) and isinstance(second, Row) and first.number == second.number:
        return Row(first.number)
    raise TranslationError("a variable is assigned values of different types")


def number_as(value: Value, kind: Any) -> Value:
    """The value converted to a number, or to a tuple of numbers, of this type. Raises TranslationError."""
    if isinstance(kind, Group) and isinstance(value.kind, Group) and len(kind.kinds) == len(value.items):
        return group([number_as(item, own) for item, own in zip(value.items, kind.kinds, strict=True)])
    if value.kind == kind:
        return value
    if value.kind not in ORDER or kind not in ORDER:
        raise TranslationError("a number is expected")
    if kind == BOOL:
        return Value(BOOL, f"({value.text} != {'0.0' if value.kind == FLOAT else '0'})")
    if isinstance(value.known, int | float):
        return constant(float(value.known) if kind == FLOAT else int(value.known))
    if value.kind == BOOL:
        one, zero = ("1.0", "0.0") if kind == FLOAT else ("1", "0")
        return Value(kind, f"wp.where({value.text}, {one}, {zero})")
    return Value(kind, f"{kind.name}({value.text})")
