"""`write_report`: writes a page about the runs of a folder."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from asrsim.outfile import check_output, make_folder, write_text
from asrsim.plots import style
from asrsim.plots.curves import distinct_labels
from asrsim.report.content import Films, find_comparison, read_content, read_films, recorded_curves
from asrsim.report.page import build_page
from asrsim.report.plots import QUANTITIES, joint_sections
from asrsim.report.series import read_runs
from asrsim.runs.folder import find_logs

PAGE = "report.html"


def write_report(
    folder: str | os.PathLike[str],
    path: str | os.PathLike[str] | None = None,
    *,
    film: bool = True,
    progress: Callable[[str, float], None] | None = None,
) -> Path:
    """Write a self-contained page about the run in a folder, or about a folder of variants.

    Args:
        folder: Folder with a log (`log.mcap` or another), or with subfolders that contain a log; or a log.
        path: The page; `report.html` in the folder by default.
        film: Also draw film strips and the moving view.
        progress: Called with the current task and the fraction done.

    Returns:
        Path of the page.

    Raises:
        InputError: The folder contains no log. LogError: A log cannot be read.
        OutputError: The page cannot be written.
    """
    place = Path(folder)
    page = Path(path) if path is not None else (place.parent if place.is_file() else place) / PAGE
    tell = progress or (lambda what, fraction: None)
    logs, _ = find_logs(place)
    check_output(page, "page", inputs=logs)
    tell("reading", 0.1)
    grid, runs = read_runs(logs, quantities=QUANTITIES)
    labels = [run.label for run in distinct_labels(runs)]
    tell("reading", 0.5)
    contents = [read_content(log) for log in logs]
    beside = place if place.is_dir() else place.parent
    data = {
        "grid": grid.as_dict(),
        "runs": [{"label": label, "colour": style.variant_colour(n)} for n, label in enumerate(labels)],
        "joints": joint_sections(runs, recorded_curves(beside, labels), grid.time),
    }
    tell("film strip", 0.9)
    films = read_films(logs, labels) if film else Films(strips={})
    text = build_page(contents, labels, data=data, films=films, compared=find_comparison(beside))
    make_folder(page.parent)
    write_text(page, text, "page")
    return page
