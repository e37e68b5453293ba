"""`asrsim reproduce`: repeats the paper's experiments, checks their claims, and writes one page."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from asrsim.cli.command import Done, command
from asrsim.cli.console import complain, say, styled
from asrsim.cli.options import Texts, argument, into_folder, option

if TYPE_CHECKING:
    from asrsim.reproduce import Reproduction


@command("Print only claims that do not hold.", plugins=False)
def reproduce(
    figures: Annotated[Texts, argument("[FIGURE]...", "Figures 8, 11, 12, 13, 14, 15; all by default.")] = None,
    out: Annotated[Path, into_folder("Folder for the results.")] = Path("out/reproduce"),
    workers: Annotated[int, option("Number of figures computed in parallel.", "--workers", "-j", min=1)] = 2,
    *,
    quiet: bool,
    json: bool,
) -> Done:
    """Repeat the paper's experiments: every figure with its claims, measured numbers and verdicts on one page.

    The command writes reproduce.html (self-contained), reproduce.json, pictures and the logs of all runs. Files of an earlier
    call are replaced. Exit code: 0 if every claim holds, else 1; 130 after Ctrl-C.

    Example: asrsim reproduce

    Example: asrsim reproduce 8 15 --out paper
    """
    from asrsim.reproduce import reproduce as run

    outcome = run(figures or (), out, workers=workers, on_figure=None if json else lambda one: _report(one, quiet=quiet))
    return Done(
        data=outcome.as_dict(),
        text=lambda: say(f"wrote {outcome.page} in {outcome.seconds:.1f} s"),
        code=int(not outcome.holds),
    )


def _report(one: Reproduction, *, quiet: bool) -> None:
    good = sum(claim.holds for claim in one.claims)
    if not quiet:
        verdict = styled("holds", "green") if one.holds else styled("does not hold", "red")
        say(f"figure {one.name}, {one.figure.title}: {verdict}, {good} of {len(one.claims)} claims ({one.seconds:.1f} s)")
        sys.stdout.flush()
    if one.error:
        complain(f"asrsim: figure {one.name} could not be run: {one.error}", "red")
    for claim in one.claims:
        if not claim.holds:
            complain(f"FAIL figure {one.name}: {claim.text}: {claim.quantity} is {claim.found}, expected {claim.bound}", "red")
