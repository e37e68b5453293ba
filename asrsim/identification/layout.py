"""Free parameters as a vector of logarithms or multiples of a typical size, shared or separate for each recording."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from asrsim.identification.keys import Parameter
from asrsim.identification.task import Tie
from asrsim.samples import Array


@dataclass(frozen=True)
class Entry:
    """An element of the parameter vector that is fitted."""

    parameter: Parameter
    track: int | None
    """Index of the recording to which this entry belongs; None: all recordings share the entry."""
    name: str
    """Displayed name: the key, with the recording's name if the recording has a separate value."""

    def value(self, x: float) -> float:
        """Value in the parameter's unit."""
        parameter = self.parameter
        if parameter.logarithmic:
            return min(max(parameter.start * math.exp(min(max(x, -50.0), 50.0)), parameter.low), parameter.high)
        return min(max(parameter.start + parameter.size * x, parameter.low), parameter.high)

    def slope(self, x: float) -> float:
        """Derivative of the value with respect to x, the element of the vector."""
        return self.value(x) if self.parameter.logarithmic else self.parameter.size

    def place(self, value: float) -> float:
        """Element x of the vector for a value; inverse of `value`."""
        parameter = self.parameter
        if parameter.logarithmic:
            return math.log(value / parameter.start) if value > 0.0 else -math.inf
        return (value - parameter.start) / parameter.size


@dataclass(frozen=True)
class Layout:
    """Elements of the parameter vector, and parameters that are tied to them."""

    entries: tuple[Entry, ...]
    ties: tuple[Tie, ...]
    tracks: int

    def __len__(self) -> int:
        return len(self.entries)

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds of the vector, (n,) each."""
        low = np.array([entry.place(entry.parameter.low) for entry in self.entries])
        high = np.array([entry.place(entry.parameter.high) for entry in self.entries])
        return low, high

    def values(self, x: Array) -> Array:
        """Values (n,) in the parameters' units."""
        return np.array([entry.value(float(v)) for entry, v in zip(self.entries, x, strict=True)])

    def slopes(self, x: Array) -> Array:
        """Derivatives (n,) of the values with respect to the vector."""
        return np.array([entry.slope(float(v)) for entry, v in zip(self.entries, x, strict=True)])

    def table(self, x: Array, track: int) -> dict[str, float]:
        """Values by key for a recording, including tied parameters."""
        found = {
            entry.parameter.key: entry.value(float(v))
            for entry, v in zip(self.entries, x, strict=True)
            if entry.track in (None, track)
        }
        return self.tied(found)

    def tied(self, values: Mapping[str, float]) -> dict[str, float]:
        """Values by key, extended by the tied parameters."""
        return {**values, **{tie.key: tie.factor * values[tie.to] for tie in self.ties if tie.to in values}}

    def touched(self, index: int) -> range:
        """Indices of the recordings that an entry affects."""
        track = self.entries[index].track
        return range(self.tracks) if track is None else range(track, track + 1)


def entry_of(parameter: Parameter, track: int | None, names: Sequence[str]) -> Entry:
    """Entry of a parameter. track: index of the recording with a separate value, None for a shared value; names: names of the
    recordings.
    """
    name = parameter.key if track is None or len(names) == 1 else f"{parameter.key} ({names[track]})"
    return Entry(parameter, track, name)


def make_layout(
    free: Sequence[Parameter], ties: Sequence[Tie], names: Sequence[str], starts: Sequence[Mapping[str, float]]
) -> Layout:
    """Layout of the free parameters. names: names of the recordings; starts: for each fitted recording, start values by key of
    the parameters that depend on the recording.
    """
    entries: list[Entry] = []
    for parameter in free:
        if not parameter.own:
            entries.append(entry_of(parameter, None, names))
            continue
        for i, own in enumerate(starts):
            entries.append(entry_of(replace(parameter, start=own.get(parameter.key, parameter.start)), i, names))
    return Layout(tuple(entries), tuple(ties), len(names))
