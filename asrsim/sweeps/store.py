"""Writes the rows of a study: parts while runs end, one file at the end. A killed program loses at most the last seconds.

A part is written beside its place and moved there, so that it is whole or missing. Runs without a row are done again.
"""

from __future__ import annotations

import json
import os
import time as clock
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.errors import InputError, OutputError, Problem
from asrsim.outfile import is_ours, make_folder, write_text, written
from asrsim.sweeps.folder import MANIFEST, ROWS, checked_files, parts_of, read_manifest, read_rows, schema_of, sealed
from asrsim.sweeps.rows import Row

GROUP = 20_000
"""Rows of a group of the whole file, and the most of a part."""
PATIENCE = 3.0
"""s after which rows are written: a killed program loses at most these."""
SAME = {
    "study": "its study varies other things", "inputs": "its scenario, robot or other files have changed",
    "versions": "it was done with other versions", "columns": "its rows have other columns",
}  # fmt: skip
"""Entry of a description that must be the same when a study goes on -> what differs otherwise."""


class Store:
    """A folder of rows that grows."""

    def __init__(self, folder: Path, columns: Sequence[Sequence[str]], total: int) -> None:
        """Raises InputError where a file of rows is broken."""
        self.folder, self.total = folder, total
        self._schema = schema_of(columns)
        self._waiting: list[Row] = []
        self._written = clock.monotonic()
        self.done = np.zeros(total, bool)
        """Runs that have a row, written or waiting."""
        files = checked_files(folder, self._schema)
        runs = read_rows(files, self._schema, columns=["run"])["run"].to_numpy()
        if len(runs) and not 0 <= runs.min() <= runs.max() < total:
            raise InputError(f"has rows of runs beyond the study's {total}", file=folder, code="sweep-part")
        self.done[runs] = True
        self._part = 1 + max((int(path.stem.rpartition("-")[2]) for path in parts_of(folder)), default=0)

    @property
    def missing(self) -> list[int]:
        """Runs without a row, in order."""
        return np.flatnonzero(~self.done).tolist()

    def add(self, rows: Sequence[Row]) -> list[Row]:
        """Take rows; returns those of runs that had none yet. Raises OutputError."""
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
        table = pa.table([list(column) for column in zip(*rows, strict=True)], schema=self._schema)
        self._save(self.folder / f"part-{self._part:06d}.parquet", [table])
        self._waiting, self._part = [], self._part + 1

    def finish(self) -> None:
        """Write the waiting rows, and where no run is missing all rows as one file. Raises OutputError."""
        self.write()
        parts, path = parts_of(self.folder), self.folder / ROWS
        if self.done.all() and (parts or not path.exists()):
            self._save(path, self._sorted())
            for part in parts:
                part.unlink(missing_ok=True)

    def _sorted(self) -> Iterator[Any]:
        """Tables of at most a group, in the order of the runs, each run once."""
        import pyarrow.compute as pc

        files = checked_files(self.folder, self._schema, checked=True)
        for first in range(0, self.total, GROUP):
            run = pc.field("run")
            table = read_rows(files, self._schema, filter=(run >= first) & (run < first + GROUP))
            yield table.take(np.unique(table["run"].to_numpy(), return_index=True)[1])

    def _save(self, path: Path, tables: Iterable[Any]) -> None:
        import pyarrow.parquet as pq

        try:
            # The study's description proves that the folder is ours.
            with written(path, "rows", replace=True) as stream:
                with pq.ParquetWriter(stream, self._schema, compression="zstd", write_page_checksum=True) as writer:
                    for table in tables:
                        writer.write_table(table)
                stream.flush()
                os.fsync(stream.fileno())
        except OutputError as error:
            count = int(self.done.sum()) - len(self._waiting)
            raise OutputError(f"{error}; {count} rows are kept, --resume does the others") from error


def open_store(folder: Path, manifest: Mapping[str, Any], *, resume: bool, overwrite: bool) -> Store:
    """The store of a study in its folder. Raises InputError where the folder holds rows and neither option is given, or rows
    of another study.
    """
    known = folder / MANIFEST
    rows = (folder / ROWS).exists() or bool(parts_of(folder))
    # A study that ended before its first row, for example for want of a scheduler, is no obstacle.
    begun = rows or (resume and known.exists())
    if (rows or known.exists()) and not is_ours(known, "json"):
        message = "holds rows, but no study of asrsim's (study.json) that they belong to"
        raise InputError(message, file=folder, hint="Take another folder by --out", code="sweep-folder")
    if begun and not (resume or overwrite):
        hint = "--resume does what is missing, --overwrite begins anew, --out takes another folder"
        raise InputError("holds rows of a study", file=folder, hint=hint, code="sweep-folder")
    going_on = begun and resume
    if going_on:
        before, now = read_manifest(folder), json.loads(json.dumps(manifest, default=str))
        for key, difference in SAME.items():
            if before[key] != now[key]:
                hint = "Begin anew with --overwrite, or take another folder by --out"
                message = f"cannot be gone on with: {difference}"
                raise InputError(Problem(message, file=folder, hint=hint, code="sweep-resume"))
    make_folder(folder)
    left = [*folder.glob(".part-*.new"), *([] if going_on else [*parts_of(folder), folder / ROWS])]
    for path in left:
        path.unlink(missing_ok=True)
    store = Store(folder, manifest["columns"], manifest["runs"])
    if not going_on:
        write_text(known, sealed(manifest), "json")
    return store
