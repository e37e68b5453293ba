"""A page and its small parts. Texts are escaped here."""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

_POLICY = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; img-src data:"
LONG = 24
"""Letters from which on a name in a table may be broken."""


def document(title: str, style: str, main: str, *, scripts: Sequence[str] = ()) -> str:
    """A page with everything in it, and a policy that lets it load nothing from anywhere.

    style: CSS; main, scripts: HTML.
    """
    from asrsim import __version__

    return "\n".join(
        [
            "<!doctype html>",
            '<html lang="en"><head><meta charset="utf-8">',
            f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f'<meta name="generator" content="asrsim {__version__}">',
            f"<title>{escape(title)}</title>",
            # An empty icon: browsers would ask for one.
            '<link rel="icon" href="data:,">',
            f"<style>{style}</style>",
            f"</head><body><main>\n{main}\n</main>",
            *scripts,
            "</body></html>",
            "",
        ]
    )


def data_address(data: bytes, kind: str = "image/png") -> str:
    """A file as an address that holds it."""
    return f"data:{kind};base64,{base64.b64encode(data).decode('ascii')}"


def script_json(data: Any) -> str:
    """Plain data as JSON that may stand in a `<script>`: nothing in it opens or closes a tag or a comment."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def section(title: str, body: str) -> str:
    """A part of the page with its heading; `body` is HTML."""
    return f"<section><h2>{escape(title)}</h2>{body}</section>"


def table(heads: Sequence[str], rows: Sequence[Sequence[Any]], *, raw: tuple[int, ...] = ()) -> str:
    """Columns that hold nothing are left out; `raw` ones hold HTML already."""
    filled = [i for i in range(len(heads)) if any(str(row[i]) not in ("", "-") for row in rows)]
    head = "".join(f"<th>{escape(heads[i])}</th>" for i in filled)
    body = "".join(
        "<tr>" + "".join(f"<td>{row[i] if i in raw else _breakable(str(row[i]))}</td>" for i in filled) + "</tr>"
        for row in rows
    )
    return f'<div class="wide"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'


def _breakable(text: str) -> str:
    """Text of a cell; a long name may go on in the next line behind its underscores, so that the table fits the window."""
    return escape(text).replace("_", "_<wbr>") if len(text) > LONG else escape(text)


def bullets(items: Iterable[str]) -> str:
    """A list; nothing without items."""
    text = "".join(f"<li>{escape(item)}</li>" for item in items)
    return f"<ul>{text}</ul>" if text else ""


def badge(text: str, *, good: bool) -> str:
    """A coloured word."""
    return f'<span class="badge {"good" if good else "poor"}">{escape(text)}</span>'


def number(value: Any, factor: float = 1.0) -> str:
    """A number times `factor` to five digits; "-" where there is none."""
    if value is None or not isinstance(value, int | float) or math.isnan(value):
        return "-"
    return f"{value * factor:.5g}"
