"""Pages: the sheet of one actuator, and several actuators side by side."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from html import escape

from asrsim.datasheet.data import Sheet
from asrsim.datasheet.rows import compared_rows, names_of, number_rows
from asrsim.plots import style
from asrsim.plots.chart import Chart
from asrsim.report.charts import page_data
from asrsim.report.html import section, table
from asrsim.report.page import HINT, NO_SCRIPT, folded, page_html

HEADS = ("torque and stiffness", "limits of the motors", "simulated steps")
"""Headings of the rows of charts, from the first row to the last."""


def sheet_page(sheet: Sheet) -> str:
    """HTML of the sheet of one actuator."""
    heads, rows = number_rows(sheet)
    words = {one.key: one.words for one in sheet.entries}
    published = [[words.get(one.key, "remark"), one.text, one.source, one.why] for one in sheet.published]
    shown = "".join(folded(n, name, opened=True) for n, name in enumerate(HEADS))
    values = [[name, f"{value:.6g}", sheet.units[name]] for name, value in sheet.values.items() if math.isfinite(value)]
    parameters = table(["parameter", "value", "unit"], values)
    simulated = any(one.known and one.how.startswith("simulation") for one in sheet.entries)
    about = f"The folder of this page contains {' and '.join(sheet.files)}, which simulate the steps of the last charts"
    about += " and check the simulated numbers as claims." if simulated else "."
    beside = ["quantity", "published", "source", "compared with the defaults"]
    doubts = "".join(f"<p>{escape(doubt)}</p>" for doubt in sheet.doubts)
    sections = [
        section("Numbers", table(heads, rows, long=(3,))),
        section("Curves", doubts + HINT + shown + NO_SCRIPT),
        section("Published", table(beside, published, long=(1, 2, 3))) if published else "",
        section("Repeat the simulations", f"<p>{escape(about)}</p><pre>{escape(sheet.command)}</pre>"),
        f"<section><details class='part'><summary><b>Parameters</b></summary>{parameters}</details></section>",
    ]
    head = f"<p>Values: {escape(sheet.origin)}. Law: {escape(sheet.source)}</p><pre class='law'>{escape(sheet.law)}</pre>"
    data = page_data([*zip(HEADS, sheet.rows, strict=True)])
    return page_html(f"Data sheet: {sheet.title}", sections, head=head, data=data)


def comparison_page(sheets: Sequence[Sheet]) -> str:
    """HTML with the numbers of several actuators side by side, and their softest and stiffest curves in common charts."""
    heads, rows = compared_rows(sheets)
    shown = "".join(folded(n, name, opened=True) for n, name in enumerate(HEADS[:2]))
    links = "".join(
        f'<li><a href="{escape(one.name)}.html">{escape(one.title)}</a>: {escape(one.origin)}</li>' for one in sheets
    )
    sections = [
        section("Numbers", table(heads, rows)),
        section("Curves", HINT + shown + NO_SCRIPT),
        section("Sheets", f"<ul>{links}</ul>"),
    ]
    data = page_data([*zip(HEADS, common_charts(sheets), strict=False)])
    return page_html("Data sheets side by side", sections, data=data)


def common_charts(sheets: Sequence[Sheet]) -> list[tuple[Chart, ...]]:
    """First two rows of charts, common to all sheets. Each sheet gives its first and its last curve; for the limits of the
    motors, it gives only its first curve. All curves of an actuator have one colour.
    """
    rows, names = [], names_of(sheets)
    for r in range(2):
        charts = []
        for c in range(2):
            lines = []
            for i, (sheet, name) in enumerate(zip(sheets, names, strict=True)):
                curves = [one for one in sheet.rows[r][c].lines if one.kind == "line"]
                ends = dict.fromkeys((0, 0 if r else len(curves) - 1))
                for curve in ends:
                    label = f"{name}, {'stiffest' if curve else 'softest'}" if len(ends) > 1 else name
                    lines.append(replace(curves[curve], label=label, colour=style.variant_colour(i), dash=1 if curve else 0))
            chart = sheets[0].rows[r][c]
            logarithmic = "y" if chart.words == "stiffness" else ""  # actuators differ in stiffness by orders of magnitude
            top = max(float(one.y.max(initial=0.0)) for one in lines)
            charts.append(replace(chart, lines=lines, logarithmic=logarithmic, span=(0.0, 1.1 * top) if r else None))
        rows.append(tuple(charts))
    return rows
