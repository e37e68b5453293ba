"""Makes the HTML page with the claims, numbers and pictures of every figure. The page is one self-contained file."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from asrsim import __version__
from asrsim.report.html import badge, data_address, table
from asrsim.report.page import page_html
from asrsim.reproduce.data import Claim, FigurePart, FigurePicture, FigureTable, Reproduction

ORIGINS = {
    "paper": "stated in the paper",
    "theory": "from a closed form or a law of mechanics",
    "simulation": "from an independent simulation of the same experiment",
    "beyond": "not in the paper: with link damping that grows with the stiffness",
}
"""Words on the page for the origin of a claim, such as `stated in the paper`."""
SOURCE = (
    "Mengacci, Zambella, Grioli, Caporale, Catalano, Bicchi (2021): An Open-Source ROS-Gazebo Toolbox for Simulating Robots "
    "With Compliant Actuators, Frontiers in Robotics and AI 8"
)
SHOWN_ROWS = 9
"""Largest number of rows that a table may have to be shown unfolded."""


def page(reproductions: Sequence[Reproduction], *, seconds: float) -> str:
    """HTML of the page. seconds: wall-clock time for all figures together."""
    failed = ", ".join(one.name for one in reproductions if not one.holds)
    heads = ["figure", "", "claims that hold", ""]
    overview = [[_link(one), escape(one.figure.title), _count(one.claims), _verdict(one.holds)] for one in reproductions]
    head = f"""<p>{_verdict(not failed, f"claims of figure {failed} do not hold" if failed else "every claim holds")}</p>
{table(heads, overview, raw=(0, 1, 2, 3), long=(1,))}
<p class="note">{escape(SOURCE)}. The paper's claims are given in our own words. They are checked on numbers, because the
data behind the paper's plots are not available. Results beyond the paper's figures are in collapsed sections.</p>"""
    foot = f"Made by asrsim {__version__} with <code>asrsim reproduce</code> in {seconds:.0f} s."
    return page_html("The paper's experiments, run again", [_section(one) for one in reproductions], head=head, foot=foot)


def _link(one: Reproduction) -> str:
    return f'<a href="#figure-{one.name}">Figure {one.name}</a>'


def _section(one: Reproduction) -> str:
    parts = "\n".join(_part(part, folded=number > 0) for number, part in enumerate(one.parts))
    if one.error:
        parts = f'<p class="bad">It could not be run: {escape(one.error)}</p>'
    figure = one.figure
    return f"""<section id="figure-{one.name}">
<div class="head"><h2>Figure {one.name}: {escape(figure.title)}</h2>{_verdict(one.holds)}</div>
<p class="note">Section {escape(figure.section)} of the paper. Reproduced in {one.seconds:.1f} s.</p>
<p class="quote">{escape(figure.paper)}</p>
{parts}
</section>"""


def _part(part: FigurePart, *, folded: bool) -> str:
    """HTML of a part of a figure's section. folded: whether the part is folded, unless one of its claims does not hold."""
    heads = ["claim", "measured", "expected", ""]
    claims = table(heads, [_claim(claim) for claim in part.claims], raw=(0, 3), long=(0,))
    body = "\n".join(
        [
            f"<p>{escape(part.text)}</p>",
            *map(_picture, part.pictures),
            claims if part.claims else "",
            *map(_table, part.tables),
        ]
    )
    if not folded:
        return f"<h3>{escape(part.title)}</h3>\n{body}"
    counted = f' <span class="note">{_count(part.claims)} claims hold</span>' if part.claims else ""
    opened = "" if all(claim.holds for claim in part.claims) else " open"
    return f'<details class="part"{opened}><summary>{escape(part.title)}{counted}</summary>\n{body}</details>'


def _claim(claim: Claim) -> list[str]:
    about = f"{escape(claim.quantity)} · {claim.origin}"
    text = f'{escape(claim.text)}<span class="note" title="{escape(ORIGINS[claim.origin])}">{about}</span>'
    return [text, claim.found, str(claim.bound), _verdict(claim.holds)]


def _table(one: FigureTable) -> str:
    state = " open" if len(one.rows) <= SHOWN_ROWS else ""
    return f"<details{state}><summary>{escape(one.caption)}</summary>{table(one.headings, one.rows)}</details>"


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
    return badge(f"{'✓' if holds else '✗'} {word}", good=holds)
