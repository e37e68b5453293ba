"""What a study left in its folder, held against what we write: files that broke, or were edited, are told of by name."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from asrsim.confined import MEMORY, ConfinedError, run_confined
from asrsim.errors import InputError, Problem
from asrsim.extras import library
from asrsim.plain import misfit

MANIFEST = "study.json"
SHAPE = {
    "generator": str, "scenario": str, "name": str, "digest": str, "inputs": str, "versions": {"*": object}, "runs": int,
    "variants": [str], "keys": [str], "design": str, "samples": int, "seed": int, "grid": [int], "listed": [[str]],
    "drawn": [[str]], "overrides": [str], "plugins": [str], "columns": [[str]], "units": {"*": str}, "joints": [str],
    "claims": {"*": [str]}, "substeps": {"*": {"*": (int, str)}}, "settings": {"*": {"*": str}}, "rate": float,
}  # fmt: skip
"""Of the manifest."""
SECONDS, RATIO = 300.0, 16
"""Of wall clock that reading a study's rows may take, and bytes of memory for each of its files beside what all may take."""
FIRST = {"run": "int", "variant": "text", "status": "text"}
"""Columns that every study has."""
NEW_STUDY = "Make one with: asrsim sweep scenario.yaml --over KEY=VALUES"


def read_manifest(folder: Path) -> dict[str, Any]:
    """What a folder says of its study. Raises InputError where it says nothing, or what no study has."""
    path = folder / MANIFEST
    try:
        data = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError):
        raise InputError(f"holds no study ({MANIFEST})", file=folder, hint=NEW_STUDY, code="no-study") from None
    if found := misfit(data, SHAPE) or _inconsistent(data):
        raise InputError(f"is no study as asrsim writes them: {found}", file=path, hint=NEW_STUDY, code="no-study")
    return dict(data)


def _inconsistent(data: dict[str, Any]) -> str:
    """What of a manifest of the right shape does not fit the rest."""
    if any(len(column) != 2 for column in data["columns"]):
        return "a column is no pair of name and kind"
    columns = dict(data["columns"])
    if len(columns) < len(data["columns"]):
        return "two columns have one name"
    kinds = set(arrow_kinds())
    if unknown := next((kind for kind in columns.values() if kind not in kinds), None):
        return f"a column is of the kind {ascii(unknown)[:40]}"
    if missing := [name for name in (*FIRST, *data["keys"]) if name not in columns]:
        return f"it has no column {ascii(missing[0])[:60]}"
    if other := [name for name, kind in FIRST.items() if columns[name] != kind]:
        return f"its column {other[0]} is not of the kind {FIRST[other[0]]}"
    named = {"claims", "substeps", "settings"}
    if missing := [key for key in sorted(named) if set(data[key]) != set(data["variants"])]:
        return f"{missing[0]} are not those of its variants"
    if not data["variants"] or not 0.0 < data["rate"] < float("inf"):
        return "rate is out of range" if data["variants"] else "it has no variants"
    groups = [key for group in (*data["listed"], *data["drawn"]) for key in group[:1] or ("",)]
    if missing := [key for key in groups if key not in columns]:
        return f"it has no column {ascii(missing[0])[:60]}"
    claims = max(len(claims) for claims in data["claims"].values())
    return "" if all(f"claim_{i}" in columns for i in range(claims)) else "claims have no columns"


def arrow_kinds() -> dict[str, Any]:
    """Kind of a column -> Arrow's type. Raises InputError where pyarrow is not installed."""
    pa = library("pyarrow", "sweep")
    return {"int": pa.int64(), "float": pa.float64(), "bool": pa.bool_(), "text": pa.string(), "floats": pa.list_(pa.float32())}


def schema_of(columns: Sequence[Sequence[str]]) -> Any:
    """Arrow's schema of columns, pairs of name and kind."""
    kinds = arrow_kinds()
    import pyarrow as pa

    return pa.schema([(name, kinds[kind]) for name, kind in columns])


def check_rows(files: Sequence[Path], schema: Any) -> None:
    """Read files of rows once in a process of its own, whole: a stranger's file may crash Parquet's library, or be small and
    ask for all memory. Raises InputError with every file that is broken, or holds other columns.
    """
    if not files:
        return
    request = {"files": [str(path.resolve()) for path in files], "schema": bytes(schema.serialize()).hex()}
    memory = MEMORY + RATIO * sum(path.stat().st_size for path in files)
    try:
        answer = run_confined(Path(__file__).with_name("rows_child.py"), request, seconds=SECONDS, memory=memory)
        found = [(files[number], fault) for number, fault in json.loads(answer)]
    except ConfinedError as error:
        found = [(files[0] if len(files) == 1 else files[0].parent, f"cannot be read: reading rows {error}")]
    if found:
        hint = "Take it away: its runs are then done again by --resume"
        raise InputError([Problem(fault, file=path, hint=hint, code="sweep-part") for path, fault in found])


def read_rows(path: Path, **options: Any) -> Any:
    """A table of rows that :func:`check_rows` has read before; options: of `pyarrow.parquet.read_table`."""
    import pyarrow.parquet as pq

    return pq.read_table(path, **options)
