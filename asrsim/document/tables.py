"""Markdown tables of declared keys."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from asrsim.document.block import Key


def markdown_table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table; pipes in cells are escaped."""
    lines = ["| " + " | ".join(header) + " |", "|" + "---|" * len(header)]
    lines += ["| " + " | ".join(cell.replace("|", "\\|").replace("\n", " ") for cell in row) + " |" for row in rows]
    return "\n".join(lines)


def key_table(keys: Iterable[Key]) -> str:
    """Key, value, unit, default and meaning, a row a key."""
    rows = [(f"`{key.name}`", key.kind.text, key.unit, key.default_text.strip(), key.doc) for key in keys]
    return markdown_table(("key", "value", "unit", "default", "meaning"), rows)
