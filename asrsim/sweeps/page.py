"""A study as one HTML page with everything in it: tables and pictures; small whatever the study's size."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from html import escape
from importlib.resources import files
from io import BytesIO
from pathlib import Path
from typing import Any

from asrsim.actuators.user import plugin_options
from asrsim.outfile import write_text
from asrsim.plots.output import styled
from asrsim.report.html import bullets, data_address, document, number, section, table
from asrsim.sweeps.pictures import chosen_results, figures
from asrsim.sweeps.sensitivity import Index, influences, notes
from asrsim.sweeps.show import HEADS, result_rows
from asrsim.sweeps.table import Table, shares

DPI = 110
"""Dots per inch of the page's pictures."""


def write_page(study: Table, path: Path | None = None, results: Sequence[str] = ()) -> Path:
    """Write `report.html` into the study's folder; results: see :func:`chosen_results`. Raises OutputError, InputError."""
    path = path or study.folder / "report.html"
    write_text(path, make_page(study, results), "page")
    return path


def make_page(study: Table, drawn: Sequence[str] = ()) -> str:
    """The page as text; drawn: results in its pictures, if not the first."""
    rows = result_rows(study)
    shown = chosen_results(study, drawn)
    with styled(mathematics=False):
        pictures = "".join(_picture(figure) for figure in figures(study, shown).values())
    title = f"{study.manifest['name']}: {len(study)} runs"
    css = files("asrsim.report").joinpath("assets/page.css").read_text(encoding="utf-8")
    body = f"<h1>{escape(title)}</h1>{_head(study)}"
    body += section("Results", table(HEADS, rows) if rows else "<p>No result differs between the runs.</p>")
    if study.claims():
        body += section("Claims", bullets(f"{100 * share:.1f} % meet {title}" for title, share in study.claims().items()))
    body += section("What moves the results", _influences(study, shown)) + section("Pictures", pictures)
    return document(title, css + " pre {white-space: pre-wrap} img {max-width: 100%}", body)


def _head(study: Table) -> str:
    manifest, statuses = study.manifest, study.statuses()
    items = [
        f"scenario {manifest['scenario']}, variants {', '.join(manifest['variants'])}",
        f"varied: {', '.join(study.keys)}; design {manifest['design']}, seed {manifest['seed']}",
        f"{statuses.get('complete', 0)} runs complete" + (f", {shares(statuses)}" if shares(statuses) else ""),
    ]
    again = shlex.join(["asrsim", "sweep", str(study.folder), *plugin_options(study.manifest["plugins"]), "--run"])
    items.append(f"a run again, with its log: {again} N")
    if study.missing:
        items.append(f"{study.missing} runs are missing: asrsim sweep --resume does them")
    return bullets(items)


def _influences(study: Table, results: list[str]) -> str:
    rows = [
        (name, one.key, number(one.rank), number(one.low), number(one.high), *_shares(one.sobol))
        for name in results
        for one in influences(study, name)[:8]
    ]
    heads = ("result", "key", "rank correlation", "mean, key low", "mean, key high", "Sobol, first", "Sobol, total")
    said = notes(study, results)
    return (table(heads, rows) if rows else "<p>Too few runs to say.</p>") + (bullets(said) if said else "")


def _shares(index: Index | None) -> tuple[str, str]:
    """Sobol indices with their intervals."""
    if index is None:
        return "", ""
    return f"{index.first:.3f} ± {index.first_error:.3f}", f"{index.total:.3f} ± {index.total_error:.3f}"


def _picture(figure: Any) -> str:
    stream = BytesIO()
    figure.savefig(stream, format="png", dpi=DPI)
    return f'<img alt="" src="{data_address(stream.getvalue())}">'
