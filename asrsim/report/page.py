"""Frame of every page: title, sections, and the program that draws the plots and the moving view in the browser."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from importlib.resources import files
from typing import Any

from asrsim.report.html import document, script_json

HINT = (
    "<p class='note hint'>Drag to zoom, double-click to see all again; click a name to hide its lines. Plots over the same "
    "quantity share their range, and one cursor marks the time in all of them.</p>"
)
"""Instructions for using the plots of a page, as HTML."""
NO_SCRIPT = (
    "<noscript><p class='bad'>The plots need JavaScript: enable it in the browser. The page loads nothing from the network.</p>"
    "</noscript>"
)


def asset(name: str) -> str:
    """Text of a file in the folder of this package's assets."""
    return (files("asrsim.report") / "assets" / name).read_text(encoding="utf-8")


def page_html(
    title: str,
    sections: Sequence[str],
    *,
    head: str = "",
    data: Mapping[str, Any] | None = None,
    motion: Mapping[str, Any] | None = None,
    foot: str = "",
) -> str:
    """HTML of a page.

    head: HTML below the title; sections: HTML of each section; empty sections are left out; data: data of the plots; motion:
    data of the moving view; foot: last line of the page.
    """
    header = f"<header><h1>{escape(title)}</h1>{head}</header>"
    footer = f"<footer class='note'>{foot}</footer>" if foot else ""
    scripts = []
    if data is not None or motion is not None:
        scripts.append(f"<script>{asset('clock.js')}</script>")
    if motion is not None:
        scripts += [packed("motion-data", motion), f"<script>{asset('motion.js')}</script>"]
    if data is not None:
        licence = f"/*! uPlot, MIT licence\n{asset('LICENSE.uPlot').strip()}\n*/"
        scripts += [packed("data", data), f"<script>{licence}\n{asset('uPlot.iife.min.js')}</script>"]
        scripts += [f"<script>{asset('page.js')}</script>", f"<script>{asset('old.js')}</script>"]
    style = "\n".join([*([asset("uPlot.min.css")] if data is not None else []), asset("page.css")])
    return document(f"{title} · asrsim", style, "\n".join(filter(None, [header, *sections, footer])), scripts=scripts)


def packed(name: str, data: Mapping[str, Any]) -> str:
    """Data of a page as an HTML script element, which the page's program finds by this name."""
    return f'<script type="application/json" id="{name}">{script_json(data)}</script>'


def plots(number: int) -> str:
    """HTML element in which the page draws the plots of group `number` of its data."""
    return f'<div data-group="{number}"><div class="plots"></div></div>'


def folded(number: int, name: str, words: str = "", *, opened: bool, three: bool = False) -> str:
    """HTML element for the plots of group `number`, with a heading that folds and unfolds them. opened: whether the plots are
    unfolded at first; three: whether they stand in three columns instead of two.
    """
    state = " open" if opened else ""
    about = f' <span class="note">{escape(words)}</span>' if words else ""
    return (
        f'<details class="joint"{state} data-group="{number}"><summary><b>{escape(name)}</b>{about}</summary>'
        f'<div class="plots{" three" * three}"></div></details>'
    )
