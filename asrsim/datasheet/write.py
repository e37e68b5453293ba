"""Writes sheets into a folder: page, picture, numbers, and the files that repeat the simulations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from asrsim.datasheet.data import Sheet
from asrsim.datasheet.page import common_charts, comparison_page, sheet_page
from asrsim.datasheet.picture import save_comparison, save_sheet
from asrsim.errors import InputError
from asrsim.outfile import check_output, make_folder, write_json, write_text
from asrsim.plots.output import check_formats

COMPARISON = "comparison"
KINDS = {".html": "page", ".json": "json", ".yaml": "sheet scenario", ".urdf": "sheet robot"}
"""Kind of file by its ending, for `asrsim.outfile`."""


def write_sheets(
    sheets: Sequence[Sheet], folder: Path, *, compare: bool = False, formats: Sequence[str] = ("png",)
) -> tuple[Path, ...]:
    """Write the files of all sheets, and return their paths. compare: whether a page with all actuators side by side is also
    written.

    formats: formats of the pictures: png, pdf, svg. Raises OutputError, and InputError for an unknown format, or for sliding
    and turning joints side by side.
    """
    kinds = check_formats(formats)
    if compare and len({tuple(one.unit for one in sheet.entries) for sheet in sheets}) > 1:
        raise InputError("cannot compare sliding and turning joints: their units differ", key="--compare", code="units")
    texts = {folder / name: text for sheet in sheets for name, text in sheet.files.items()}
    texts |= {folder / f"{sheet.name}.html": sheet_page(sheet) for sheet in sheets}
    numbers = {folder / f"{sheet.name}.json": sheet.as_dict() for sheet in sheets}
    pictures: dict[Path, Callable[[Path], object]] = {
        folder / f"{sheet.name}.{kind}": partial(save_sheet, sheet=sheet) for sheet in sheets for kind in kinds
    }
    if compare:
        texts[folder / f"{COMPARISON}.html"] = comparison_page(sheets)
        save = partial(save_comparison, sheets=sheets, charts=common_charts(sheets))
        pictures |= {folder / f"{COMPARISON}.{kind}": save for kind in kinds}
    for path in (*texts, *numbers, *pictures):
        check_output(path, KINDS.get(path.suffix, "picture"))
    make_folder(folder)
    for path, text in texts.items():
        write_text(path, text, KINDS[path.suffix])
    for path, data in numbers.items():
        write_json(path, data)
    for path, draw in pictures.items():
        draw(path)
    return (*texts, *numbers, *pictures)
