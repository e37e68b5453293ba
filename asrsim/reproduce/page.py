"""HTML page with the claims, numbers and pictures of every figure, in one self-contained file."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from importlib.resources import files

from asrsim import __version__
from asrsim.report.html import data_address, document
from asrsim.reproduce import Claim, FigurePart, FigurePicture, FigureTable, Reproduction

ORIGINS = {
    "paper": "stated in the paper",
    "theory": "from a closed form or a law of mechanics",
    "simulation": "from an independent simulation of the same experiment",
    "beyond": "not in the paper: with link damping that grows with the stiffness",
}
"""Origins of claims as words on the page, such as `stated in the paper`."""
SOURCE = (
    "Mengacci, Zambella, Grioli, Caporale, Catalano, Bicchi (2021): An Open-Source ROS-Gazebo Toolbox for Simulating Robots "
    "With Compliant Actuators, Frontiers in Robotics and AI 8"
)
SHOWN_ROWS = 9
"""Largest number of rows of a table that the page shows without folding."""


def page(reproductions: Sequence[Reproduction], *, seconds: float) -> str:
    """HTML of the page. seconds: total wall-clock time."""
    style = files("asrsim.reproduce").joinpath("assets/page.css").read_text(encoding="utf-8")
    failed = ", ".join(one.name for one in reproductions if not one.holds)
    overview = "".join(
        f'<tr><td><a href="#figure-{one.name}">Figure {one.name}</a></td><td>{escape(one.figure.title)}</td>'
        f'<td class="number">{_count(one.claims)}</td><td>{_verdict(one.holds)}</td></tr>'
        for one in reproductions
    )
    main = f"""<h1>The paper's experiments, run again</h1>
<p>{_verdict(not failed, f"claims of figure {failed} do not hold" if failed else "every claim holds")}</p>
<div class="scroll"><table><thead><tr><th>figure</th><th></th><th class="number">claims that hold</th><th></th></tr></thead>
<tbody>{overview}</tbody></table></div>
<p class="small">{escape(SOURCE)}. The paper's claims are given in our own words. They are checked on numbers, because the
data behind the paper's plots are not available. Results beyond the paper's figures are folded away.</p>
{"".join(map(_section, reproductions))}
<footer>Made by asrsim {__version__} with <code>asrsim reproduce</code> in {seconds:.0f} s.</footer>"""
    return document(f"asrsim reproduce: figures {', '.join(one.name for one in reproductions)}", style, main)


def _section(one: Reproduction) -> str:
    parts = "\n".join(_part(part, folded=number > 0) for number, part in enumerate(one.parts))
    if one.error:
        parts = f'<p class="fails">It could not be run: {escape(one.error)}</p>'
    figure = one.figure
    return f"""<section id="figure-{one.name}">
<div class="head"><h2>Figure {one.name}: {escape(figure.title)}</h2>{_verdict(one.holds)}</div>
<p class="small">Section {escape(figure.section)} of the paper. Reproduced in {one.seconds:.1f} s.</p>
<p class="paper">{escape(figure.paper)}</p>
{parts}
</section>"""


def _part(part: FigurePart, *, folded: bool) -> str:
    """HTML of a part: the paper's figure is shown unfolded; other parts are folded unless a claim fails."""
    claims = (
        '<table class="wide claims"><thead><tr><th>claim</th><th class="number">measured</th><th class="number">expected</th>'
        f"<th></th></tr></thead><tbody>{''.join(map(_claim, part.claims))}</tbody></table>"
    )
    body = "\n".join(
        [
            f"<p>{escape(part.text)}</p>", *map(_picture, part.pictures), claims if part.claims else "",
            *map(_table, part.tables),
        ]
    )  # fmt: skip
    if not folded:
        return f"<h3>{escape(part.title)}</h3>\n{body}"
    counted = f' <span class="small">{_count(part.claims)} claims hold</span>' if part.claims else ""
    opened = "" if all(claim.holds for claim in part.claims) else " open"
    return f'<details class="part"{opened}><summary>{escape(part.title)}{counted}</summary>\n{body}</details>'


def _claim(claim: Claim) -> str:
    return (
        f'<tr class="{"holds" if claim.holds else "fails"}"><td>{escape(claim.text)}'
        f'<span class="small" title="{escape(ORIGINS[claim.origin])}">{escape(claim.quantity)} · {claim.origin}</span></td>'
        f'<td class="number" data-name="measured">{escape(claim.found)}</td>'
        f'<td class="number" data-name="expected">{escape(str(claim.bound))}</td><td>{_verdict(claim.holds)}</td></tr>'
    )


def _table(table: FigureTable) -> str:
    def row(tag: str, cells: Sequence[str]) -> str:
        kind = ' class="number"'
        return "".join(f"<{tag}{kind if i else ''}>{escape(text)}</{tag}>" for i, text in enumerate(cells))

    rows = "".join(f"<tr>{row('td', cells)}</tr>" for cells in table.rows)
    state = " open" if len(table.rows) <= SHOWN_ROWS else ""
    return (
        f"<details{state}><summary>{escape(table.caption)}</summary>"
        f'<div class="scroll"><table><thead><tr>{row("th", table.headings)}</tr></thead>'
        f"<tbody>{rows}</tbody></table></div></details>"
    )


def _picture(picture: FigurePicture) -> str:
    source = data_address(picture.data, {"svg": "image/svg+xml", "png": "image/png"}[picture.kind])
    caption = escape(picture.caption)
    return (
        f'<figure id="{escape(picture.name)}"><div class="big"><img alt="{caption}" src="{source}"></div>'
        f"<figcaption>{caption}</figcaption></figure>"
    )


def _count(claims: Sequence[Claim]) -> str:
    return f"{sum(claim.holds for claim in claims)} of {len(claims)}"


def _verdict(holds: bool, text: str = "") -> str:
    word = text or ("holds" if holds else "does not hold")
    return f'<span class="verdict {"holds" if holds else "fails"}">{"✓" if holds else "✗"} {escape(word)}</span>'
