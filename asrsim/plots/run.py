"""`draw_run`: draws the pictures of a run from its log."""

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
    """Draw one run into `folder` (created if missing) and return the files; `asrsim.plots.job.plot` has more options.

    The files are `joints.png` and `energy.png`, and for many joints or objects `overview.png` and `objects.png`. Joints that
    do not fit on one page give `joints_1.png`, `joints_2.png` and so on. formats: of `png`, `pdf`, `svg`. brief: no energies;
    of many joints only the overview and the first page, as `asrsim run` draws them. Raises LogError for files that are not
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
