"""`asrsim report`: writes a page about the runs of a folder. (`asrsim.cli.report` prints the results of `asrsim run`.)"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from asrsim.cli.options import Json, Plugins, into_file, load_plugins


def report(
    folder: Annotated[
        Path,
        typer.Argument(metavar="FOLDER", help="Folder of a run, or of a scenario's variants; or a log.", show_default=False),
    ],
    out: Annotated[Path | None, into_file("The page to write.", ".html", ".htm", default="report.html in the folder")] = None,
    film: Annotated[bool, typer.Option("--film/--no-film", help="Also draw film strips.")] = True,
    plugin: Plugins = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing.")] = False,
    json: Json = False,
) -> None:
    """Write one HTML page about runs: interactive plots, measures, parameters with their sources. The page needs no network.

    The page includes a comparison that `asrsim plot` wrote into the folder (metrics.csv and its pictures).

    Example: asrsim report out/step_2dof
    """
    from asrsim.cli.console import json_errors, say, say_json, say_problems

    with json_errors(json):
        from asrsim.cli.progress import FractionBar
        from asrsim.report import write_report
        from asrsim.runs.folder import unreadable_logs

        load_plugins(plugin)
        say_problems(unreadable_logs(folder), "warning")
        with FractionBar(show=not quiet and not json) as progress:
            page = write_report(folder, out, film=film, progress=progress.update)
    if json:
        say_json({"ok": True, "report": str(page), "bytes": page.stat().st_size})
    elif not quiet:
        say(f"wrote {page} ({page.stat().st_size / 1e6:.2f} MB)")
