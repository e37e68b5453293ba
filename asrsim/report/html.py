"""Builds an HTML page and its elements. All texts that are not HTML are escaped here."""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

from asrsim.tables import TableColumn

_POLICY = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; img-src data:"
LONG = 24
"""Smallest number of letters at which a name in a table may be broken into two lines."""


def document(title: str, style: str, main: str, *, scripts: Sequence[str] = ()) -> str:
    """Self-contained HTML page, with a security policy that forbids loading other files. style: CSS; main, scripts: HTML."""
    from asrsim import __version__

    return "\n".join(
        [
            "<!doctype html>",
            '<html lang="en"><head><meta charset="utf-8">',
            f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f'<meta name="generator" content="asrsim {__version__}">',
            f"<title>{escape(title)}</title>",
            # Give the page an empty icon. Without an icon in the page, a browser requests a file from the server.
            '<link rel="icon" href="data:,">',
            f"<style>{style}</style>",
            f"</head><body><main>\n{main}\n</main>",
            *scripts,
            "</body></html>",
            "",
        ]
    )


def data_address(data: bytes, kind: str = "image/png") -> str:
    """File content as a data URL."""
    return f"data:{kind};base64,{base64.b64encode(data).decode('ascii')}"


def script_json(data: Any) -> str:
    """JSON text that is safe inside `<script>`: characters that could open or close a tag or a comment are escaped."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def section(title: str, body: str) -> str:
    """Section of the page with its heading; `body` is HTML."""
    return f"<section><h2>{escape(title)}</h2>{body}</section>"


def table(heads: Sequence[str], rows: Sequence[Sequence[Any]], *, raw: tuple[int, ...] = (), long: tuple[int, ...] = ()) -> str:
    """HTML table, in which empty columns are left out. raw: indices of columns whose cells are already HTML; long: indices of
    columns whose cells are sentences.

    Each cell contains the heading of its column, since in a narrow window CSS shows each row as a list of headings and values.
    """
    filled = [i for i in range(len(heads)) if any(str(row[i]) not in ("", "-") for row in rows)]
    head = "".join(f"<th>{escape(heads[i])}</th>" for i in filled)
    cells = [[_cell(heads[i], row[i], raw=i in raw, long=i in long) for i in filled] for row in rows]
    body = "".join(f"<tr>{''.join(row)}</tr>" for row in cells)
    return f'<div class="wide"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'


def _cell(head: str, value: Any, *, raw: bool, long: bool) -> str:
    kind = " class=long" if long else ""
    return f'<td{kind} data-head="{escape(head)}">{value if raw else _breakable(str(value))}</td>'


def column_table(columns: Sequence[TableColumn]) -> str:
    """HTML table of columns. The line breaks that headings contain for narrow terminals are removed."""
    heads = [one.heading.replace("-\n", "").replace("\n", " ") for one in columns]
    return table(heads, [*zip(*(one.cells for one in columns), strict=True)])


def _breakable(text: str) -> str:
    """HTML of a cell's text, in which a long name may be broken after its underscores, so that the table fits the window."""
    return escape(text).replace("_", "_<wbr>") if len(text) > LONG else escape(text)


def bullets(items: Iterable[str]) -> str:
    """HTML list; an empty text if there are no items."""
    text = "".join(f"<li>{escape(item)}</li>" for item in items)
    return f"<ul>{text}</ul>" if text else ""


def badge(text: str, *, good: bool) -> str:
    """HTML of a word on a coloured background."""
    return f'<span class="badge {"good" if good else "poor"}">{escape(text)}</span>'


def number(value: Any) -> str:
    """Number as text with five digits; "-" for a missing number."""
    if value is None or not isinstance(value, int | float) or math.isnan(value):
        return "-"
    return f"{value:.5g}"
