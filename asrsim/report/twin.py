"""Page about what a twin found in a recording: external torques with alarms, stiffness, and residuals of the positions."""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from asrsim.errors import InputError
from asrsim.plots import style
from asrsim.plots.chart import Chart, Line, Shade
from asrsim.report.charts import page_data
from asrsim.report.html import section, table
from asrsim.report.page import HINT, NO_SCRIPT, folded, page_html
from asrsim.samples import Array

TWIN = "twin.csv"
MOST_BYTES = 500_000_000
"""Largest size of a table that is read, bytes."""
_HEADING = re.compile(r"(?P<joint>.+)\.(?P<field>external_torque|stiffness|residual|alarm)( \[(?P<unit>[^]]*)\])?")
COLOURS = {"external_torque": style.SKY, "stiffness": style.BLUE, "residual": style.PURPLE}


def twin_page(folder: Path) -> str:
    """HTML of the page about a twin's results in a folder. Raises InputError."""
    time, joints = _read(folder / TWIN)
    groups = [(joint, [chart for field, chart in _charts(time, fields).items()]) for joint, fields in joints.items()]
    rows = []
    for joint, fields in joints.items():
        torque, alarm = fields["external_torque"][1], fields["alarm"][1] > 0.5
        if np.isfinite(torque).any():
            at = int(np.nanargmax(np.abs(torque)))
            starts = np.flatnonzero(np.diff(alarm, prepend=False) & alarm)
            rms = float(np.sqrt(np.nanmean(torque**2)))
            rows.append(
                [joint, fields["external_torque"][0], f"{rms:.3g}", f"{torque[at]:.4g}", f"{time[at]:.3f}", str(len(starts))]
            )
    heads = ["joint", "unit", "RMS external torque", "largest", "at (s)", "alarms"]
    places = "".join(folded(n, joint, opened=n < 4) for n, joint in enumerate(joints))
    sections = [section("Joints", table(heads, rows)), section("External torques", HINT + places + NO_SCRIPT)]
    head = f"<p>Recording from {time[0]:g} to {time[-1]:g} s, {len(time)} steps</p>"
    return page_html(f"Twin · {folder.resolve().name}", sections, head=head, data=page_data(groups))


def _charts(time: Array, fields: dict[str, tuple[str, Array]]) -> dict[str, Chart]:
    rows = _kept(time, fields["external_torque"][1])
    charts = {}
    for field, colour in COLOURS.items():
        unit, values = fields.get(field, ("", np.full(len(time), np.nan)))
        bands = []
        if field == "external_torque":
            size = 1.1 * float(np.nanmax(np.abs(values), initial=0.0)) or 1.0
            edge = np.full(len(rows), size)
            alarm = fields["alarm"][1][rows] > 0.5
            bands = [Shade(label="alarm", x=time[rows], low=-edge, high=edge, colour=style.VERMILION, opacity=0.2, where=alarm)]
        words = field.replace("_", " ")
        line = Line(label=words, x=time[rows], y=values[rows], colour=colour)
        charts[field] = Chart(words=words, unit=unit, lines=[line], bands=bands)
    return charts


def _kept(time: Array, values: Array, most: int = 4000) -> NDArray[np.intp]:
    """Indices (k,) of the rows that a plot needs: the rows of the smallest and the largest value in each short interval."""
    if len(time) <= most:
        return np.arange(len(time))
    known = np.nan_to_num(values)
    edges = np.unique(np.linspace(0, len(time), most // 2 + 1).astype(int))
    ends = [(a + int(known[a:b].argmin()), a + int(known[a:b].argmax())) for a, b in pairwise(edges)]
    return np.unique(np.array([0, *np.ravel(ends), len(time) - 1]))


def _read(path: Path) -> tuple[Array, dict[str, dict[str, tuple[str, Array]]]]:
    """Times (n,) in s, and unit and values (n,) by joint and field, from a twin's table. Raises InputError."""
    try:
        if path.stat().st_size > MOST_BYTES:
            raise InputError(f"is larger than {MOST_BYTES / 1e6:g} MB", file=path, code="too-large")
        with path.open(encoding="utf-8") as stream:
            stream.readline()
            heads = stream.readline().rstrip("\n").split(",")
            rows = stream.readlines()
        values = np.loadtxt(rows, delimiter=",", ndmin=2) if rows else np.empty((0, len(heads)))
    except (OSError, ValueError) as error:
        raise InputError(f"cannot be read: {error}", file=path, hint="Expected twin.csv of asrsim twin", code="twin") from error
    joints: dict[str, dict[str, tuple[str, Array]]] = {}
    for heading, column in zip(heads[1:], values.T[1:], strict=False):
        if match := _HEADING.fullmatch(heading):
            joints.setdefault(match["joint"], {})[match["field"]] = (match["unit"] or "", column)
    joints = {name: fields for name, fields in joints.items() if {"external_torque", "alarm"} <= set(fields)}
    if heads[0] != "time [s]" or not joints or not len(values):
        raise InputError("has no columns of a twin", file=path, hint="Expected twin.csv of asrsim twin", code="twin")
    return values[:, 0], joints
