"""The rows of a study, read: columns as arrays, quantiles, shares, and how to do a run again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.errors import InputError, did_you_mean
from asrsim.extras import library
from asrsim.samples import Array
from asrsim.sweeps.kept import check_rows, read_manifest, read_rows, schema_of
from asrsim.sweeps.store import ROWS, parts_of

BOOKKEEPING = ("run", "substeps", "motor_substeps", "simulated_time", "seconds")


@dataclass(frozen=True)
class Quantiles:
    """How one result is distributed over the runs that have it."""

    count: int
    least: float
    low: float
    """5 %."""
    median: float
    high: float
    """95 %."""
    largest: float
    least_run: int
    largest_run: int


class Table:
    """Rows of a study in its folder; columns are read when they are asked for."""

    def __init__(self, folder: str | Path, *, keep: Any = None, checked: bool = False) -> None:
        """keep: what lives as long as the table (a temporary folder); checked: this process wrote or checked the rows.

        Raises InputError where there is no study, or a file of it is broken.
        """
        self.folder = Path(folder)
        self._keep = keep
        self.manifest = read_manifest(self.folder)
        whole = self.folder / ROWS
        self.files = ([whole] if whole.exists() else []) + parts_of(self.folder)
        if not checked:
            check_rows(self.files, self._schema)
        self._columns: dict[str, Array] = {}

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(name for name, _ in self.manifest["columns"])

    @property
    def _schema(self) -> Any:
        return schema_of(self.manifest["columns"])

    @property
    def kinds(self) -> dict[str, str]:
        """Column -> int, float, bool, text or floats."""
        return dict(self.manifest["columns"])

    @property
    def keys(self) -> tuple[str, ...]:
        """What was varied."""
        return tuple(self.manifest["keys"])

    @property
    def results(self) -> tuple[str, ...]:
        """Numbers that came out: measures, the tip's, those of claims."""
        kinds = self.kinds
        left = {*BOOKKEEPING, *self.keys}
        return tuple(name for name in self.columns if name not in left and kinds[name] == "float")

    @property
    def missing(self) -> int:
        """Runs of the study without a row."""
        return int(self.manifest["runs"]) - len(self)

    @cached_property
    def _order(self) -> Any:
        return np.unique(self._raw("run"), return_index=True)[1]

    def __len__(self) -> int:
        return len(self._order)

    def __getitem__(self, name: str) -> Array:
        """A column (n,) in the order of the runs; numbers that are missing are NaN."""
        if name not in self._columns:
            self._columns[name] = self._raw(name)[self._order]
        return self._columns[name]

    def _raw(self, name: str) -> Array:
        if name not in self.columns:
            hint = did_you_mean(name, self.columns)
            raise InputError("no column has this name", key=name, hint=hint, code="unknown-column")
        if not self.files:
            return np.empty(0, np.int64 if self.kinds[name] == "int" else float)
        parts = [read_rows(path, columns=[name])[name] for path in self.files]
        # float64 first: a part in which a number is missing everywhere would else be of objects.
        if self.kinds[name] == "float" or (self.kinds[name] == "int" and name not in BOOKKEEPING):
            return np.concatenate([part.cast("float64").to_numpy(zero_copy_only=False).astype(float) for part in parts])
        return np.concatenate([np.asarray(part.to_numpy(zero_copy_only=False)) for part in parts])

    def to_pandas(self) -> Any:
        """A DataFrame of all columns, in the order of the runs; needs pandas."""
        library("pandas", "notebook")
        return self.to_arrow().to_pandas()

    def to_arrow(self) -> Any:
        """A pyarrow.Table, likewise."""
        import pyarrow as pa
        import pyarrow.compute as pc

        tables = [read_rows(path) for path in self.files] or [self._schema.empty_table()]
        return pc.take(pa.concat_tables(tables), pa.array(self._order))

    def unit(self, name: str) -> str:
        """SI unit of a column; empty for counts and shares."""
        return str(self.manifest.get("units", {}).get(name, ""))

    def statuses(self) -> dict[str, int]:
        """Status -> runs."""
        names, counts = np.unique(self["status"].astype(str), return_counts=True)
        return dict(zip(names.tolist(), map(int, counts), strict=True))

    def quantiles(self, name: str) -> Quantiles | None:
        """Of a result; None where no run has it."""
        values, runs = self[name], self["run"]
        there = np.isfinite(values)
        if not there.any():
            return None
        values, runs = values[there], runs[there]
        low, median, high = np.quantile(values, (0.05, 0.5, 0.95))
        return Quantiles(
            len(values), float(values.min()), float(low), float(median), float(high), float(values.max()),
            int(runs[values.argmin()]), int(runs[values.argmax()]),
        )  # fmt: skip

    def claims(self) -> dict[str, float]:
        """Claim -> share of the completed runs that meet it; by variant where they differ."""
        variants, found = self["variant"].astype(str), {}
        several = len(self.manifest["claims"]) > 1
        for variant, titles in self.manifest["claims"].items():
            mine = variants == variant
            for index, title in enumerate(titles):
                held = [bool(value) for value in self[f"claim_{index}"][mine] if value is not None]
                if held:
                    found[f"{variant}: {title}" if several else title] = sum(held) / len(held)
        return found

    def __repr__(self) -> str:
        return f"Table({self.folder}: {len(self)} of {self.manifest['runs']} runs, {', '.join(self.keys)})"


def shares(statuses: Mapping[str, int], names: Sequence[str] = ("diverged", "failed", "crashed")) -> str:
    """Statuses for people, those that are no completion."""
    return ", ".join(f"{statuses[name]} {name}" for name in names if statuses.get(name))
