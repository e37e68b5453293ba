"""Writes a page about the results in a folder, which may be results of runs, a fit, a study, learning, or a twin."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from asrsim.errors import Problem
from asrsim.outfile import check_output, make_folder, write_text
from asrsim.plots import style
from asrsim.plots.curves import distinct_labels
from asrsim.progress import Progress, Tell, tell_nobody
from asrsim.report.content import Films, find_comparison, read_content, read_films, recorded_curves
from asrsim.report.plots import joint_sections, page_quantities
from asrsim.report.runs import runs_page
from asrsim.report.series import read_runs
from asrsim.runs.folder import find_logs

PAGE = "report.html"


def write_report(
    folder: str | os.PathLike[str],
    path: str | os.PathLike[str] | None = None,
    *,
    film: bool = True,
    progress: Tell | None = None,
) -> Path:
    """Write a self-contained page about the results in a folder.

    Args:
        folder: Folder of a run, or of a scenario's variants, or a log; or the folder of `identify`, `sweep`, `ilc` or `twin`.
        path: File of the page; None: `report.html` in the folder.
        film: Whether film strips and the moving view are also drawn.
        progress: Function that is called with the present task and the finished fraction of this task.

    Returns:
        Path of the page.

    Raises:
        InputError: The folder contains no results, or its results are damaged.
        LogError: A log cannot be read.
        OutputError: The page cannot be written.
    """
    place = Path(folder)
    page = Path(path) if path is not None else (place.parent if place.is_file() else place) / PAGE
    tell = progress or tell_nobody
    tell(Progress(task="reading", fraction=0.1))
    home, kind = _kind(place)
    if kind is not None:
        check_output(page, "page", inputs=[home / kind])
        text = _other_page(home, kind)
    else:
        logs, _ = find_logs(place)
        check_output(page, "page", inputs=logs)
        text = _runs_page(place, logs, film=film, tell=tell)
    make_folder(page.parent)
    write_text(page, text, "page")
    return page


KINDS = ("fit.json", "study.json", "ilc.json", "twin.csv")
"""Files by which the folder of a fit, a study, a learning session or a twin is recognised."""


def unreadable_logs(place: Path) -> list[Problem]:
    """Problems of the logs that a page about runs leaves out. Raises InputError if there are no results for a page."""
    return find_logs(place)[1] if _kind(place)[1] is None else []


def _kind(place: Path) -> tuple[Path, str | None]:
    """Folder of the results at a path, and the name of the file in `KINDS` by which the kind of results was recognised; None
    for runs."""
    if place.is_file():
        return place.parent, place.name if place.name in KINDS else None
    return place, next((name for name in KINDS if (place / name).is_file()), None)


def _other_page(folder: Path, kind: str) -> str:
    # Import each page only if it is needed, since each page needs another part of asrsim, which takes time to load.
    if kind == "fit.json":
        from asrsim.report.fit import fit_page

        return fit_page(folder)
    if kind == "study.json":
        from asrsim.report.study import study_page

        return study_page(folder)
    if kind == "ilc.json":
        from asrsim.report.learning import learning_page

        return learning_page(folder)
    from asrsim.report.twin import twin_page

    return twin_page(folder)


def _runs_page(place: Path, logs: Sequence[Path], *, film: bool, tell: Tell) -> str:
    grid, runs = read_runs(logs, quantities=page_quantities())
    labels = [run.label for run in distinct_labels(runs)]
    tell(Progress(task="reading", fraction=0.5))
    contents = [read_content(log) for log in logs]
    beside = place if place.is_dir() else place.parent
    data = {
        "grid": grid.as_dict(),
        "runs": [{"label": label, "colour": style.variant_colour(n)} for n, label in enumerate(labels)],
        "groups": joint_sections(runs, recorded_curves(beside, labels), grid.time),
    }
    tell(Progress(task="film strip", fraction=0.9))
    films = read_films(logs, labels) if film else Films(strips={})
    return runs_page(contents, labels, data=data, films=films, compared=find_comparison(beside))
