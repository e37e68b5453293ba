"""Results of a study as text: counts, quantiles of results, fractions of runs that satisfy the claims."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import Any

from asrsim.errors import InputError, Problem
from asrsim.quantities import prefixed
from asrsim.sweeps.sensitivity import notes, sobol
from asrsim.sweeps.table import Table, shares

HEADS = ("result", "unit", "runs", "least", "5 %", "median", "95 %", "largest", "least in", "largest in")
ROUNDING = 1e-12
"""Difference of a result between runs, relative or in SI units, up to which the difference counts as rounding error."""
SHARE = 0.1
"""Results that exist in fewer than this fraction of the runs are listed last."""


def study_headline(table: Table) -> str:
    """Name of the study, and its numbers of runs by status."""
    statuses = table.statuses()
    parts = f"{len(table)} of {table.manifest['runs']} runs", f"{statuses.get('complete', 0)} complete", shares(statuses)
    return f"{table.study.name}: {', '.join(filter(None, parts))}"


def remarks(table: Table) -> Iterator[str]:
    """Lines of text about Sobol indices, claims, and runs that did not complete."""
    yield from notes(table, varying(table))
    yield from (f"{100 * share:5.1f} % meet {title}" for title, share in table.claims().items())
    for name in ("crashed", "failed", "diverged"):
        places = (table["status"].astype(str) == name).nonzero()[0]
        if len(places):
            yield f"{name}, run {table['run'][places[0]]}: {table['reason'][places[0]]}"


def result_rows(table: Table, results: Sequence[str] = ()) -> list[tuple[str, ...]]:
    """Rows of the table of results, one for each named result, or without names for each result that varies; `HEADS`
    contains the headings of the columns.
    """
    rows = []
    for name in results or varying(table):
        found = table.quantiles(name)
        if found is not None:
            numbers = (found.least, found.low, found.median, found.high, found.largest)
            ends = (f"run {found.least_run}", f"run {found.largest_run}")
            scale, unit = prefixed(numbers, table.unit(name))
            rows.append((table.label(name), unit, str(found.count), *(f"{scale * number:.4g}" for number in numbers), *ends))
    return rows


def varying(table: Table) -> list[str]:
    """Results that differ between runs by more than rounding errors. Results of joints with a varied key come before other
    results. Results with larger relative differences come before results with smaller relative differences. Results that few
    runs have come last.
    """
    varied = {part for key in table.keys for part in key.split(".")}
    found = []
    for name in table.results:
        quantiles = None if name.startswith("claim") else table.quantiles(name)
        if quantiles is None:
            continue
        change, size = quantiles.largest - quantiles.least, max(abs(quantiles.largest), abs(quantiles.least))
        if change > ROUNDING * max(1.0, size) or len(table) == 1:
            rare = quantiles.count < SHARE * len(table)
            found.append((rare, name.rpartition(".")[0] not in varied, -change / size if size else 0.0, name))
    return [name for *_, name in sorted(found, key=lambda one: one[:3])]


def chosen_results(table: Table, results: Sequence[str], most: int) -> list[str]:
    """Results with the given names; without names, the first `most` results that vary. Raises InputError for unknown results,
    and for results that no run has.
    """
    for name in results:
        if name not in table.results:
            raise InputError(
                Problem("is not a result of this study", key=name, choices=table.results, meant=name, code="result")
            )
        if table.quantiles(name) is None:
            raise InputError("no run has a value of this result", key=name, code="result")
    return list(results) or varying(table)[:most]


def study_data(table: Table, results: Sequence[str] = ()) -> dict[str, Any]:
    """The study and its results as data for JSON. results: names of the results; by default, the results that vary."""
    names = list(results) or varying(table)
    found = {name: sobol(table, name) for name in names}
    quantiles = {name: table.quantiles(name) for name in names}
    return {
        "ok": table.missing == 0,
        "runs": table.manifest["runs"],
        "rows": len(table),
        "statuses": table.statuses(),
        "claims": table.claims(),
        "notes": notes(table, names),
        "sobol": {
            name: {key: index._asdict() for key, index in own.indices.items()} for name, own in found.items() if own is not None
        },
        "results": {name: asdict(found) for name, found in quantiles.items() if found is not None},
        "folder": str(table.folder),
    }
