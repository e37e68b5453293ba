"""Page about a study: results over the varied keys, influences of the keys, Sobol indices, claims, and extreme runs."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from html import escape
from pathlib import Path

from asrsim.plots import style
from asrsim.report.charts import page_data
from asrsim.report.html import bullets, section, table
from asrsim.report.page import HINT, NO_SCRIPT, page_html, plots
from asrsim.sweeps.pictures import over_key
from asrsim.sweeps.sensitivity import Influence, influences, numeric_keys
from asrsim.sweeps.show import HEADS, remarks, result_rows, study_headline, varying
from asrsim.sweeps.table import Table

MOST = 24
"""Largest number of results that the page draws over the keys."""
RANKED = 8
"""Largest number of results for which the page lists influences and extreme runs."""


def study_page(folder: Path) -> str:
    """HTML of the page about the study in a folder. Raises InputError."""
    study = Table(folder)
    results = varying(study)
    drawn = [over_key(study, name) for name in results[:MOST]] if numeric_keys(study) else []
    sections = [
        _claims(study),
        _over_keys(len(drawn), len(results)) if drawn else "",
        _influences(study, results[:RANKED]),
        _rows(study, results[:RANKED]),
        _results(study),
        _keys(study),
    ]
    head = f"<p>{escape(study_headline(study))}</p>"
    return page_html(f"Study {study.study.name}", sections, head=head, data=page_data([("results", drawn)]))


def _claims(study: Table) -> str:
    return section("Claims and remarks", bullets(text.strip() for text in remarks(study))) if [*remarks(study)] else ""


def _over_keys(count: int, every: int) -> str:
    left = f"<p class='note'>{count} of {every} results that vary.</p>" if count < every else ""
    return section("Results over the keys", HINT + left + plots(0) + NO_SCRIPT)


def _influences(study: Table, results: Sequence[str]) -> str:
    """Section with the mean of each result over the runs with the lowest and with the highest fifth of each key's values, and
    with Sobol indices and their 95 % intervals.
    """
    parts = []
    for name in results:
        found = influences(study, name)
        if len(numeric_keys(study)) < 2 or not found:
            continue
        rows = [_influence(study, one) for one in found[:12]]
        heads = ["key", "mean, key in lowest fifth", "highest fifth", "S first order", "S total", ""]
        parts.append(f"<h3>{escape(_words(study, name))}</h3>{table(heads, rows, raw=(5,))}")
    note = (
        "<p class='note'>First order: share of the variance that the key explains alone; total: with all its interactions; "
        "± is half the 95 % interval (bootstrap).</p>"
    )
    sobol = any("±" in part for part in parts)
    return section("Influence of the keys", (note if sobol else "") + "".join(parts)) if parts else ""


def _influence(study: Table, one: Influence) -> list[str]:
    first = total = bar = ""
    if one.sobol is not None:
        first = f"{one.sobol.first:z.2f} ± {one.sobol.first_error:.2f}"
        total = f"{one.sobol.total:z.2f} ± {one.sobol.total_error:.2f}"
        bar = _bar(one.sobol.first, one.sobol.first_error, style.BLUE)
        bar += _bar(one.sobol.total, one.sobol.total_error, style.GREY)
    return [_words(study, one.key), f"{one.low:.4g}", f"{one.high:.4g}", first, total, bar]


def _bar(value: float, error: float, colour: str) -> str:
    """HTML of a Sobol index from 0 to 1 as a bar, with its 95 % interval as a line. error: half-width of the interval."""
    width, low, high = (min(max(150.0 * share, 0.0), 170.0) for share in (value, value - error, value + error))
    return (
        f'<svg width="172" height="9" style="display:block" aria-hidden="true"><rect y="1" width="{width:.1f}" height="7" '
        f'fill="{colour}"/><line x1="{low:.1f}" x2="{high:.1f}" y1="4.5" y2="4.5" stroke="currentColor"/></svg>'
    )


def _rows(study: Table, results: Sequence[str]) -> str:
    """Section with the runs in which each result is smallest and largest, and with the command that repeats one of them."""
    keys = list(study.keys)
    place = {int(run): n for n, run in enumerate(study["run"].tolist())}
    rows = []
    for name in results:
        found = study.quantiles(name)
        if found is None:
            continue
        for words, run, value in (("least", found.least_run, found.least), ("largest", found.largest_run, found.largest)):
            values = [_shown(study[key][place[run]]) for key in keys]
            rows.append([_words(study, name), words, f"{value:.5g}", str(run), *values])
    if not rows:
        return ""
    folder = shlex.quote(str(study.folder))
    number = int(rows[0][3])
    commands = (
        f"asrsim sweep {folder} --run {number}\nasrsim view {folder}/run_{number:06d}/log.mcap\n"
        f"asrsim report {folder}/run_{number:06d}"
    )
    text = "<p>A row is run again with a log, which <code>view</code> and <code>report</code> open:</p>"
    heads = ["result", "", "value", "run", *(_words(study, key) for key in keys)]
    return section("Best and worst rows", f"{table(heads, rows)}{text}<pre>{escape(commands)}</pre>")


def _shown(value: object) -> str:
    return f"{value:.5g}" if isinstance(value, float) else str(value)


def _results(study: Table) -> str:
    rows = result_rows(study)
    return section("Results", table(HEADS, rows)) if rows else ""


def _keys(study: Table) -> str:
    rows = [[key, study.unit(key), text] for key, text in _varied(study)]
    path = shlex.quote(str(study.study.scenario))
    return section("Varied keys", f"{table(['key', 'unit', 'values'], rows)}<p class='note'>Scenario: {escape(path)}</p>")


def _varied(study: Table) -> list[tuple[str, str]]:
    found = []
    for key in study.keys:
        values = study[key]
        if study.kinds[key] == "float":
            found.append((key, f"{values.min():.5g} to {values.max():.5g}"))
        else:
            found.append((key, ", ".join(map(str, dict.fromkeys(values.astype(str).tolist())))))
    return found


def _words(study: Table, name: str) -> str:
    unit = study.unit(name).removeprefix("1")
    return f"{style.in_words(name)} ({unit})" if unit else style.in_words(name)
