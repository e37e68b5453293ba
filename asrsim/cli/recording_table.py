"""Prints a recording's columns: the quantity of each column, and the reason for the choice."""

from __future__ import annotations

from asrsim.cli.console import say, say_rows
from asrsim.errors import listed
from asrsim.recordings import Recording

_MOST = 40
"""Largest number of columns that are listed; a file may have thousands."""


def say_columns(recording: Recording) -> None:
    """Print the columns that are mapped to quantities as a table, and the names of the other columns."""
    used = [column for column in recording.channels.values() if column.quantity]
    if used:
        headings = ("column", "read as", "unit", "conversion", "why")
        cells = [[r.source, r.meaning, r.unit, r.conversion, r.origin] for r in used[:_MOST]]
        say_rows(headings, cells)
        if len(used) > _MOST:
            say(f"  and {len(used) - _MOST} more", "dim")
    others = [column.source for column in recording.channels.values() if not column.quantity]
    if others:
        say(f"  not used: {listed(others, _MOST)}", "dim")
