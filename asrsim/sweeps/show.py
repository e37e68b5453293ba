"""What a study says on the terminal: counts, shares of claims met, quantiles of results."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

from asrsim.sweeps.sensitivity import notes
from asrsim.sweeps.table import Table, shares

HEADS = ("result", "unit", "runs", "least", "5 %", "median", "95 %", "largest", "least in", "largest in")
ROUNDING = 1e-12
"""Change of a result, relative or in SI units, that counts as rounding."""


def say_summary(table: Table) -> Iterator[str]:
    """Lines for people."""
    statuses = table.statuses()
    bad = shares(statuses)
    yield f"{table.manifest['name']}: {len(table)} of {table.manifest['runs']} runs, {statuses.get('complete', 0)} complete" + (
        f", {bad}" if bad else ""
    )
    rows = [HEADS, *result_rows(table)]
    widths = [max(len(row[i]) for row in rows) for i in range(len(HEADS))]
    if len(rows) > 1:
        for row in rows:
            cells = [row[0].ljust(widths[0]), *(cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=True))]
            yield "  " + "  ".join(cells).rstrip()
    yield from (f"  {note}" for note in notes(table, varying(table)))
    for title, share in table.claims().items():
        yield f"  {100 * share:5.1f} % meet {title}"
    if bad:
        status, reason, runs = table["status"].astype(str), table["reason"], table["run"]
        for name in ("crashed", "failed", "diverged"):
            places = (status == name).nonzero()[0]
            if len(places):
                yield f"  {name}, run {runs[places[0]]}: {reason[places[0]]}"


def result_rows(table: Table) -> list[tuple[str, ...]]:
    """What stands under :data:`HEADS`: of each result that differs its unit, count, quantiles, and runs at both ends."""
    rows = []
    for name in varying(table):
        found = table.quantiles(name)
        if found is not None:
            numbers = (found.least, found.low, found.median, found.high, found.largest)
            ends = (f"run {found.least_run}", f"run {found.largest_run}")
            rows.append((name, table.unit(name), str(found.count), *(f"{number:.4g}" for number in numbers), *ends))
    return rows


def varying(table: Table) -> list[str]:
    """Results that differ between runs by more than rounding: those of varied joints first, then by relative change."""
    varied = {part for key in table.keys for part in key.split(".")}
    found = []
    for name in table.results:
        quantiles = None if name.startswith("claim") else table.quantiles(name)
        if quantiles is None:
            continue
        change, size = quantiles.largest - quantiles.least, max(abs(quantiles.largest), abs(quantiles.least))
        if change > ROUNDING * max(1.0, size) or len(table) == 1:
            found.append((name.rpartition(".")[0] not in varied, -change / size if size else 0.0, name))
    return [name for _, _, name in sorted(found, key=lambda one: one[:2])]


def as_dict(table: Table) -> dict[str, Any]:
    """Plain values for JSON."""
    quantiles = {name: table.quantiles(name) for name in varying(table)}
    return {
        "ok": table.missing == 0,
        "runs": table.manifest["runs"],
        "rows": len(table),
        "statuses": table.statuses(),
        "claims": table.claims(),
        "notes": notes(table, list(quantiles)),
        "results": {name: asdict(found) for name, found in quantiles.items() if found is not None},
        "folder": str(table.folder),
    }
