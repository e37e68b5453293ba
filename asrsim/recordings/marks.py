"""Numbers in text: decimal marks, groups of three digits, and minus signs other than the hyphen."""

from __future__ import annotations

import re

_OTHER = {".": ",", ",": "."}
"""The other mark of each decimal mark: a comma for a point, a point for a comma. The other mark may separate groups of digits.
"""
_GROUPS = {
    mark: re.compile(rf"-?[1-9]\d{{0,2}}(?P<groups>(?:\{other}\d{{3}})+)(?P<part>\{mark}\d*)?")
    for mark, other in _OTHER.items()
}
_APART = re.compile(r"-?\d{1,3}(?:['\u2019\u00a0\u202f]\d{3})+(?:[.,]\d*)?")
"""Pattern of a number in which apostrophes or narrow blanks separate groups of three digits."""
_MINUS = str.maketrans("\u2212\u2013", "--")
"""Minus signs that word processors and Unicode locales write instead of a hyphen."""
GROUPS, POINT, EITHER = "groups", "point", "either"
"""Uses of the other mark in a number if the decimal mark is a comma.
GROUPS: the point separates groups of digits (`1.234,5`).
POINT: the point is a decimal mark (`0.5`).
EITHER: the point may be one or the other (`1.234`).
"""


def number_in(cell: str, decimal: str) -> float:
    """Value of a number in a cell. A mark that is ambiguous counts as a separator of groups of digits. Raises ValueError if the
    cell contains no number.
    """
    text = cell.translate(_MINUS)
    if _APART.fullmatch(text):
        text = re.sub(r"['\u2019\u00a0\u202f]", "", text)
    if use_of_other(text, decimal) in (GROUPS, EITHER):
        text = text.replace(_OTHER[decimal], "")
    # Python reads 1_000 as a number, but no instrument writes numbers with underscores.
    if "_" in text:
        raise ValueError(text)
    return float(text.replace(",", ".") if decimal == "," else text)


def use_of_other(cell: str, decimal: str) -> str:
    """Use of the mark that is not the decimal mark in a number: `GROUPS`, `POINT` or `EITHER`; "" if the number does not
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
    """Value of a number whose only mark, a point or a comma, is the decimal mark."""
    return float(cell.translate(_MINUS).replace(",", "."))
