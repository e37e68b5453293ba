"""Tables of texts, as columns: the same form for terminal, notebook and page."""

from __future__ import annotations

from collections.abc import Container, Sequence
from typing import NamedTuple


class TableColumn(NamedTuple):
    """Column of a table."""

    heading: str
    """Heading. For narrow terminals it may contain newlines, also after a hyphen inside a word."""
    cells: Sequence[str]
    right: bool = False
    """Whether the cells are right-aligned, as numbers are."""


def from_rows(headings: Sequence[str], rows: Sequence[Sequence[str]], *, right: Container[int] = ()) -> list[TableColumn]:
    """Columns of a table that is given by rows. right: indices of the right-aligned columns."""
    return [TableColumn(head, [row[i] for row in rows], right=i in right) for i, head in enumerate(headings)]
