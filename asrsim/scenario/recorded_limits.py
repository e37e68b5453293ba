"""Limits of springs and motors that a recording exceeds, so that no simulation with these limits can follow the recording."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from asrsim.actuators import ACTUATORS, MODES
from asrsim.recordings.data import Column
from asrsim.recordings.suspicions import gear_between
from asrsim.robot import ActuatorBlock
from asrsim.samples import Array

SPAN = 0.02
"""Time over which speeds are computed from positions, s. With this time, noise of 1 mrad changes a speed by about 0.1 rad/s."""
ROOM = 2.0
"""Proposed limit, as a multiple of the largest recorded value."""
MARGIN = 1.02
"""Smallest ratio of the largest recorded value to the limit at which the limit counts as exceeded, as a margin for noise."""


@dataclass(frozen=True, kw_only=True)
class Exceeded:
    """A limit of a joint's actuator, and the larger value that was recorded."""

    joint: str
    parameter: str
    reached: float
    """Largest recorded value, in the parameter's unit."""
    limit: float
    unit: str
    default: bool
    """Whether the limit is the default, which the robot's file does not state."""

    @property
    def proposal(self) -> float:
        """Limit that the recorded motion does not reach, in the parameter's unit."""
        return float(f"{ROOM * self.reached:.2g}")

    def __str__(self) -> str:
        of = "the default, " if self.default else ""
        return (
            f"{self.joint}: the recording reaches {self.reached:.3g} {self.unit}, but {self.parameter} is {of}{self.limit:g} "
            f"{self.unit}: raise it, as in parameters: {{{self.joint}: {{{self.parameter}: {self.proposal:g}}}}}"
        )


def exceeded_limits(block: ActuatorBlock, columns: Mapping[tuple[str, str], Column]) -> Iterator[Exceeded]:
    """Limits of deflections and of motor speeds that the recorded motion of a joint exceeds.

    columns: columns of the recording by joint and quantity, in SI units. A motor that was measured before its gear is left out.
    """
    actuator, mode = ACTUATORS.get(block.actuator), MODES[block.mode]
    link = columns.get((block.joint, "link_position"))
    deflections: list[float] = []
    for i in range(1, actuator.motors + 1):
        motor = columns.get((block.joint, f"motor_{i}_position"))
        if motor is None or not mode.spring or gear_between(motor, link):
            continue
        if mode.motor:
            yield from _exceeded(block, f"motor_{i}_max_velocity", _largest(_speeds(motor)))
        if link is not None and not actuator.is_housed(i - 1):
            apart = motor.values - np.interp(motor.time, link.time, link.values)
            deflections.append(_largest(_without_outliers(apart[np.isfinite(apart)])))
    if deflections:
        yield from _exceeded(block, "max_deflection", max(deflections))


def _exceeded(block: ActuatorBlock, name: str, reached: float) -> Iterator[Exceeded]:
    own = block.parameters.get(name)
    if own is not None and reached > MARGIN * own.value:
        yield Exceeded(
            joint=block.joint, parameter=name, reached=reached, limit=own.value, unit=own.unit, default=own.origin == "default"
        )


def _speeds(column: Column) -> Array:
    """Speeds over `SPAN`, rad/s."""
    known = np.isfinite(column.values)
    time, places = column.time[known], _without_outliers(column.values[known])
    if len(time) < 2:
        return np.zeros(0)
    ends = np.arange(time[0], time[-1], SPAN)
    return _without_outliers(np.diff(np.interp(ends, time, places)) / SPAN)


def _without_outliers(values: Array) -> Array:
    """Medians of three neighbours, in which single outliers vanish."""
    if len(values) < 3:
        return values
    return np.median(np.lib.stride_tricks.sliding_window_view(np.pad(values, 1, mode="edge"), 3), axis=-1)


def _largest(values: Array) -> float:
    return float(np.abs(values).max(initial=0.0))
