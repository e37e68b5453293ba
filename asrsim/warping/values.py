"""Values in code that is translated to Warp: their types, and the text of their expressions in Warp."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite, isnan
from typing import Any

from asrsim.errors import SimulationError
from asrsim.records import columns, own_fields


class TranslationError(SimulationError):
    """Raised for Python code that cannot be translated to Warp."""


@dataclass(frozen=True)
class NumberType:
    """Type of a number: `float`, `int` or `bool`, as Warp names it."""

    name: str

    @property
    def annotation(self) -> str:
        """Annotation in Warp of an argument of this type."""
        return self.name


FLOAT, INT, BOOL = NumberType("float"), NumberType("int"), NumberType("bool")
ORDER = {BOOL: 0, INT: 1, FLOAT: 2}
"""Rank of each type: a variable that is assigned numbers of several types has the type with the highest rank."""


@dataclass(frozen=True)
class Row:
    """Type of a row of numbers in a table. In Warp, a row is an array and the index at which the row begins in this array.
    size: number of numbers in the row, if it is known; record: class of the record whose numbers the row contains
    (`asrsim.records`)."""

    number: NumberType
    size: int | None = None
    record: Any = None

    @property
    def annotation(self) -> str:
        """Annotation in Warp of an argument for the array in which the row lies."""
        return f"wp.array(dtype={self.number.name})"


@dataclass(frozen=True)
class Group:
    """Type of a tuple of values."""

    kinds: tuple[Any, ...]


@dataclass(frozen=True)
class Value:
    """A value in translated code. kind: type of the value; text: expression of the value in Warp, or for a row the name of the
    array; at: expression of the index at which a row begins; items: values in a tuple; known: a constant or function whose
    value is known without running the code."""

    kind: Any
    text: str = ""
    at: str = "0"
    items: tuple[Value, ...] = ()
    known: Any = None

    def part(self, index: str) -> Value:
        """The number at an index of this row."""
        return Value(self.kind.number, f"{self.text}[{summed(self.at, index)}]")

    def from_place(self, index: str, record: Any = None) -> Value:
        """The row that begins at an index of this row; record: class of the record, if a record begins there."""
        return Value(Row(self.kind.number, record=record), self.text, summed(self.at, index))

    def field(self, name: str) -> Value:
        """The number or inner record with this name in this record. Raises TranslationError for an unknown name."""
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
        """Expressions with which this value is passed to a function: two for a row, one for each number of a tuple."""
        if isinstance(self.kind, Row):
            return [self.text, self.at]
        if isinstance(self.kind, Group):
            return [text for item in self.items for text in item.arguments]
        return [self.text]


def summed(first: str, second: str) -> str:
    """Expression for the sum of two indices, which are given as expressions."""
    return second if first == "0" else first if second == "0" else f"{first} + {second}"


def constant(value: Any) -> Value:
    """Value of a constant, which is a number or a tuple of constants. Raises TranslationError for other constants."""
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
"""Number above which a constant counts as infinite, since it exceeds the range of single precision."""


def _float(value: float) -> str:
    if isnan(value):
        return "wp.nan"
    if not isfinite(value) or abs(value) > LARGEST:
        return "wp.inf" if value > 0.0 else "(-wp.inf)"
    return f"({value!r})" if value < 0.0 else repr(value)


def group(items: Sequence[Value]) -> Value:
    """Value of a tuple with these values."""
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
    """Value converted to this type, which is the type of a number or of a tuple of numbers. Raises TranslationError."""
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
