"""`draw_run`: the pictures of a run, from its log."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from asrsim.outfile import make_folder
from asrsim.plots.curves import read_curves
from asrsim.plots.figures import run_pages
from asrsim.plots.output import check_formats, save_figure, styled


def draw_run(
    log_path: str | os.PathLike[str], folder: str | os.PathLike[str], *, formats: Sequence[str] = ("png",), brief: bool = False
) -> list[Path]:
    """Draws one run into `folder`, which is made if needed, and returns the files; :func:`asrsim.plots.job.plot` does more.

    The files are `joints.png`, `energy.png`, and where there are many joints or objects `overview.png`, `objects.png`; more
    joints than fit on a page give `joints_1.png`, `joints_2.png` and so on. formats: of `png`, `pdf`, `svg`. brief: of many
    joints the overview and the first page, and no energies: what `asrsim run` draws. Raises LogError for files that are no
    logs, and OutputError.
    """
    kinds = check_formats(formats)
    place = make_folder(Path(folder))
    run = read_curves(log_path)
    written: list[Path] = []
    with styled():
        for page in run_pages([run], brief=brief):
            written += save_figure(page.figure, place, page.name, kinds)
    return written
