"""The folder of a study: its description `study.json`, and files of rows, checked before they are read."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any

from asrsim.confined import MEMORY, ConfinedError, run_confined
from asrsim.errors import InputError, Problem
from asrsim.extras import library

MANIFEST, ROWS = "study.json", "rows.parquet"
SECONDS, RATIO = 300.0, 16
"""Longest time of checking the rows of a study in s, and its memory in bytes for each byte of their files."""
NEW_STUDY = "Make one with: asrsim sweep scenario.yaml --over KEY=VALUES"


def read_manifest(folder: Path) -> dict[str, Any]:
    """The description of a study. Raises InputError where there is none, or somebody edited it."""
    path = folder / MANIFEST
    try:
        data = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError):
        raise InputError(f"holds no study ({MANIFEST})", file=folder, hint=NEW_STUDY, code="no-study") from None
    if not isinstance(data, dict) or data.pop("seal", None) != _seal(data):
        raise InputError("is no study as asrsim wrote it: its seal is another", file=path, hint=NEW_STUDY, code="no-study")
    return data


def sealed(manifest: Mapping[str, Any]) -> str:
    """A description as text, with a seal that shows later edits."""
    data = json.loads(json.dumps(manifest, default=str))
    return json.dumps({**data, "seal": _seal(data)}, indent=1) + "\n"


def _seal(data: Mapping[str, Any]) -> str:
    return sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()


def schema_of(columns: Sequence[Sequence[str]]) -> Any:
    """Arrow's schema of (name, kind, unit) columns. Raises InputError where pyarrow is not installed."""
    pa = library("pyarrow", "sweep")
    kinds = {
        "int": pa.int64(),
        "float": pa.float64(),
        "bool": pa.bool_(),
        "text": pa.string(),
        "floats": pa.list_(pa.float32()),
    }
    return pa.schema([(name, kinds[kind]) for name, kind, _ in columns])


def parts_of(folder: Path) -> list[Path]:
    """Files with some of the rows, in their order."""
    return sorted(folder.glob("part-*.parquet"))


def checked_files(folder: Path, schema: Any, *, checked: bool = False) -> list[Path]:
    """All files of rows. They are read once in a process of its own, since a foreign file may crash Parquet's library or
    fill the memory. Raises InputError with every file that is broken or has other columns.

    checked: this process has checked or written them.
    """
    files = [path for path in [folder / ROWS, *parts_of(folder)] if path.exists()]
    if checked or not files:
        return files
    request = {"files": [str(path.resolve()) for path in files], "schema": bytes(schema.serialize()).hex()}
    memory = MEMORY + RATIO * sum(path.stat().st_size for path in files)
    try:
        answer = run_confined(Path(__file__).with_name("rows_child.py"), request, seconds=SECONDS, memory=memory)
        faults = [(files[number], fault) for number, fault in json.loads(answer)]
    except ConfinedError as error:
        faults = [(files[0] if len(files) == 1 else folder, f"cannot be read: reading rows {error}")]
    if faults:
        hint = "Take it away: its runs are then done again by --resume"
        raise InputError([Problem(fault, file=path, hint=hint, code="sweep-part") for path, fault in faults])
    return files


def read_rows(files: Sequence[Path], schema: Any, **options: Any) -> Any:
    """A pyarrow.Table of checked files; options: of `pyarrow.dataset.Dataset.to_table`."""
    import pyarrow.dataset as ds

    return (
        ds.dataset(list(map(str, files)), schema=schema, format="parquet").to_table(**options)
        if files
        else schema.empty_table()
    )
