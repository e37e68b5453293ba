"""A fit as one HTML page with everything in it."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any

from asrsim.identification.result import Result
from asrsim.identification.show import advice, columns, correlated, errors, judgement
from asrsim.outfile import write_text
from asrsim.report.html import badge, bullets, data_address, document, section, table

PAGE = "report.html"


def write_page(result: Result, folder: Path, *, pictures: bool = True) -> Path:
    """report.html, with the folder's pictures in it. Raises OutputError."""
    path = folder / PAGE
    write_text(path, make_page(result, sorted(folder.glob("*.png")) if pictures else []), "page")
    return path


def make_page(result: Result, pictures: Sequence[Path]) -> str:
    """The page as text."""
    title = f"{result.task.name}: {len(result.estimates)} parameters from {len(result.task.experiments)} recordings"
    css = files("asrsim.report").joinpath("assets/page.css").read_text(encoding="utf-8")
    good = result.fits
    body = f"<h1>{escape(title)}</h1><p>{badge('fits' if good else 'does not fit', good=good)}</p>"
    body += bullets(text.strip() for text, _ in judgement(result))
    body += section(
        "Parameters", _table(columns(result)) + bullets(f"{e.name}: {e.reason}" for e in result.estimates if e.reason)
    )
    if result.combinations:
        body += section("Known combinations", bullets(map(str, result.combinations)))
    body += section("Errors", _table(errors(result)))
    pairs = [f"{a} and {b}: {value:.3f}" for a, b, value in correlated(result)]
    if pairs:
        body += section("Correlated estimates", bullets(pairs))
    told = list(advice(result))
    if told:
        body += section("To know more", bullets(told))
    body += section("Recordings", bullets([f"{one.file}" for one in result.task.experiments] + list(result.remarks)))
    body += section("Pictures", "".join(map(_picture, pictures)))
    return document(title, f"{css} img {{max-width: 100%}}", body)


def _table(found: Sequence[tuple[str, list[str], bool]]) -> str:
    heads = [head.replace("\n", " ").strip() for head, _, _ in found]
    rows: list[Any] = list(zip(*(cells for _, cells, _ in found), strict=True))
    return table(heads, rows)


def _picture(path: Path) -> str:
    return f'<img alt="{escape(path.stem)}" src="{data_address(path.read_bytes())}">'
