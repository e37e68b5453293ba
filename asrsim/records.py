"""Records: dataclasses of numbers that state, constants and laws share. Each number is declared once with its unit and meaning.

In plain Python a record is an object. In compiled code it is an address in a row of numbers, in which the numbers of nested
records follow in order: `asrsim.simulation.native` gives the same names to the columns of the row.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import Field, field, fields
from functools import cache
from operator import attrgetter
from typing import Any, TypeVar

R = TypeVar("R")


def value(doc: str, unit: str, *, start: float = 0.0, log: str = "", watched: bool = False) -> Any:
    """A number of the state. start: value at the start of a run; log: name in logs of the quantity that this number is, with {}
    for the number of the motor; watched: whether the number is computed only for worlds that are watched.
    """
    return field(default=start, metadata={"doc": doc, "unit": unit, "log": log, "watched": watched})


def constant(doc: str, unit: str, *, integer: bool = False) -> Any:
    """A number without a default that is constant during a run."""
    return field(metadata={"doc": doc, "unit": unit, "integer": integer})


def record(kind: Any, doc: str, *, log: bool = False) -> Any:
    """A record inside another record. log: whether the numbers of the inner record are logged."""
    return field(default_factory=kind, metadata={"doc": doc, "record": kind, "log": log})


def several(doc: str) -> Any:
    """Records or numbers whose count depends on the robot. In a row of numbers, they follow the record that contains them."""
    return field(default_factory=list, metadata={"doc": doc, "several": True})


@cache
def own_fields(kind: Any) -> tuple[Field[Any], ...]:
    """Fields of a record, except the fields whose count of values depends on the robot."""
    return tuple(one for one in fields(kind) if not one.metadata.get("several"))


@cache
def declared(kind: Any) -> Mapping[str, Mapping[str, Any]]:
    """Declaration of each number of a record, by its path (`now.applied`), in the order of its columns."""
    found: dict[str, Mapping[str, Any]] = {}
    for one in own_fields(kind):
        inner = one.metadata.get("record")
        if inner is None:
            found[one.name] = one.metadata
            continue
        for path, metadata in declared(inner).items():
            found[f"{one.name}.{path}"] = metadata if one.metadata["log"] else {**metadata, "log": "", "watched": False}
    return found


@cache
def columns(kind: Any) -> Mapping[str, int]:
    """Column of each number of a record, by path of the number; the first column of the record is 0."""
    return {path: column for column, path in enumerate(declared(kind))}


@cache
def _getter(kind: Any) -> Callable[[Any], tuple[Any, ...]]:
    names = tuple(declared(kind))
    if len(names) < 2:
        return lambda one: tuple(getattr(one, name) for name in names)
    return attrgetter(*names)


def numbers(one: Any) -> tuple[Any, ...]:
    """Numbers of a record, in the order of their columns."""
    kind: Any = type(one)
    return _getter(kind)(one)


def filled(kind: Callable[..., R], row: Iterator[Any]) -> R:
    """A record of the given kind, filled with the next numbers of a row."""
    return kind(*[filled(inner, row) if (inner := one.metadata.get("record")) else next(row) for one in own_fields(kind)])
