"""`asrsim report`: writes a page about the results in a folder. (`asrsim.cli.report` prints the results of `asrsim run`.)"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from asrsim.cli.command import Done, command
from asrsim.cli.console import say, say_problems
from asrsim.cli.options import argument, into_file, option


@command("Print nothing.")
def report(
    folder: Annotated[
        Path,
        argument("FOLDER", "Log, or folder of a run, a scenario's variants, a fit, a study, learning or a twin."),
    ],
    out: Annotated[Path | None, into_file("The page to write.", ".html", ".htm", default="report.html in the folder")] = None,
    film: Annotated[bool, option("Also draw film strips and the moving view.", "--film/--no-film")] = True,
    *,
    quiet: bool,
) -> Done:
    """Write one HTML page about results: interactive plots, numbers, commands for the next step. The page needs no network.

    The page of runs shows the moving robot, claims, measures, parameters with their sources, and a comparison that
    `asrsim plot` wrote into the folder. The page of `identify` shows recordings and simulations, residuals and their spectra,
    intervals, profiles, correlations. The page of `sweep` shows results over keys, Sobol indices, best and worst rows. The
    pages of `ilc` and `twin` show their results.

    Example: asrsim report out/step_2dof
    """
    from asrsim.cli.progress import FractionBar
    from asrsim.report import write_report
    from asrsim.report.write import unreadable_logs

    say_problems(unreadable_logs(folder), "warning")
    with FractionBar(show=not quiet) as progress:
        page = write_report(folder, out, film=film, progress=progress.update)
    size = page.stat().st_size
    return Done(data={"ok": True, "report": page, "bytes": size}, text=lambda: say(f"wrote {page} ({size / 1e6:.2f} MB)"))
