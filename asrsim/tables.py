"""Tables of texts as columns: one form for terminal, notebook and page."""

from __future__ import annotations

from collections.abc import Container, Sequence
from typing import NamedTuple


class TableColumn(NamedTuple):
    """Column of a table."""

    heading: str
    """Heading. It may contain newlines for narrow terminals, also after a hyphen within a word."""
    cells: Sequence[str]
    right: bool = False
    """Whether the cells are right-aligned, as numbers are."""


def from_rows(headings: Sequence[str], rows: Sequence[Sequence[str]], *, right: Container[int] = ()) -> list[TableColumn]:
    """Table from its rows. right: indices of the right-aligned columns."""
    return [TableColumn(head, [row[i] for row in rows], right=i in right) for i, head in enumerate(headings)]
