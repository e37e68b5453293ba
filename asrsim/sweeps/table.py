"""Table of a study's rows: columns as arrays, quantiles of results, and fractions of runs that satisfy the claims."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.errors import InputError, did_you_mean
from asrsim.extras import library
from asrsim.samples import Array
from asrsim.sweeps.store import MANIFEST, NEW_STUDY, checked_files, read_manifest, read_rows, schema_of
from asrsim.sweeps.study import Study

BOOKKEEPING = ("run", "substeps", "motor_substeps", "simulated_time", "seconds")


@dataclass(frozen=True)
class Quantiles:
    """Quantiles of one result over the runs that have this result."""

    count: int
    least: float
    low: float
    """5 % quantile."""
    median: float
    high: float
    """95 % quantile."""
    largest: float
    least_run: int
    largest_run: int


class Table:
    """Rows of a study in its folder. A column is read when it is first used."""

    def __init__(self, folder: str | Path, *, keep: Any = None, checked: bool = False) -> None:
        """keep: object that must live as long as the table, such as a temporary folder; checked: whether the check of the files
        is skipped.

        Raises InputError if the folder contains no study, or if one of the study's files is broken.
        """
        self.folder = Path(folder)
        self._keep = keep
        self.manifest = read_manifest(self.folder)
        self._schema = schema_of(self.manifest["columns"])
        self.files = checked_files(self.folder, self._schema, checked=checked)
        self.kinds: dict[str, str] = {name: kind for name, kind, _ in self.manifest["columns"]}
        """Kind of each column: int, float, bool or text."""
        self._units: dict[str, str] = {name: unit for name, _, unit in self.manifest["columns"]}
        self._columns: dict[str, Array] = {}

    @cached_property
    def study(self) -> Study:
        """Study that the description `study.json` defines."""
        given = self.manifest["study"]
        plugins = tuple(map(Path, self.manifest["plugins"]))
        try:
            return Study(
                **{**given, "variants": tuple(given["variants"])}, scenario=Path(self.manifest["scenario"]), plugins=plugins
            )
        except (TypeError, ValueError, AttributeError, KeyError) as error:
            path = self.folder / MANIFEST
            raise InputError(f"does not describe a study: {error}", file=path, hint=NEW_STUDY, code="no-study") from None

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(self.kinds)

    @property
    def keys(self) -> tuple[str, ...]:
        """Names of the columns with the values of the varied keys."""
        return self.study.keys

    @property
    def results(self) -> tuple[str, ...]:
        """Names of the columns with results: measures, errors of the tip, and measured values of claims."""
        left = {*BOOKKEEPING, *self.keys}
        return tuple(name for name, kind in self.kinds.items() if name not in left and kind == "float")

    @property
    def missing(self) -> int:
        """Number of runs without a row."""
        return int(self.manifest["runs"]) - len(self)

    @cached_property
    def _order(self) -> Any:
        runs = read_rows(self.files, self._schema, columns=["run"])["run"].to_numpy()
        return np.unique(runs, return_index=True)[1]

    def __len__(self) -> int:
        return len(self._order)

    def __getitem__(self, name: str) -> Array:
        """Column (n,) with this name, in the order of the runs; missing numbers are NaN."""
        if name not in self._columns:
            if name not in self.columns:
                hint = did_you_mean(name, self.columns)
                raise InputError("no column has this name", key=name, hint=hint, code="unknown-column")
            self._columns[name] = self.to_arrow([name])[name].to_numpy()
        return self._columns[name]

    def to_arrow(self, columns: Sequence[str] | None = None) -> Any:
        """The named columns (default: all) as a pyarrow.Table, in the order of the runs."""
        return read_rows(self.files, self._schema, columns=columns).take(self._order)

    def to_pandas(self) -> Any:
        """All columns as a pandas.DataFrame, in the order of the runs; needs pandas."""
        library("pandas", "notebook")
        return self.to_arrow().to_pandas()

    def unit(self, name: str) -> str:
        """SI unit of a column; an empty text for counts and fractions."""
        return self._units.get(name, "")

    def claim(self, name: str) -> str:
        """Joint, quantity and measure of the claim whose measured value is in a column. Empty for other columns, and if the
        claims of the variants differ.
        """
        match, variants = re.fullmatch(r"claim_(\d+)\.measured", name), self.manifest["claims"].values()
        titles = {one for own in variants for one in own[int(match[1]) :][:1]} if match else set()
        # A title ends with the comparison and the number.
        return titles.pop().rsplit(" ", 2)[0] if len(titles) == 1 else ""

    def label(self, name: str) -> str:
        """Name of a column; for the measured value of a claim, with the joint, quantity and measure of the claim."""
        claim = self.claim(name)
        return f"{name} ({claim})" if claim else name

    def statuses(self) -> dict[str, int]:
        """Number of runs with each status."""
        names, counts = np.unique(self["status"].astype(str), return_counts=True)
        return dict(zip(names.tolist(), map(int, counts), strict=True))

    def quantiles(self, name: str) -> Quantiles | None:
        """Quantiles of a result; None if no run has the result."""
        values, runs = self[name], self["run"]
        there = np.isfinite(values)
        if not there.any():
            return None
        values, runs = values[there], runs[there]
        least, low, median, high, largest = np.quantile(values, (0.0, 0.05, 0.5, 0.95, 1.0)).tolist()
        ends = int(runs[values.argmin()]), int(runs[values.argmax()])
        return Quantiles(len(values), least, low, median, high, largest, *ends)

    def claims(self) -> dict[str, float]:
        """Fraction of the completed runs that satisfy each claim, by the claim's title. If the variants have different claims,
        each variant has separate fractions.
        """
        variants, found = self["variant"].astype(str), {}
        several = len(self.manifest["claims"]) > 1
        for variant, titles in self.manifest["claims"].items():
            for index, title in enumerate(titles):
                verdicts = [bool(value) for value in self[f"claim_{index}"][variants == variant] if value is not None]
                if verdicts:
                    found[f"{variant}: {title}" if several else title] = sum(verdicts) / len(verdicts)
        return found

    def __repr__(self) -> str:
        return f"Table({self.folder}: {len(self)} of {self.manifest['runs']} runs, {', '.join(self.keys)})"


def shares(statuses: Mapping[str, int]) -> str:
    """Text with the numbers of runs that did not complete, by status."""
    return ", ".join(f"{statuses[name]} {name}" for name in ("diverged", "failed", "crashed") if statuses.get(name))
