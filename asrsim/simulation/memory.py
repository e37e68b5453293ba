"""Rows of the joints for the substep: lists for plain Python, an array for compiled code."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from asrsim.compiling import tuple_reader
from asrsim.simulation.kernels import BRISTLE_STATE, MOTOR_STATE
from asrsim.simulation.substep import LAWS, STATE, Memory

RINGS = STATE + 2
"""In a plain row: state, constants, what sensors saw, then the response."""
STATE_NUMBERS = 2 * (MOTOR_STATE + BRISTLE_STATE)
"""Room for a state in a compiled row; the constants follow."""


def plain_memory() -> Memory:
    """State and constants are tuples in the list."""

    def save(joint: Any, state: Any) -> None:
        joint[STATE] = state

    def note(rows: Any, k: int, j: int, q: float, lagging: float, torque: float, applied: float, record: Any) -> None:
        rows[k][j] = [q, lagging, torque, applied, 0.0, *record]

    return Memory(
        load=lambda joint: joint[STATE],
        save=save,
        constants=lambda joint: joint[STATE + 1],
        note=note,
        ring=lambda joint, i: joint[RINGS + i],
    )


def compiled_memory(state: Sequence[float], constants: Any, ring: int) -> Memory:
    """State, constants and rings of `ring` numbers each are spread over the row."""
    width, start = len(state), STATE + STATE_NUMBERS
    load = LOADS[width]
    read_constants, after = make_reader(constants, start)

    def save(joint: Any, values: Any) -> None:
        for i in range(width):
            joint[STATE + i] = values[i]

    def nothing(joint: Any, values: Any) -> None:
        pass

    def note(rows: Any, k: int, j: int, q: float, lagging: float, torque: float, applied: float, record: Any) -> None:
        row = rows[k][j]
        row[0] = q
        row[1] = lagging
        row[2] = torque
        row[3] = applied
        row[4] = 0.0
        for i in range(len(record)):
            row[LAWS + i] = record[i]

    def ring_of(joint: Any, i: int) -> Any:
        return joint[after + i * ring : after + (i + 1) * ring]

    return Memory(load=load, save=save if width else nothing, constants=read_constants, note=note, ring=ring_of)


def _load_none(row: Any) -> Any:
    return ()


def _load_one(row: Any) -> Any:
    return (row[STATE],)


def _load_four(row: Any) -> Any:
    return (row[STATE], row[STATE + 1], row[STATE + 2], row[STATE + 3])


def _load_eight(row: Any) -> Any:
    return (
        row[STATE], row[STATE + 1], row[STATE + 2], row[STATE + 3],
        row[STATE + 4], row[STATE + 5], row[STATE + 6], row[STATE + 7],
    )  # fmt: skip


def _load_two(row: Any) -> Any:
    return (row[STATE], row[STATE + 1])


def _load_six(row: Any) -> Any:
    return (*_load_four(row), row[STATE + 4], row[STATE + 5])


def _load_twelve(row: Any) -> Any:
    return (*_load_eight(row), row[STATE + 8], row[STATE + 9], row[STATE + 10], row[STATE + 11])


LOADS = {0: _load_none, 1: _load_one, 2: _load_two, 4: _load_four, 6: _load_six, 8: _load_eight, 12: _load_twelve}
"""Numbers of a state -> what reads them: of no motor, of a link's controller, of one motor, of two; and of springs with
hysteresis, without motors (2, 4), with one motor or two. Run in plain Python too."""


def make_reader(constants: Any, start: int) -> tuple[Callable[[Any], Any], int]:
    """A function of a row that gives the numbers from place `start` on, nested as `constants` are; and the place after them.

    For compiled code only. Every function that is compiled costs time, so numbers that stand together are read together.
    """
    if not any(isinstance(part, tuple) for part in constants):
        return (_load_none if not constants else tuple_reader(start, len(constants))), start + len(constants)
    reader: Callable[[Any], Any] = _load_none
    for part in constants:
        inner, after = make_reader(part, start) if isinstance(part, tuple) else (_number_at(start), start + 1)
        reader, start = _longer(reader, inner), after
    return reader, start


def _number_at(place: int) -> Callable[[Any], Any]:
    def number(row: Any) -> Any:
        return row[place]

    return number


def _longer(first: Callable[[Any], Any], last: Callable[[Any], Any]) -> Callable[[Any], Any]:
    def longer(row: Any) -> Any:
        return (*first(row), last(row))

    return longer


def flatten(values: tuple[Any, ...]) -> list[float]:
    """Nested tuples of floats as one list."""
    found: list[float] = []
    for value in values:
        if isinstance(value, tuple):
            found += flatten(value)
        else:
            found.append(float(value))
    return found


def shape_of(values: Any) -> Any:
    """The nesting of tuples without the numbers."""
    return tuple(map(shape_of, values)) if isinstance(values, tuple) else 0
