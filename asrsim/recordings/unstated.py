"""Angles that may be in another unit than the one they are read in: asked about."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from asrsim.errors import Problem
from asrsim.quantities import DERIVED, QUANTITIES
from asrsim.recordings.data import Column
from asrsim.recordings.units import split_header

_DEGREES = re.compile(r"^.*(?:\b(?:deg|degs|degrees?)\b|\bindegrees\s*=\s*yes|°(?!C)).*$", re.IGNORECASE | re.MULTILINE)


_BEYOND = 1.5
"""Times as far as a joint's stops, which real robots pass a little."""
_TURNS = 2.0
"""A link that turns further is rare, and one that says nothing of radians rarer still."""


def unstated(path: Path, columns: Sequence[Column], remarks: str) -> list[Problem]:
    """A question where positions state no unit: beside others that do, in a file that is called so, under such a remark, or
    where a link would turn more than twice; and where they are in Grad, which is degrees to some and gradians to others."""
    return [*_unstated(path, columns, remarks), *_gradians(path, columns)]


def beyond_stops(column: Column, joint: str, stops: tuple[float, float]) -> str | None:
    """A question where a link's numbers, read in SI without a word of it, lie where its joint cannot go."""
    most = max(abs(stop) for stop in stops)
    if column.quantity != "link_position" or column.stated or _farthest(column) < _BEYOND * most:
        return None
    return (
        f"{column.source}: states no unit and goes to {_farthest(column):.3g}, but {joint} stops at {most:.3g} rad or m: is it "
        f"in degrees or mm? Say so with --map '{column.source}={joint}.link_position [deg]'"
    )


def _farthest(column: Column) -> float:
    """rad that an angle's numbers go to either side, single ones left out."""
    return float(np.nanpercentile(np.abs(column.values), 98)) if np.isfinite(column.values).any() else 0.0


def _gradians(path: Path, columns: Sequence[Column]) -> list[Problem]:
    found = [column.source for column in columns if column.quantity and column.conversion.startswith("Grad")]
    if not found:
        return []
    return [
        Problem("Grad is read as degrees, as in German", key=", ".join(found[:6]), code="gradians",
                hint=f"If these are gradians, 400 to a turn: --map '{found[0]}=JOINT.QUANTITY [gon]'")
    ]  # fmt: skip


def _unstated(path: Path, columns: Sequence[Column], remarks: str) -> list[Problem]:
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
    links = [column for column in columns if column.source in assumed and column.quantity == "link_position"]
    widest = max(links, key=_farthest, default=None)
    if other is not None:
        told = f"'{other.source}' is in {other.conversion.partition(' ')[0]}"
    elif unit is not None and unit.factor != 1.0 and unit.si in ("rad", "m"):
        told = f"the file's name says {unit.symbol}"
    elif (said := _DEGREES.search(remarks)) is not None:
        told = f"the file says: {said[0].strip()[:60]}"
    elif widest is not None and _farthest(widest) > _TURNS * math.tau:
        told = f"'{widest.source}' would turn by {_farthest(widest):.3g} rad"
    else:
        return []
    what = "states no unit and is" if len(assumed) == 1 else "state no unit and are"
    return [
        Problem(f"{what} read in SI, but {told}", key=", ".join(assumed[:6]),
                code="unstated-unit", hint=f"If it is so: --map '{assumed[0]}=JOINT.QUANTITY [deg]'")
    ]  # fmt: skip
