"""Columns of a recording held against each other: a velocity is the slope of its position, and a command is followed."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from asrsim.errors import Problem
from asrsim.recordings.checks import suspect_scale
from asrsim.recordings.data import Column
from asrsim.samples import Array

_FEWEST = 20
"""Samples below which nothing is said."""
_ALIKE = 0.9
"""Correlation from which on a position is taken as what its velocity sums up to, and a command as followed."""
_OFF = 1.5
"""A velocity that is so many times its position's slope, or so small a part of it, is suspected."""
_NEAR = 1.12
"""A factor is named if the velocity's is within this factor of it: both are measured."""
_DEGREES, _TURNS, _RPM, _PARTS = 180 / math.pi, 1 / math.tau, 30 / math.pi, 1000.0
"""Degrees and turns in a rad, turns a minute in a rad/s, and thousandths in one."""
_MEANINGS = (
    (_DEGREES, "is the velocity in deg/s?", "deg/s", True),
    (1 / _DEGREES, "is the position in degrees?", "deg", False),
    (_RPM, "is the velocity in rpm?", "rpm", True),
    (_TURNS, "is the velocity in turns a second?", "rev/s", True),
    (1 / _TURNS, "is the position in turns?", "rev", False),
    (_PARTS, "is one of them in thousandths, or the time in another unit?", "", True),
    (1 / _PARTS, "is one of them in thousandths, or the time in another unit?", "", True),
)
"""Velocity / slope, what it asks for, the unit that would explain it, and whether that is the velocity's."""
_PAIRS = (
    ("link_position", "link_velocity"), ("motor_1_position", "motor_1_velocity"), ("motor_2_position", "motor_2_velocity"),
)  # fmt: skip


def disagreements(columns: Sequence[Column]) -> list[Problem]:
    """Suspicions of units, signs and times: velocities beside the slopes of their positions, commands beside positions."""
    found = {(column.joint, column.quantity): column for column in columns if column.joint and column.quantity}
    problems: list[Problem | None] = []
    for joint in dict.fromkeys(name for name, _ in found):
        for position, velocity in _PAIRS:
            if (joint, position) in found and (joint, velocity) in found:
                problems.append(_slope(found[joint, position], found[joint, velocity]))
        if (joint, "reference_1") in found and (joint, "link_position") in found:
            problems.append(_followed(found[joint, "link_position"], found[joint, "reference_1"]))
    return [problem for problem in problems if problem is not None]


def _slope(position: Column, velocity: Column) -> Problem | None:
    """A velocity that is not the slope of its position. Its sum is compared, since slopes of what was measured are noise."""
    both = _together(position, velocity)
    if both is None:
        return None
    time, angle, speed = both
    total = np.concatenate(([0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(time))))
    # A velocity that is off by a little runs away from its position along a line.
    trend = np.column_stack([np.ones_like(time), time - time[0]])
    angle, total = (values - trend @ np.linalg.lstsq(trend, values, rcond=None)[0] for values in (angle, total))
    likeness = _likeness(angle, total)
    if abs(likeness) < _ALIKE:
        return None
    if likeness < 0.0:
        return Problem(
            f"goes down where '{position.source}' rises: is the sign of one of them the other way round?", key=velocity.source,
            hint=f"Turn it: --map '{velocity.source}=-{velocity.joint}.{velocity.quantity}'",
            code="suspected-sign",
        )  # fmt: skip
    ratio = float(np.std(total) / np.std(angle))
    if 1 / _OFF < ratio < _OFF:
        return None
    asks, hint = "are both in the units that are assumed, of one side of the gear, and is the time right?", None
    for factor, asked, unit, fast in _MEANINGS:
        if 1 / _NEAR < ratio / factor < _NEAR:
            column = velocity if fast else position
            asks = asked
            if unit and not column.stated:
                hint = f"If so: --map '{column.source}={column.joint}.{column.quantity} [{unit}]'"
    return Problem(
        f"is {ratio:.3g} times the slope of '{position.source}': {asks}", key=velocity.source, hint=hint,
        code="suspected-unit",
    )  # fmt: skip


def _followed(position: Column, command: Column) -> Problem | None:
    """A command that the position follows at 57.3 or 1000 times its size, where not both state their units."""
    both = _together(position, command)
    if both is None or (position.stated and command.stated) or _likeness(both[1], both[2]) < _ALIKE:
        return None
    if suspect_scale(both[1], both[2]) is None:
        return None
    ratio = float(np.std(both[2]) / np.std(both[1]))
    return Problem(
        f"is {ratio:.3g} times as large as '{position.source}', which follows it: is one of them in degrees or thousandths?",
        key=command.source, code="suspected-unit",
        hint=f"If so: --map '{command.source}={command.joint}.{command.quantity} [unit]', or that of the other",
    )  # fmt: skip


def _together(first: Column, second: Column) -> tuple[Array, Array, Array] | None:
    """Time and numbers (n,) of both columns where both have any; None where these are too few or one does not move."""
    finite = np.isfinite(second.values)
    if finite.sum() < _FEWEST:
        return None
    values = second.values
    if first.time is not second.time:
        values = np.interp(first.time, second.time[finite], second.values[finite], left=np.nan, right=np.nan)
    both = np.isfinite(first.values) & np.isfinite(values)
    time, a, b = first.time[both], first.values[both], values[both]
    if len(time) < _FEWEST or min(np.ptp(a), np.ptp(b)) < 1e-9 * max(1.0, float(np.max(np.abs(a)))):
        return None
    return time, a, b


def _likeness(a: Array, b: Array) -> float:
    """Their correlation; 0 where one does not move."""
    spread = float(np.std(a) * np.std(b))
    return float(np.mean((a - a.mean()) * (b - b.mean()))) / spread if spread > 0.0 else 0.0
