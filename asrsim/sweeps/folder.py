"""Folder of a study: its description `study.json`, and its files of rows, which are checked before they are read."""

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
"""Time limit of the check of the rows, s, and its memory limit in bytes per byte of the files."""
NEW_STUDY = "Make one with: asrsim sweep scenario.yaml --over KEY=VALUES"


def read_manifest(folder: Path) -> dict[str, Any]:
    """Description of a study. Raises InputError if `study.json` is missing or was edited."""
    path = folder / MANIFEST
    try:
        data = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError):
        raise InputError(f"contains no study ({MANIFEST})", file=folder, hint=NEW_STUDY, code="no-study") from None
    if not isinstance(data, dict) or data.pop("seal", None) != _seal(data):
        raise InputError("was changed after asrsim wrote it: the checksum differs", file=path, hint=NEW_STUDY, code="no-study")
    return data


def sealed(manifest: Mapping[str, Any]) -> str:
    """Description as text, with a checksum that reveals later edits."""
    data = json.loads(json.dumps(manifest, default=str))
    return json.dumps({**data, "seal": _seal(data)}, indent=1) + "\n"


def _seal(data: Mapping[str, Any]) -> str:
    return sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()


def schema_of(columns: Sequence[Sequence[str]]) -> Any:
    """Arrow schema of (name, kind, unit) columns. Raises InputError if pyarrow is not installed."""
    pa = library("pyarrow", "sweep")
    kinds = {
        "int": pa.int64(),
        "float": pa.float64(),
        "bool": pa.bool_(),
        "text": pa.string(),
    }
    return pa.schema([(name, kinds[kind]) for name, kind, _ in columns])


def parts_of(folder: Path) -> list[Path]:
    """Files of the folder that each contain a part of the rows, sorted."""
    return sorted(folder.glob("part-*.parquet"))


def checked_files(folder: Path, schema: Any, *, checked: bool = False) -> list[Path]:
    """Files of rows, checked. The files are read once in a separate process, since a foreign file may crash the Parquet library
    or exhaust the memory. Raises InputError with every file that is broken or has other columns.

    checked: this process has checked or written the files already.
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
        hint = "Remove the file: --resume then repeats its runs"
        raise InputError([Problem(fault, file=path, hint=hint, code="sweep-part") for path, fault in faults])
    return files


def read_rows(files: Sequence[Path], schema: Any, **options: Any) -> Any:
    """Rows of checked files as a pyarrow.Table; options: arguments of `pyarrow.dataset.Dataset.to_table`."""
    import pyarrow.dataset as ds

    return (
        ds.dataset(list(map(str, files)), schema=schema, format="parquet").to_table(**options)
        if files
        else schema.empty_table()
    )
