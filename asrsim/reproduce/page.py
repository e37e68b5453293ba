"""The page: every figure with claims, numbers and pictures in one HTML file that needs nothing else."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from importlib.resources import files

from asrsim import __version__
from asrsim.report.html import data_address, document
from asrsim.reproduce.claim import ORIGINS, Claim
from asrsim.reproduce.figure import Part, Picture, Reproduction, Table

SOURCE = (
    "Mengacci, Zambella, Grioli, Caporale, Catalano, Bicchi (2021): An Open-Source ROS-Gazebo Toolbox for Simulating Robots "
    "With Compliant Actuators, Frontiers in Robotics and AI 8"
)
WORDS = {True: "holds", False: "does not hold"}
SHOWN_ROWS = 9
"""Rows of a table up to which it is not folded away."""


def page(reproductions: Sequence[Reproduction], *, seconds: float) -> str:
    """The page as HTML. seconds: wall-clock time of everything."""
    style = files("asrsim.reproduce").joinpath("assets/page.css").read_text(encoding="utf-8")
    failed = [str(one.number) for one in reproductions if not one.holds]
    numbers = ", ".join(str(one.number) for one in reproductions)
    verdict = "every claim holds" if not failed else f"claims of figure {', '.join(failed)} do not hold"
    simulated = sum(one.simulated for one in reproductions)
    body = "\n".join(_section(one) for one in reproductions)
    main = f"""<h1>The paper's experiments, run again</h1>
<p>{_verdict(not failed, verdict)}</p>
{_overview(reproductions)}
<p class="small">{escape(SOURCE)}. What the paper claims stands here in our own words. Its plots cannot be laid beside ours:
claims are checked on numbers. What the paper's figures could not show is folded away.</p>
{body}
<footer>Made by asrsim {__version__} with <code>asrsim reproduce</code>: {simulated:.0f} s simulated in {seconds:.0f} s,
pictures included.</footer>"""
    return document(f"asrsim reproduce: figures {numbers}", style, main)


def _overview(reproductions: Sequence[Reproduction]) -> str:
    rows = []
    for one in reproductions:
        good = sum(claim.holds for claim in one.claims)
        verdict = _verdict(one.holds, WORDS[one.holds])
        rows.append(
            f'<tr><td><a href="#figure-{one.number}">Figure {one.number}</a></td><td>{escape(one.title)}</td>'
            f'<td class="number">{good} of {len(one.claims)}</td><td>{verdict}</td></tr>'
        )
    head = '<tr><th>figure</th><th></th><th class="number">claims that hold</th><th></th></tr>'
    return f'<div class="scroll"><table><thead>{head}</thead><tbody>{"".join(rows)}</tbody></table></div>'


def _section(one: Reproduction) -> str:
    parts = "\n".join(_part(part, folded=number > 0) for number, part in enumerate(one.parts))
    if one.error:
        parts = f'<p class="fails">It could not be run: {escape(one.error)}</p>'
    speed = f"{one.simulated:.0f} s simulated in {one.simulating:.1f} s" if one.simulated else ""
    return f"""<section id="figure-{one.number}">
<div class="head"><h2>Figure {one.number}: {escape(one.title)}</h2>{_verdict(one.holds, WORDS[one.holds])}</div>
<p class="small">Section {escape(one.section)} of the paper. {speed}</p>
<p class="paper">{escape(one.paper)}</p>
{parts}
</section>"""


def _part(part: Part, *, folded: bool) -> str:
    """The paper's figure in full; what it could not show is folded away, unless a claim of it fails."""
    pictures = "\n".join(_picture(picture) for picture in part.pictures)
    tables = "\n".join(_table(table) for table in part.tables)
    body = f"<p>{escape(part.text)}</p>\n{pictures}\n{_claims(part.claims)}\n{tables}"
    if not folded:
        return f"<h3>{escape(part.title)}</h3>\n{body}"
    good = sum(claim.holds for claim in part.claims)
    counted = f' <span class="small">{good} of {len(part.claims)} claims hold</span>' if part.claims else ""
    opened = " open" if good < len(part.claims) else ""
    return f'<details class="part"{opened}><summary>{escape(part.title)}{counted}</summary>\n{body}</details>'


def _claims(claims: Sequence[Claim]) -> str:
    if not claims:
        return ""
    rows = "".join(
        f'<tr class="{_class(claim.holds)}"><td>{escape(claim.text)}'
        f'<span class="small" title="{escape(ORIGINS[claim.origin])}">{escape(claim.quantity)} · {claim.origin}</span></td>'
        f'<td class="number" data-name="measured">{escape(claim.found)}</td>'
        f'<td class="number" data-name="expected">{escape(str(claim.bound))}</td>'
        f"<td>{_verdict(claim.holds, WORDS[claim.holds])}</td></tr>"
        for claim in claims
    )
    return (
        '<table class="wide claims"><thead><tr><th>claim</th><th class="number">measured</th><th class="number">expected</th>'
        f"<th></th></tr></thead><tbody>{rows}</tbody></table>"
    )


def _table(table: Table) -> str:
    head = "".join(f"<th{_number(i)}>{escape(text)}</th>" for i, text in enumerate(table.headings))
    rows = "".join(
        "<tr>" + "".join(f"<td{_number(i)}>{escape(cell)}</td>" for i, cell in enumerate(row)) + "</tr>" for row in table.rows
    )
    opened = " open" if len(table.rows) <= SHOWN_ROWS else ""
    return (
        f"<details{opened}><summary>{escape(table.caption)}</summary>"
        f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div></details>'
    )


def _picture(picture: Picture) -> str:
    source = data_address(picture.data, {"svg": "image/svg+xml", "png": "image/png"}[picture.kind])
    caption = escape(picture.caption)
    return (
        f'<figure id="{escape(picture.name)}"><div class="big"><img alt="{caption}" src="{source}"></div>'
        f"<figcaption>{caption}</figcaption></figure>"
    )


def _number(column: int) -> str:
    return ' class="number"' if column else ""


def _class(holds: bool) -> str:
    return "holds" if holds else "fails"


def _verdict(holds: bool, text: str) -> str:
    sign = "✓" if holds else "✗"
    return f'<span class="verdict {_class(holds)}">{sign} {escape(text)}</span>'
