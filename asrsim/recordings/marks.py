"""Numbers as text writes them: decimal marks, groups of three digits, and minus signs other than the hyphen."""

from __future__ import annotations

import re

_OTHER = {".": ",", ",": "."}
"""For each decimal mark the other of the two marks, which may group the digits of large numbers in threes."""
_GROUPS = {
    mark: re.compile(rf"-?[1-9]\d{{0,2}}(?P<groups>(?:\{other}\d{{3}})+)(?P<part>\{mark}\d*)?")
    for mark, other in _OTHER.items()
}
_APART = re.compile(r"-?\d{1,3}(?:['\u2019\u00a0\u202f]\d{3})+(?:[.,]\d*)?")
"""Pattern of digits that an apostrophe or a narrow blank groups."""
_MINUS = str.maketrans("\u2212\u2013", "--")
"""Signs that word processors and Unicode locales write in place of a hyphen."""
GROUPS, POINT, EITHER = "groups", "point", "either"
"""Uses of the other mark in a number: it groups digits (`1.234,5`), is a decimal mark (`0.5`), or may be both (`1.234`)."""


def number_in(cell: str, decimal: str) -> float:
    """Value of a number. Raises ValueError where the cell holds none. An ambiguous mark counts as grouping digits."""
    text = cell.translate(_MINUS)
    if _APART.fullmatch(text):
        text = re.sub(r"['\u2019\u00a0\u202f]", "", text)
    if use_of_other(text, decimal) in (GROUPS, EITHER):
        text = text.replace(_OTHER[decimal], "")
    # Python reads 1_000 as a number, but no instrument writes numbers like this.
    if "_" in text:
        raise ValueError(text)
    return float(text.replace(",", ".") if decimal == "," else text)


def use_of_other(cell: str, decimal: str) -> str:
    """How a number uses the mark that is not the decimal mark: `GROUPS`, `POINT`, `EITHER`, or "" if the number does not
    contain this mark.
    """
    other = _OTHER[decimal]
    if other not in cell:
        return ""
    text = cell.translate(_MINUS)
    found = _GROUPS[decimal].fullmatch(text)
    if found is None:
        return POINT if decimal not in text and text.count(other) == 1 else ""
    return GROUPS if found["part"] or found["groups"].count(other) > 1 else EITHER


def with_point(cell: str) -> float:
    """Value of a number whose only mark, a point or a comma, is its decimal mark."""
    return float(cell.translate(_MINUS).replace(",", "."))
