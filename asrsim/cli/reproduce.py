"""`asrsim reproduce`: repeats the paper's experiments, checks their claims, and writes one page."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from asrsim.cli.options import Json, into_folder

if TYPE_CHECKING:
    from asrsim.reproduce import Reproduction


def reproduce(
    figures: Annotated[
        list[str] | None, typer.Argument(metavar="[FIGURE]...", help="Figures 8, 11, 12, 13, 14, 15; all by default.")
    ] = None,
    out: Annotated[Path, into_folder("Folder for the results.")] = Path("out/reproduce"),
    workers: Annotated[int, typer.Option("--workers", "-j", min=1, help="Number of figures computed in parallel.")] = 2,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print only claims that do not hold.")] = False,
    json: Json = False,
) -> None:
    """Repeat the paper's experiments: every figure with its claims, measured numbers and verdicts on one page.

    Writes reproduce.html (self-contained), reproduce.json, pictures and the logs of all runs; files of an earlier call
    are replaced. Exit code: 0 if every claim holds, else 1; 130 after Ctrl-C.

    Example: asrsim reproduce

    Example: asrsim reproduce 8 15 --out paper
    """
    from asrsim.cli.console import json_errors, say, say_json

    with json_errors(json):
        from asrsim.reproduce import reproduce as run

        outcome = run(figures or (), out, workers=workers, on_figure=None if json else lambda one: _report(one, quiet=quiet))
    if json:
        say_json(outcome.as_dict())
    elif not quiet:
        simulated = sum(one.simulated for one in outcome.figures)
        say(f"{simulated:.0f} s simulated in {outcome.seconds:.1f} s; wrote {outcome.page}")
    if not outcome.holds:
        raise typer.Exit(1)


def _report(one: Reproduction, *, quiet: bool) -> None:
    import sys

    from asrsim.cli.console import complain, say, styled

    good = sum(claim.holds for claim in one.claims)
    if not quiet:
        verdict = styled("holds", "green") if one.holds else styled("does not hold", "red")
        say(
            f"figure {one.number}, {one.title}: {verdict}, {good} of {len(one.claims)} claims "
            f"({one.simulated:.0f} s simulated, {one.seconds:.1f} s)"
        )
        sys.stdout.flush()
    if one.error:
        complain(f"asrsim: figure {one.number} could not be run: {one.error}", "red")
    for claim in one.claims:
        if not claim.holds:
            complain(
                f"FAIL figure {one.number}: {claim.text}: {claim.quantity} is {claim.found}, expected {claim.bound}", "red"
            )
