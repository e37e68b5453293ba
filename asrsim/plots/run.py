"""`draw_run`: the pictures of a run, from its log."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from asrsim.outfile import make_folder
from asrsim.plots.curves import Progress, distinct_labels, read_curves
from asrsim.plots.figures import run_pages
from asrsim.plots.output import check_formats, save_figure, styled


def draw_run(
    log_path: str | os.PathLike[str], folder: str | os.PathLike[str], *, formats: Sequence[str] = ("png",), brief: bool = False
) -> list[Path]:
    """Draws one run into `folder`; see :func:`draw_runs`."""
    return draw_runs([log_path], folder, formats=formats, brief=brief)


def draw_runs(
    logs: Sequence[str | os.PathLike[str]],
    folder: str | os.PathLike[str],
    *,
    formats: Sequence[str] = ("png",),
    joints: Sequence[str] | None = None,
    quantities: Sequence[str] | None = None,
    start: float | None = None,
    end: float | None = None,
    brief: bool = False,
    progress: Progress | None = None,
) -> list[Path]:
    """Draws a run, or several as variants by colour, into `folder`, which is made if needed.

    Args:
        logs: Log files.
        folder: Takes `joints.png`, `energy.png`, and where there are many joints or objects `overview.png`, `objects.png`;
            more joints than fit on a page give `joints_1.png`, `joints_2.png`, ...
        formats: Of `png`, `pdf`, `svg`.
        joints: All by default.
        quantities: Draw these instead (`quantities.png`), stored or derived.
        start, end: s, only this part.
        brief: Of many joints the overview and the first page, and no energies: what `asrsim run` draws.
        progress: Told the fraction of the logs that is read.

    Returns:
        The files written.

    Raises:
        LogError: For unknown names and files that are no logs.
        OutputError: Where a file cannot be written.
    """
    kinds = check_formats(formats)
    place = make_folder(Path(folder))
    runs = []
    for number, path in enumerate(logs):

        def told(fraction: float, number: int = number) -> None:
            if progress is not None:
                progress((number + fraction) / len(logs))

        runs.append(
            read_curves(
                path, joints=joints, quantities=quantities, bodies=quantities is None, start=start, end=end, progress=told
            )
        )  # fmt: skip
    runs = distinct_labels(runs)
    written: list[Path] = []
    with styled():
        for page in run_pages(runs, quantities=quantities, brief=brief):
            written += save_figure(page.figure, place, page.name, kinds)
    return written
