"""Columns without a unit in files that speak of degrees or millimetres elsewhere: read as SI, and asked about."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from asrsim.errors import Problem
from asrsim.quantities import DERIVED, QUANTITIES
from asrsim.recordings.data import Column
from asrsim.recordings.units import split_header

_DEGREES = re.compile(r"^.*(?:\b(?:deg|degs|degrees?)\b|\bindegrees\s*=\s*yes|°(?!C)).*$", re.IGNORECASE | re.MULTILINE)


def unstated(path: Path, columns: Sequence[Column], remarks: str) -> list[Problem]:
    """A question where positions state no unit beside others that do, in a file that is called so, or under such a remark."""
    known = QUANTITIES | DERIVED
    assumed = [
        column.source
        for column in columns
        if column.quantity and not column.stated and (known[column.quantity].unit == "rad" or column.quantity == "reference_1")
    ]
    if not assumed:
        return []
    other = next((c for c in columns if c.stated and c.conversion and c.unit in ("rad", "m") and c.quantity), None)
    unit = split_header(path.stem)[1]
    if other is not None:
        told = f"'{other.source}' is in {other.conversion.partition(' ')[0]}"
    elif unit is not None and unit.factor != 1.0 and unit.si in ("rad", "m"):
        told = f"the file's name says {unit.symbol}"
    elif (said := _DEGREES.search(remarks)) is not None:
        told = f"the file says: {said[0].strip()[:60]}"
    else:
        return []
    what = "states no unit and is" if len(assumed) == 1 else "state no unit and are"
    return [
        Problem(f"{what} read in SI, but {told}", file=path, key=", ".join(assumed[:6]),
                code="unstated-unit", hint=f"If it is so: --map '{assumed[0]}=JOINT.QUANTITY [deg]'")
    ]  # fmt: skip
