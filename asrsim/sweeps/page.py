"""Study as one HTML page with tables and pictures; its size does not grow with the number of runs."""

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
from asrsim.sweeps.pictures import MOST, figures
from asrsim.sweeps.sensitivity import influences, notes
from asrsim.sweeps.show import HEADS, chosen_results, result_rows
from asrsim.sweeps.table import Table, shares

DPI = 110
"""Resolution of the page's pictures, dots per inch."""


def write_page(study: Table, results: Sequence[str] = ()) -> Path:
    """Write `report.html` into the study's folder, with pictures of the named results (default: the first that vary), and
    return its path. Raises OutputError, InputError.
    """
    rows, shown = result_rows(study), chosen_results(study, results, MOST)
    with styled(mathematics=False):
        pictures = "".join(map(_picture, figures(study, shown).values()))
    title = f"{study.study.name}: {len(study)} runs"
    css = files("asrsim.report").joinpath("assets/page.css").read_text(encoding="utf-8")
    body = f"<h1>{escape(title)}</h1>{_head(study)}"
    body += section("Results", table(HEADS, rows) if rows else "<p>No result differs between the runs.</p>")
    if study.claims():
        body += section("Claims", bullets(f"{100 * share:.1f} % meet {title}" for title, share in study.claims().items()))
    body += section("Influences", _influences(study, shown)) + section("Pictures", pictures)
    path = study.folder / "report.html"
    write_text(path, document(title, css + " pre {white-space: pre-wrap} img {max-width: 100%}", body), "page")
    return path


def _head(table: Table) -> str:
    study, statuses = table.study, table.statuses()
    bad = shares(statuses)
    again = shlex.join(["asrsim", "sweep", str(table.folder), *plugin_options(table.manifest["plugins"]), "--run"])
    items = [
        f"scenario {study.scenario}, variants {', '.join(study.variants)}",
        f"varied: {', '.join(study.keys)}; design {study.design if study.groups else 'grid'}, seed {study.seed}",
        f"{statuses.get('complete', 0)} runs complete" + (f", {bad}" if bad else ""),
        f"to repeat run N with a log: {again} N",
    ]
    if table.missing:
        items.append(f"{table.missing} runs are missing: complete them with asrsim sweep --resume")
    return bullets(items)


def _influences(study: Table, results: Sequence[str]) -> str:
    rows = []
    for name in results:
        for one in influences(study, name)[:8]:
            index = one.sobol
            first = f"{index.first:.3f} ± {index.first_error:.3f}" if index else ""
            total = f"{index.total:.3f} ± {index.total_error:.3f}" if index else ""
            rows.append((name, one.key, number(one.rank), number(one.low), number(one.high), first, total))
    heads = ("result", "key", "rank correlation", "mean, key low", "mean, key high", "Sobol, first", "Sobol, total")
    return (table(heads, rows) if rows else "<p>There are too few runs.</p>") + bullets(notes(study, results))


def _picture(figure: Any) -> str:
    stream = BytesIO()
    figure.savefig(stream, format="png", dpi=DPI)
    return f'<img alt="" src="{data_address(stream.getvalue())}">'
