"""The limits file. It states limits of joints, noise of sensors, and gains and sensors that a design may choose."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from asrsim.document.block import Block, block_of, declare
from asrsim.document.file import read_file
from asrsim.document.kinds import NUMBER, POSITIVE, Either, ListOf, MapOf, Text
from asrsim.document.node import Node
from asrsim.document.yaml_reader import read_yaml
from asrsim.errors import InputError, Problem

SENSORS = "sensors"
"""Key of `choose` whose values are sensors. All other keys are gains."""
_RANGE = Either((ListOf(of=NUMBER, names=("low", "high")), POSITIVE))


@dataclass(frozen=True, kw_only=True)
class DesignLimits:
    """The contents of a limits file."""

    limits: Mapping[str, Mapping[str, Any]] = declare(
        MapOf(of=MapOf(of=_RANGE, noun="quantity or reference", star=False), star=False),
        doc="joint -> quantity or reference -> largest magnitude, or `[low, high]`; `motor_torque` limits each motor",
    )
    choose: Mapping[str, Any] = declare(
        MapOf(of=ListOf(of=Either((NUMBER, Text())), minimum=1), noun="key", star=False),
        default={},
        doc="`joint.parameter` -> values to choose from; `sensors` -> list of additional quantities that could be recorded",
    )
    noise: Mapping[str, float] = declare(
        MapOf(of=POSITIVE, noun="quantity", star=False),
        default={},
        shown="1 mrad on the positions of link and motors",
        doc="quantity, or `joint.quantity` -> standard deviation of its noise; all these quantities are recorded, except the "
        "sensors of `choose`",
    )
    rate: float = declare(POSITIVE, default=1000.0, unit="Hz", doc="sampling rate of the recording")

    @property
    def sensors(self) -> tuple[str, ...]:
        """Quantities of additional sensors that a design may choose."""
        return tuple(map(str, self.choose.get(SENSORS, ())))

    @property
    def gains(self) -> dict[str, tuple[float, ...]]:
        """Values from which a design may choose each gain, by `joint.parameter`."""
        return {key: tuple(values) for key, values in self.choose.items() if key != SENSORS}


LIMITS: Block[DesignLimits] = block_of(DesignLimits, "file of limits")


def read_limits(path: Path) -> DesignLimits:
    """Contents of a limits file. Raises InputError with all problems."""
    found = read_file(LIMITS, path)
    with located(path):
        if problems := list(_faults(found)):
            raise InputError(problems)
    return found


def _faults(limits: DesignLimits) -> Iterator[Problem]:
    for joint, ranges in limits.limits.items():
        for name, given in ranges.items():
            low, high = interval(given)
            if not low < high:
                key = f"limits.{joint}.{name}"
                yield Problem("its lower limit is not below its upper limit", key=key, value=low, code="limits")
    for sensor in limits.sensors:
        if sensor not in limits.noise:
            message = "has no noise level, so the information from this sensor is unknown"
            hint = f"Add its standard deviation to `noise`, such as {sensor}: 0.05"
            yield Problem(message, key=f"choose.{sensor}", hint=hint, code="noise")
    for key, values in limits.gains.items():
        if any(isinstance(value, str) for value in values):
            message = f"must be numbers; only the list of '{SENSORS}' contains names"
            yield Problem(message, key=f"choose.{key}", meant=key, choices=(SENSORS,), code="choose")


def interval(given: Any) -> tuple[float, float]:
    """Low and high limit. given: one number for a symmetric limit, or two numbers for the two ends."""
    return (-given, given) if isinstance(given, float | int) else (given[0], given[1])


@contextmanager
def located(path: Path) -> Iterator[None]:
    """Context that adds the file and the line of the key to problems of a limits file."""
    try:
        yield
    except InputError as error:
        root, _ = read_yaml(path)
        raise InputError([replace(one, file=path, line=_line(root, one.key or "")) for one in error.problems]) from None


def _line(node: Node, key: str) -> int | None:
    """Line of a dotted key in the file. If the file lacks the key, it is the line of the longest leading part of the key that
    the file contains. Names in the key may contain dots.
    """
    if isinstance(node.value, dict):
        for name, inner in node.value.items():
            if key == name or key.startswith(f"{name}."):
                return _line(inner, key[len(name) + 1 :])
    return node.line
