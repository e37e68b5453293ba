"""Reads delimited text in blocks: the fast way for clean blocks, cell by cell where a line is not as it should be."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from asrsim.errors import Problem, RecordingError
from asrsim.recordings.cells import COMMENTS, MISSING, number, printable, split, spread, stamp_ns
from asrsim.recordings.sniff import Layout, sniff
from asrsim.recordings.timebase import lines_text
from asrsim.samples import Array

_THOUSANDS = re.compile(r"[-+]?\d{1,3}([.,' ]\d{3}){2,}")
_WORDS = 256
"""Words of a column of text from which on it names no signals."""
_BLOCK = 20_000
"""Lines read at a time; bounds the memory beside the numbers themselves."""


@dataclass(frozen=True, kw_only=True)
class Table:
    """A text file's numbers."""

    layout: Layout
    values: Array
    """(n, columns), in the file's units; stamps in s since the first one of their column; of text the place of the word."""
    lines: NDArray[np.int64]
    """(n,) line of each row, counted from 1."""
    zeros: Mapping[int, int]
    """Column of stamps -> Unix time in ns of its first one (of a time of day: since midnight)."""
    findings: tuple[Problem, ...]
    words: Mapping[int, tuple[str, ...]] = field(default_factory=dict)
    """Column of text -> its words, where they are few."""


@dataclass
class Faults:
    """Lines that were not plain numbers, by what was wrong with them."""

    ragged: list[int] = field(default_factory=list)
    lengths: set[int] = field(default_factory=set)
    cells: list[tuple[int, int, str]] = field(default_factory=list)
    """Line, column, text."""
    missing: dict[int, int] = field(default_factory=dict)
    comments: list[int] = field(default_factory=list)
    headers: list[int] = field(default_factory=list)
    turned: bool = False
    """Whether one of these has its names in another order."""
    words: dict[int, dict[str, int]] = field(default_factory=dict)
    """Column of text -> its words with their places."""

    def few(self) -> dict[int, tuple[str, ...]]:
        """The words of columns that have few."""
        return {column: tuple(words) for column, words in self.words.items() if 0 < len(words) < _WORDS}


def read_table(path: Path) -> Table:
    """The numbers of a delimited text file. Raises RecordingError if there are none."""
    layout = sniff(path)
    faults = Faults()
    blocks: list[Array] = []
    lines: list[NDArray[np.int64]] = []
    zero: dict[int, int] = {}
    with path.open(encoding=layout.encoding, errors="replace") as stream:
        for _ in range(layout.first_line - 1):
            next(stream)
        for start, block in _blocks(map(layout.plain, stream), layout.first_line):
            values = _fast(block, layout)
            if values is not None:
                blocks.append(values)
                lines.append(np.arange(start, start + len(block), dtype=np.int64))
            else:
                slow, kept = _slow(start, block, layout, faults, zero)
                blocks.append(slow)
                lines.append(kept)
    values = np.concatenate(blocks) if len(blocks) > 1 else blocks[0]
    return Table(
        layout=layout, values=values, lines=np.concatenate(lines), zeros=zero,
        findings=tuple(report(path, layout, faults, len(values))),
        words=faults.few(),
    )  # fmt: skip


def _blocks(stream: Iterator[str], first: int) -> Iterator[tuple[int, list[str]]]:
    start = first
    while block := list(itertools.islice(stream, _BLOCK)):
        yield start, block
        start += len(block)


def _fast(block: list[str], layout: Layout) -> Array | None:
    """All lines at once by numpy's C reader; None if any line needs a closer look."""
    if layout.stamps or layout.text or layout.quoted or layout.widths:
        return None
    columns = len(layout.names)
    if layout.decimal == ",":
        block = [line.replace(",", ".") for line in block]
    try:
        values = np.loadtxt(block, delimiter=layout.separator, comments=None, ndmin=2)
    except ValueError:
        return None
    # Blank lines are passed over by the reader and would shift the line numbers.
    return values if values.shape == (len(block), columns) else None


def _slow(
    start: int, block: Sequence[str], layout: Layout, faults: Faults, zero: dict[int, int]
) -> tuple[Array, NDArray[np.int64]]:
    """Line by line: rows of the wrong length are left out, cells that are no numbers become NaN; both are noted."""
    columns, decimal, separator = len(layout.names), layout.decimal, layout.separator
    plain = not (layout.stamps or layout.text or layout.quoted or layout.widths)
    stamps, text = set(layout.stamps), set(layout.text)
    header = ["" if i in layout.unnamed else name for i, name in enumerate(layout.names)]
    rows: list[list[float]] = []
    kept: list[int] = []
    for count, line in enumerate(block, start=start):
        cells = split(line.strip("\r\n"), separator, quoted=layout.quoted)
        if layout.widths:
            cells = spread(cells, layout.widths)
        if plain and len(cells) == columns:
            try:
                rows.append([float(cell.replace(",", ".") if decimal == "," else cell) for cell in cells])
                kept.append(count)
                continue
            except ValueError:
                pass
        stripped = line.strip("\0 \t\r\n")
        if not stripped or not any(cells):
            continue
        if stripped.startswith(COMMENTS):
            faults.comments.append(count)
            continue
        while len(cells) > columns and not cells[-1]:
            cells.pop()
        if len(cells) != columns:
            faults.ragged.append(count)
            faults.lengths.add(len(cells))
            continue
        if sorted(cells) == sorted(header):
            faults.headers.append(count)
            faults.turned |= cells != header
            continue
        rows.append([value_of(cell, i, count, decimal, stamps, text, faults, zero) for i, cell in enumerate(cells)])
        kept.append(count)
    return np.array(rows, dtype=float).reshape(len(rows), columns), np.array(kept, dtype=np.int64)


def value_of(
    cell: str, column: int, line: int, decimal: str, stamps: set[int], text: set[int], faults: Faults, zero: dict[int, int]
) -> float:
    """One cell's number; NaN, and a note of it, where it has none."""
    if column in text:
        words = faults.words.setdefault(column, {})
        return words.setdefault(printable(cell), len(words)) if cell and len(words) < _WORDS else float("nan")
    if column in stamps:
        moment = stamp_ns(cell)
        if moment is None:
            faults.cells.append((line, column, cell))
            return float("nan")
        return (moment - zero.setdefault(column, moment)) * 1e-9
    value = number(cell, decimal)
    if value is None:
        faults.cells.append((line, column, cell))
        return float("nan")
    if cell.lower() in MISSING:
        faults.missing[column] = faults.missing.get(column, 0) + 1
    return value


def report(path: Path, layout: Layout, faults: Faults, rows: int) -> list[Problem]:
    """The notes as findings, one a kind."""
    found: list[Problem] = []

    def add(message: str, lines: Sequence[int], code: str, key: str | None = None, hint: str | None = None) -> None:
        line = lines[0] if lines else None
        found.append(Problem(message, file=path, line=line, key=key, code=code, hint=hint))

    if layout.skipped:
        add(f"passed over above the numbers: {lines_text(list(layout.skipped))}", layout.skipped, "preamble")
    if layout.misfit:
        add(f"{layout.misfit}; columns go by their numbers", [layout.misfit_line or 1], "header-misfit")
    elif layout.header_line is None:
        add("has no header; columns are called column_1, column_2, ...", (), "no-header",
            hint="Name them with --map 2=joint_1.link_position")  # fmt: skip
    if faults.ragged:
        lengths = ", ".join(str(length) for length in sorted(faults.lengths))
        add(f"{len(faults.ragged)} rows with {lengths} instead of {len(layout.names)} fields are left out: "
            f"{lines_text(faults.ragged)}", faults.ragged, "ragged-row")  # fmt: skip
    for column in sorted({column for _, column, _ in faults.cells}):
        bad = [(line, cell) for line, at, cell in faults.cells if at == column]
        add(f"{len(bad)} cells are no numbers and count as missing, such as '{printable(bad[0][1][:30])}': "
            f"{lines_text([line for line, _ in bad])}", [bad[0][0]], "not-a-number", layout.names[column])  # fmt: skip
    for column, count in sorted(faults.missing.items()):
        if count < rows:
            add(f"{count} of {rows} cells are empty", (), "missing-cells", layout.names[column])
    if separated := [one for one in faults.cells if _THOUSANDS.fullmatch(one[2])]:
        line, column, cell = separated[0]
        raise RecordingError(
            f"numbers have marks between their thousands: {printable(cell)}", file=path, line=line, key=layout.names[column],
            code="thousands", hint="Export it without them",
        )  # fmt: skip
    if layout.text:
        add("hold text and are not read" if len(layout.text) > 1 else "holds text and is not read", (), "text-column",
            ", ".join(layout.names[column] for column in layout.text[:6]))  # fmt: skip
    if faults.turned:
        raise RecordingError(
            f"the header comes again with its names in another order: {lines_text(faults.headers)}", file=path,
            line=faults.headers[0], code="repeated-header", hint="Split the file there",
        )  # fmt: skip
    if faults.headers:
        add(f"the header is repeated: {lines_text(faults.headers)}", faults.headers, "repeated-header",
            hint="Two recordings in one file?")  # fmt: skip
    return found
