"""Folder of a study: its description `study.json`, and the rows of its runs. While the study runs, the rows are in several
files, called parts; at the end they are in one file. A killed program loses only the rows of the last seconds. Files of rows
are checked before they are read.

A part is written under a temporary name and then renamed, so that it is never incomplete. Runs without a row are simulated when
the study continues.
"""

from __future__ import annotations

import json
import os
import re
import time as clock
from collections.abc import Mapping, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.confined.run import MEMORY, ConfinedError, run_confined
from asrsim.errors import InputError, OutputError, Problem
from asrsim.extras import library
from asrsim.outfile import is_ours, make_folder, write_text, written
from asrsim.plain import misfit
from asrsim.renamed import STUDY_KEYS
from asrsim.sweeps.rows import StudyRow

MANIFEST, ROWS = "study.json", "rows.parquet"
SECONDS, RATIO = 300.0, 16
"""Limits of the check of the files of rows. SECONDS: time in s; RATIO: memory in bytes per byte of the files."""
NEW_STUDY = "Make one with: asrsim sweep scenario.yaml --over KEY=VALUES"
KINDS = ("int", "float", "bool", "text")
"""Kinds of columns, by the type of their cells."""
MANIFEST_SHAPE: dict[str, Any] = {
    "scenario": str,
    "plugins": [str],
    "study": {"variants": [str], "*": object},
    "inputs": object,
    "versions": object,
    "runs": int,
    "columns": [[str]],
    "claims": {"*": [str]},
    "substeps": {"*": {"*": int}},
    "*": object,
}
"""Structure of `study.json`, in the form that `asrsim.plain.misfit` checks."""
GROUP = 20_000
"""Number of rows in a row group of a file of rows. Waiting rows are written when their number reaches this number. A part with
this number of rows is full.
"""
PATIENCE = 3.0
"""Interval at which waiting rows are written, s. A killed program loses at most the rows of one interval."""
MOST_PARTS = 32
"""Number of parts that are not full at which these parts are merged to one part."""
SAME = {
    "format": "it was written by another version of asrsim",
    "study": "its study has other values of",
    "inputs": "its inputs have changed:",
    "versions": "it was done with other versions of",
}
"""Entries of `study.json` that must not have changed when a study continues, each with the beginning of the message for a
changed entry. The names of what has changed follow this beginning.
"""


def read_manifest(folder: Path) -> dict[str, Any]:
    """Description of a study. Raises InputError if `study.json` is missing or was edited."""
    path = folder / MANIFEST
    try:
        data = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError):
        raise InputError(f"contains no study ({MANIFEST})", file=folder, hint=NEW_STUDY, code="no-study") from None
    if not isinstance(data, dict) or data.pop("seal", None) != _seal(data):
        raise InputError("was changed after asrsim wrote it: the checksum differs", file=path, hint=NEW_STUDY, code="no-study")
    wrong = misfit(data, MANIFEST_SHAPE)
    if not wrong and not all(len(column) == 3 and column[1] in KINDS for column in data["columns"]):
        wrong = "each column needs a name, a valid type and a unit"
    # Check the structure even if the checksum is right, since a checksum can be forged.
    if wrong:
        raise InputError(f"does not describe a study: {wrong}", file=path, hint=NEW_STUDY, code="no-study")
    # Replace the names of keys that earlier versions of asrsim wrote by the present names.
    return {**data, "study": {STUDY_KEYS.get(name, name): value for name, value in data["study"].items()}}


def sealed(manifest: Mapping[str, Any]) -> str:
    """Description of a study as the text of `study.json`, with a checksum that reveals later edits."""
    data = json.loads(json.dumps(manifest, default=str))
    return json.dumps({**data, "seal": _seal(data)}, indent=1) + "\n"


def _seal(data: Mapping[str, Any]) -> str:
    return sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()


def schema_of(columns: Sequence[Sequence[str]]) -> Any:
    """Arrow schema of (name, kind, unit) columns. Raises InputError if pyarrow is not installed."""
    pa = library("pyarrow", "sweep")
    kinds = dict(zip(KINDS, (pa.int64(), pa.float64(), pa.bool_(), pa.string()), strict=True))
    return pa.schema([(name, kinds[kind]) for name, kind, _ in columns])


def parts_of(folder: Path) -> list[Path]:
    """Parts of the rows: files of the folder with the name of a part, sorted. Files with similar names are left out."""
    return sorted(path for path in folder.glob("part-*.parquet") if re.fullmatch(r"part-[0-9]{6,9}\.parquet", path.name))


def checked_files(folder: Path, schema: Any, *, checked: bool = False) -> list[Path]:
    """Files of rows in a study's folder, after a check. In the check, a separate process reads the files once, since a foreign
    file may crash the Parquet library or exhaust the memory. Raises InputError with every file that is broken or lacks the
    study's columns.

    checked: whether the check is skipped, since this process has already checked or written the files.
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


class Store:
    """Rows of a study in a folder, written as they arrive."""

    def __init__(self, folder: Path, columns: Sequence[Sequence[str]], total: int) -> None:
        """Open the folder. Raises InputError if a file of rows is broken."""
        self.folder, self.total = folder, total
        self._schema = schema_of(columns)
        self._waiting: list[StudyRow] = []
        self._written = clock.monotonic()
        self.done = np.zeros(total, bool)
        """Whether each run has a row (total,), either in a file or waiting to be written."""
        files = checked_files(folder, self._schema)
        runs = read_rows(files, self._schema, columns=["run"])["run"].to_numpy()
        if len(runs) and not 0 <= runs.min() <= runs.max() < total:
            raise InputError(f"contains rows of runs beyond the study's {total}", file=folder, code="sweep-part")
        self.done[runs] = True
        self._part = 1 + max((int(path.stem.rpartition("-")[2]) for path in parts_of(folder)), default=0)
        self._small = parts_of(folder)
        """Parts that may contain fewer than `GROUP` rows."""

    @property
    def missing(self) -> list[int]:
        """Runs without a row, in order."""
        return np.flatnonzero(~self.done).tolist()

    def add(self, rows: Sequence[StudyRow]) -> list[StudyRow]:
        """Add rows of runs that have no row yet, and return these rows. Raises OutputError."""
        new = []
        for row in rows:
            if not self.done[row[0]]:
                self.done[row[0]] = True
                new.append(row)
        self._waiting += new
        if len(self._waiting) >= GROUP or clock.monotonic() - self._written > PATIENCE:
            self.write()
        return new

    def write(self) -> None:
        """Write the waiting rows. Raises OutputError."""
        import pyarrow as pa

        self._written = clock.monotonic()
        if not self._waiting:
            return
        rows = sorted(self._waiting, key=lambda row: row[0])
        self._add_part(pa.table([list(column) for column in zip(*rows, strict=True)], schema=self._schema))
        self._waiting = []
        if len(self._small) >= MOST_PARTS:
            self._merge()

    def _add_part(self, table: Any) -> None:
        path = self.folder / f"part-{self._part:06d}.parquet"
        self._save(path, table)
        self._part += 1
        if len(table) < GROUP:
            self._small.append(path)

    def _merge(self) -> None:
        """Write the rows of the parts that are not full as one part, and remove these parts, so that a study of days has few
        files. If the program is killed before the removal, some rows are stored twice, which readers accept. Raises
        OutputError.
        """
        small, self._small = self._small, []
        rows = read_rows(small, self._schema)
        self._add_part(rows.take(np.unique(rows["run"].to_numpy(), return_index=True)[1]))
        for part in small:
            part.unlink(missing_ok=True)

    def finish(self) -> None:
        """Write the waiting rows; if no run is missing, write all rows as one file. Raises OutputError."""
        self.write()
        parts, path = parts_of(self.folder), self.folder / ROWS
        if self.done.all() and (parts or not path.exists()):
            rows = read_rows(checked_files(self.folder, self._schema, checked=True), self._schema)
            self._save(path, rows.take(np.unique(rows["run"].to_numpy(), return_index=True)[1]))
            for part in parts:
                part.unlink(missing_ok=True)

    def _save(self, path: Path, table: Any) -> None:
        import pyarrow.parquet as pq

        try:
            # Replace a file without a check of its origin, since the study's description shows that asrsim wrote the folder.
            with written(path, "rows", replace=True) as stream:
                options = {"compression": "zstd", "write_page_checksum": True, "row_group_size": GROUP}
                pq.write_table(table, stream, **options)
                stream.flush()
                os.fsync(stream.fileno())
        except OutputError as error:
            count = int(self.done.sum()) - len(self._waiting)
            raise OutputError(f"{error}; {count} rows are kept; continue with --resume") from error


def _differences(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """Differences between the study in a folder (`before`) and the study to run (`now`), with the names of changed inputs."""
    found: list[str] = []
    for key, message in SAME.items():
        old, new = before.get(key), now[key]
        if old == new:
            continue
        # The hashes of inputs are grouped by variant. Compare each variant, and name the inputs whose hashes differ.
        parts = [(before[key].get(one, {}), new[one]) for one in new] if key == "inputs" else [(old, new)]
        pairs = [(a, b) for a, b in parts if isinstance(a, dict) and isinstance(b, dict)]
        names = dict.fromkeys(name for a, b in pairs for name in {**a, **b} if a.get(name) != b.get(name))
        found.append(f"{message} {', '.join(names)}" if names else message)
    return found


def open_store(folder: Path, manifest: Mapping[str, Any], *, resume: bool, overwrite: bool) -> Store:
    """Store for the rows of a study in its folder. Raises InputError if the folder contains rows and neither `resume` nor
    `overwrite` is given, or if `resume` is given and the rows belong to another study.
    """
    known = folder / MANIFEST
    rows = (folder / ROWS).exists() or bool(parts_of(folder))
    # A study that ended before its first row, for example because no scheduler answered, may be replaced without `overwrite`.
    begun = rows or (resume and known.exists())
    if (rows or known.exists()) and not is_ours(known, "json"):
        message = "contains rows without the description of their study (study.json)"
        raise InputError(message, file=folder, hint="Choose another folder with --out", code="sweep-folder")
    if begun and not (resume or overwrite):
        hint = "Continue with --resume, start again with --overwrite, or choose another folder with --out"
        raise InputError("contains rows of a study", file=folder, hint=hint, code="sweep-folder")
    going_on = begun and resume
    if going_on:
        before, now = read_manifest(folder), json.loads(json.dumps(manifest, default=str))
        if differences := _differences(before, now):
            hint = "Start again with --overwrite, or choose another folder with --out"
            message = f"cannot be continued: {'; '.join(differences)}"
            raise InputError(Problem(message, file=folder, hint=hint, code="sweep-resume"))
    make_folder(folder)
    left = [*folder.glob(".part-*.new"), *([] if going_on else [*parts_of(folder), folder / ROWS])]
    for path in left:
        path.unlink(missing_ok=True)
    store = Store(folder, manifest["columns"], manifest["runs"])
    if not going_on:
        write_text(known, sealed(manifest), "json")
    return store
