"""Display of results in notebooks, and conversion of results to pandas."""

from __future__ import annotations

import html
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from asrsim.extras import library

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from PIL.Image import Image

    from asrsim.api import Result
    from asrsim.viewer import View

WIDTH = 900
"""Width in pixels of the picture that a notebook displays for a result."""


def run_picture(result: Result, *, joints: Sequence[str] | None = None, quantities: Sequence[str] | None = None) -> Figure:
    """The first picture that `asrsim plot` draws for the run. It shows the joints of the run, or only the given quantities."""
    from asrsim.plots.curves import read_curves, require_curves
    from asrsim.plots.figures import run_pages
    from asrsim.plots.output import styled

    with _logged(result) as log:
        curves = read_curves(log, joints=joints, quantities=quantities, bodies=quantities is None)
        require_curves([curves], quantities or ())
    with styled():
        return next(iter(run_pages([curves], quantities=quantities))).figure


def film_strip(result: Result, *, count: int) -> Image:
    """Film strip of the run with `count` frames, as drawn by `asrsim render`."""
    from asrsim.render import Film, strip_of

    with _logged(result) as log:
        return strip_of(Film(log), count=count)


def page_of(result: Result, beside: Sequence[str | Path], port: int) -> View:
    """Page that plays the run, as opened by `asrsim view`."""
    from asrsim.viewer import view

    with _logged(result) as log:
        return view(log, *beside, port=port)


@contextmanager
def _logged(result: Result) -> Iterator[Path]:
    """Path of the log of a result. For a result without a log, a temporary log is written."""
    from asrsim.log import LogWriter

    if result.log is not None:
        yield result.log
        return
    with TemporaryDirectory(prefix="asrsim-notebook-") as folder:
        log = Path(folder) / "log.mcap"
        with LogWriter(log, result.run.info) as writer:
            writer.write(result.samples)
            writer.close({"status": result.status})
        yield log


def as_html(result: Result) -> str:
    """HTML of a result for a notebook, with a short table of the joints and a picture."""
    from io import BytesIO

    from asrsim.report.html import bullets, column_table, data_address
    from asrsim.summary.table import headline, limit_columns, measure_columns, rest_note

    summary = result.summary
    joints = [joint.as_dict() for joint in summary.joints]
    columns = (*measure_columns(joints), *limit_columns(joints, [summary.total_substeps or 1] * len(joints)))
    remarks = [f"{'pass' if claim.holds else 'FAIL'} {claim.text}" for claim in summary.claims]
    remarks += filter(None, [rest_note(joints)])
    remarks += [f"warning {warning}" for warning in summary.warnings[:5]]
    figure = run_picture(result)
    stream = BytesIO()
    figure.savefig(stream, format="png", dpi=WIDTH / figure.get_size_inches()[0])
    title = html.escape(f"{summary.scenario} / {summary.variant}")
    return (
        f"<p><b>{title}</b> {html.escape(headline(summary))}</p>{column_table(columns)}{bullets(remarks)}"
        f'<img width="{WIDTH}" style="max-width:100%" src="{data_address(stream.getvalue())}"/>'
    )


def as_pandas(result: Result) -> Any:
    """DataFrame with one row per sample, indexed by time in s, and one column per joint and quantity, recorded or derived."""
    pandas = library("pandas", "notebook")
    table = {(joint, name): result[joint][name] for joint in result.joints for name in result[joint]}
    table = {key: values for key, values in table.items() if not np.isnan(values).all()}
    index = pandas.Index(result.time, name="time")
    columns = pandas.MultiIndex.from_tuples(list(table), names=("joint", "quantity"))
    return pandas.DataFrame(np.column_stack(list(table.values())), index=index, columns=columns)
