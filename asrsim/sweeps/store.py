"""The rows of a study on disk: Parquet, in parts as runs end, put together at the end; resumable, each run once.

A part is written beside its place and put there in one move: whatever kills the program, a part is there whole or not at all,
and runs without a row are done again.
"""

from __future__ import annotations

import json
import os
import time as clock
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.errors import InputError, OutputError, Problem
from asrsim.outfile import is_ours, make_folder, write_text, written
from asrsim.samples import Array
from asrsim.sweeps.kept import MANIFEST, check_rows, read_manifest, read_rows, schema_of, sealed
from asrsim.sweeps.rows import Row

ROWS = "rows.parquet"
GROUP = 20_000
"""Rows of a group of the whole file, and the most of a part."""
PATIENCE = 3.0
"""s after which rows that have come are written: what a killed program loses at most."""


class Store:
    """A folder of rows that grows."""

    def __init__(self, folder: Path, columns: Sequence[tuple[str, str]], total: int) -> None:
        self.folder, self.total = folder, total
        self._schema = schema_of(columns)
        self._waiting: list[Row] = []
        self._written = clock.monotonic()
        self.done = np.zeros(total, bool)
        """Runs that have a row, written or waiting."""
        check_rows(self._files(), self._schema)
        for path in self._files():
            self.done[self._runs(path)] = True
        self._part = 1 + max((int(path.stem.rpartition("-")[2]) for path in parts_of(folder)), default=0)

    @property
    def missing(self) -> Any:
        """Runs without a row, in order."""
        runs: Any = np.flatnonzero(~self.done)
        return runs

    def add(self, rows: Sequence[Row]) -> list[Row]:
        """Take rows; gives back those of runs that had none yet. Raises OutputError."""
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
        """Write what waits. Raises OutputError."""
        self._written = clock.monotonic()
        if not self._waiting:
            return
        rows = sorted(self._waiting, key=lambda row: row[0])
        path = self.folder / f"part-{self._part:06d}.parquet"
        self._save(path, iter([self._table(rows)]))
        self._waiting, self._part = [], self._part + 1

    def finish(self) -> Path | None:
        """All parts as one file in the order of the runs; None while runs are missing. Raises OutputError."""
        self.write()
        parts = parts_of(self.folder)
        if not self.done.all():
            return None
        path = self.folder / ROWS
        if parts or not path.exists():
            self._save(path, self._sorted(self._files()))
            for part in parts:
                part.unlink(missing_ok=True)
        return path

    def _sorted(self, files: Sequence[Path]) -> Iterator[Any]:
        """Tables of at most a group, in order, each run once; files hold near runs, so few are open at a time."""
        import pyarrow as pa
        import pyarrow.compute as pc

        spans = [(path, runs.min(), runs.max()) for path in files if len(runs := self._runs(path))]
        for first in range(0, self.total, GROUP):
            last = min(first + GROUP, self.total) - 1
            tables = [self._between(path, first, last) for path, low, high in spans if low <= last and high >= first]
            table = pa.concat_tables(tables)
            _, places = np.unique(table["run"].to_numpy(), return_index=True)
            yield pc.take(table, pa.array(places))

    def _between(self, path: Path, first: int, last: int) -> Any:
        return read_rows(path, filters=[("run", ">=", first), ("run", "<=", last)])

    def _files(self) -> list[Path]:
        whole = self.folder / ROWS
        return [*([whole] if whole.exists() else []), *parts_of(self.folder)]

    def _runs(self, path: Path) -> Array:
        runs = np.asarray(read_rows(path, columns=["run"])["run"].to_numpy())
        if len(runs) and not 0 <= runs.min() <= runs.max() < self.total:
            raise InputError(f"has rows of runs beyond the study's {self.total}", file=path, code="sweep-part")
        return runs

    def _table(self, rows: Sequence[Row]) -> Any:
        import pyarrow as pa

        return pa.table([list(column) for column in zip(*rows, strict=True)], schema=self._schema)

    def _save(self, path: Path, tables: Iterator[Any]) -> None:
        import pyarrow.parquet as pq

        try:
            # The study's manifest proves that the folder is ours.
            with written(path, "rows", replace=True) as stream:
                with pq.ParquetWriter(stream, self._schema, compression="zstd", write_page_checksum=True) as writer:
                    for table in tables:
                        writer.write_table(table)
                stream.flush()
                os.fsync(stream.fileno())
        except OutputError as error:
            count = int(self.done.sum()) - len(self._waiting)
            raise OutputError(f"{error}; {count} rows are kept, --resume does the others") from error


def parts_of(folder: Path) -> list[Path]:
    """Parts in their order."""
    return sorted(folder.glob("part-*.parquet"))


def open_store(
    folder: Path, columns: Sequence[tuple[str, str]], total: int, manifest: Mapping[str, Any], *, resume: bool, overwrite: bool
) -> Store:
    """The store of a study in its folder. Raises InputError where the folder holds rows and neither is asked for, or
    those of another study.
    """
    known = folder / MANIFEST
    rows = (folder / ROWS).exists() or bool(parts_of(folder))
    # A study that ended before its first row (no scheduler answered, say) leaves its name only, and is no obstacle.
    held = rows or (resume and known.exists())
    if (rows or known.exists()) and not is_ours(known, "json"):
        message = "holds rows, but no study of asrsim's (study.json) that they belong to"
        raise InputError(message, file=folder, hint="Take another folder by --out", code="sweep-folder")
    if held and not resume:
        if not overwrite:
            hint = "--resume does what is missing, --overwrite begins anew, --out takes another folder"
            raise InputError("holds rows of a study", file=folder, hint=hint, code="sweep-folder")
        for path in [*parts_of(folder), folder / ROWS]:
            path.unlink(missing_ok=True)
    elif held:
        _check_same(known, manifest)
    make_folder(folder)
    for left in folder.glob(".part-*.new"):
        left.unlink(missing_ok=True)
    store = Store(folder, columns, total)
    if not (held and resume):
        write_text(known, sealed(manifest), "json")
    return store


def _check_same(known: Path, manifest: Mapping[str, Any]) -> None:
    before = read_manifest(known.parent)
    now = json.loads(json.dumps(manifest, default=str))
    differing = [key for key in ("digest", "inputs", "versions", "columns") if before[key] != now[key]]
    if differing:
        what = {
            "digest": "its study varies other things", "inputs": "its scenario, robot or other files have changed",
            "versions": "it was done with other versions", "columns": "its rows have other columns",
        }[differing[0]]  # fmt: skip
        hint = "Begin anew with --overwrite, or take another folder by --out"
        problem = Problem(f"cannot be gone on with: {what}", file=known.parent, hint=hint, code="sweep-resume")
        raise InputError(problem)
