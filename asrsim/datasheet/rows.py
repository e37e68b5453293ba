"""Tables of the numbers on data sheets, for pages and pictures."""

from __future__ import annotations

from collections.abc import Sequence

from asrsim.datasheet.data import Entry, Sheet
from asrsim.report.html import number


def number_rows(sheet: Sheet) -> tuple[list[str], list[list[str]]]:
    """Headings and rows of the numbers of a sheet. An unknown number is empty; its remark states how it could be found."""
    rows = [
        [one.words, number(one.value) if one.known else "", one.unit if one.known else "", one.how] for one in sheet.entries
    ]
    return ["quantity", "value", "unit", "how it was found"], rows


def compared_rows(sheets: Sequence[Sheet]) -> tuple[list[str], list[list[str]]]:
    """Headings and rows of the numbers of several sheets, side by side."""

    def cell(one: Entry) -> str:
        return number(one.value) if one.known else "-"

    rows = [[f"{one.words} ({one.unit})", *(cell(sheet.entry(one.key)) for sheet in sheets)] for one in sheets[0].entries]
    return ["quantity", *names_of(sheets)], rows


def names_of(sheets: Sequence[Sheet]) -> list[str]:
    """Short names of sheets; if two sheets have the same short name, the names of their files instead."""
    short = [sheet.short for sheet in sheets]
    return short if len(set(short)) == len(short) else [sheet.name for sheet in sheets]
