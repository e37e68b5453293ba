"""What a study left in its folder, held against what we write: files that broke, or were edited, are told of by name."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any

from asrsim.confined import MEMORY, ConfinedError, run_confined
from asrsim.errors import InputError, Problem
from asrsim.extras import library

MANIFEST = "study.json"
SECONDS, RATIO = 300.0, 16
"""Of wall clock that reading a study's rows may take, and bytes of memory for each of its files beside what all may take."""
NEW_STUDY = "Make one with: asrsim sweep scenario.yaml --over KEY=VALUES"


def read_manifest(folder: Path) -> dict[str, Any]:
    """What a folder says of its study. Raises InputError where it says nothing, or what no study has."""
    path = folder / MANIFEST
    try:
        data = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError):
        raise InputError(f"holds no study ({MANIFEST})", file=folder, hint=NEW_STUDY, code="no-study") from None
    if not isinstance(data, dict) or data.pop("seal", None) != _seal(data):
        raise InputError("is no study as asrsim wrote it: its seal is another", file=path, hint=NEW_STUDY, code="no-study")
    return data


def sealed(manifest: Mapping[str, Any]) -> str:
    """A manifest as text, with the seal by which an edited one is known."""
    data = json.loads(json.dumps(manifest, default=str))
    return json.dumps({**data, "seal": _seal(data)}, indent=1) + "\n"


def _seal(data: Mapping[str, Any]) -> str:
    return sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()


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
