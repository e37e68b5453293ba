"""Suspicions: factors between simulation and recording that are units, not physics; and what columns were taken for."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from asrsim.actuators import MODES
from asrsim.errors import Problem
from asrsim.quantities import PRISMATIC_UNITS
from asrsim.recordings.data import Column, Recording
from asrsim.samples import Array

_FACTORS = (
    (180 / math.pi, "the recording seems to be in degrees", "State the unit: --map 'COLUMN=JOINT.QUANTITY [deg]'"),
    (math.pi / 180, "the recording seems to have been converted from degrees once too often",
     "Undo it: --map 'COLUMN=57.29578*JOINT.QUANTITY'"),
    (1000.0, "the recording seems to be in thousandths (mm, mN m, ms)", "Convert it: --map 'COLUMN=0.001*JOINT.QUANTITY'"),
    (0.001, "the recording seems to be in thousands, or was converted from thousandths once too often",
     "Convert it: --map 'COLUMN=1000*JOINT.QUANTITY'"),
)  # fmt: skip
"""Factor, what it seems to come of, and the item of a mapping that cures it."""
_ALONE = 12.0
"""Times the usual departure from the neighbours' mean, beyond which a single sample is no noise."""
_SHARE = 0.2
"""Of the range, likewise."""
_TURNED = 0.7
"""Correlation, with its sign turned, from which on a column is suspected to be of the other sign."""
_GEAR = 8.0
"""Times as large as a link's motion from which on a column is suspected to be before the gear."""
_WIDTH = 1.25
"""A factor is suspected if the ratio of sizes is within this factor of it; real robots differ by less from their model."""


def suspect_scale(simulation: Array, recording: Array, than: str = "the simulation") -> Problem | None:
    """A suspicion that a unit is wrong: the recording is 57.3 or 1000 times as large (or small) as the simulation.

    Compares the ranges (5 to 95 %) of both series, (n,) and (m,), in what should be one unit; where either does not move,
    their mean magnitudes. None without suspicion, or where both are at rest at zero. than: what it is compared with, in words.
    """
    sizes = [_size(simulation), _size(recording)]
    at_rest = any(size[0] < 1e-9 for size in sizes)
    pair = (sizes[0][int(at_rest)], sizes[1][int(at_rest)])
    if min(pair) < 1e-12:
        return None
    # Of sizes that are not finite the ratio is near no factor.
    ratio = pair[1] / pair[0]
    for factor, meaning, cure in _FACTORS:
        if 1 / _WIDTH < ratio / factor < _WIDTH:
            return Problem(
                f"the recording is {ratio:.4g} times as large as {than}, close to {factor:.4g}: {meaning}",
                hint=cure, code="suspected-unit",
            )  # fmt: skip
    return None


def suspect_gear(simulation: Array, recording: Array) -> Problem | None:
    """A suspicion that a motor was recorded before its gear: eight times as large or more, and not by a unit's factor."""
    sizes = _size(simulation)[0], _size(recording)[0]
    if not all(map(math.isfinite, sizes)) or sizes[0] < 1e-9 or sizes[1] < _GEAR * sizes[0]:
        return None
    if suspect_scale(simulation, recording) is not None:
        return None
    return Problem(
        f"the recording is {sizes[1] / sizes[0]:.4g} times as large as the simulation, whose motors are counted at the "
        "link's side of the gear: was it recorded before the gear?",
        hint="Divide by the gear's ratio with `scale` in a mapping file", code="suspected-gear",
    )  # fmt: skip


def suspect_sign(simulation: Array, recording: Array, than: str = "the simulation") -> Problem | None:
    """A suspicion that an axis is turned: both series, (n,) on one time, are correlated by less than -0.7."""
    both = np.isfinite(simulation) & np.isfinite(recording)
    a, b = simulation[both], recording[both]
    if len(a) < 10 or min(np.ptp(a), np.ptp(b)) < 1e-9:
        return None
    correlation = float(np.corrcoef(a, b)[0, 1])
    if correlation > -_TURNED:
        return None
    return Problem(
        f"the recording moves against {than} (correlation {correlation:.2f}): is its sign the other way round?",
        hint="Turn it: --map 'COLUMN=-JOINT.QUANTITY'", code="suspected-sign",
    )  # fmt: skip


def suspicions(simulation: Array, recording: Array, column: Column, joint: str, than: str = "the simulation") -> list[Problem]:
    """All of these about a column beside the run's joint, with the item of a mapping that would cure it."""
    gear = str(column.quantity).startswith("motor")
    found = (
        suspect_scale(simulation, recording, than),
        suspect_sign(simulation, recording, than),
        suspect_gear(simulation, recording) if gear else None,
    )
    named = f"{column.source}=", f"{joint}.{column.quantity}"
    return [
        replace(one, hint=str(one.hint).replace("COLUMN=", named[0]).replace("JOINT.QUANTITY", named[1]))
        for one in found
        if one is not None
    ]


def _size(values: Array) -> tuple[float, float]:
    finite = values[np.isfinite(values)]
    if not len(finite):
        return math.nan, math.nan
    low, high = np.percentile(finite, (5, 95))
    return float(high - low), float(np.mean(np.abs(finite)))


def lone(values: Array) -> NDArray[np.bool_]:
    """Samples (n,) far from both neighbours, which agree with each other: single glitches, not steps and not noise."""
    found = np.zeros(len(values), dtype=bool)
    if len(values) < 10:
        return found
    off = values[1:-1] - 0.5 * (values[:-2] + values[2:])
    extent = float(np.ptp(np.percentile(values, (2, 98))))
    spread = 1.4826 * float(np.median(np.abs(off)))
    far = np.abs(off) > max(_ALONE * spread, _SHARE * extent, 1e-12)
    found[1:-1] = far & (np.abs(values[2:] - values[:-2]) < 0.3 * np.abs(off))
    return found if found.mean() < 0.01 or found.sum() == 1 else np.zeros(len(values), dtype=bool)


def wrong_unit(column: Column, joint: str, *, prismatic: bool, mode: int | None = None) -> Problem | None:
    """What is wrong with a column whose stated unit cannot be one of that joint: m of a revolute one, rad of a prismatic one.

    mode: of the run, whose reference is a position or a torque; None: its unit is not asked for.
    """
    quantity = str(column.quantity)
    # Second references and motors have units of their own (AwAS-II's adjuster moves in m).
    if (
        not column.stated
        or not column.unit
        or quantity in ("reference_2", "motor_2_position", "motor_2_velocity", "motor_2_torque")
    ):
        return None
    kinds = {"N m": "torque", "N": "torque", "V": "voltage", "A": "current"}
    if quantity == "reference_1" and mode in MODES:
        told = kinds.get(MODES[mode].units[0], "position")
        if kinds.get(column.unit, "position") != told:
            return Problem(f"is in {column.unit}, but the reference of {joint} is a {told} in mode {mode}",
                           key=column.source, code="wrong-unit")  # fmt: skip
    units = PRISMATIC_UNITS.values() if prismatic else PRISMATIC_UNITS.keys()
    if column.unit not in (*PRISMATIC_UNITS, *PRISMATIC_UNITS.values()) or column.unit in units:
        return None
    kind, right = ("prismatic", "m") if prismatic else ("revolute", "rad")
    return Problem(
        f"is in {column.unit}, but {joint} is {kind}, whose positions are in {right}", key=column.source,
        code="wrong-unit",
        hint=f"Give the unit of its numbers: --map '{column.source}={joint}.{quantity} [unit]', or =ignore",
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class GuessRow:
    """How one column was read, in words."""

    column: str
    meaning: str
    """`joint.quantity`, or "-"."""
    unit: str
    conversion: str
    origin: str


def guess_rows(recording: Recording) -> tuple[GuessRow, ...]:
    """One row a column: what it was taken for, its unit, its conversion and why."""
    return tuple(
        GuessRow(
            column=column.source,
            meaning=f"{column.joint}.{column.quantity}" if column.quantity else "-",
            unit=column.unit,
            conversion=column.conversion,
            origin=column.origin,
        )
        for column in recording.channels.values()
    )
