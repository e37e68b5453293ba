"""Reads the content of a report from a folder: logs, their summaries, and comparisons with recordings."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from asrsim.errors import AsrsimError
from asrsim.log import open_log
from asrsim.log.derived import DERIVED_FUNCTIONS, recorded_sources
from asrsim.metrics import METRICS, MetricRow, read_metrics, summarise
from asrsim.plain import PlainShape, misfit
from asrsim.plots.pairing import RECORDED
from asrsim.report.html import data_address
from asrsim.runs.folder import SUMMARY
from asrsim.samples import Array, RunInfo

STRIPS = 12
"""Largest number of runs that have film strips and are in the moving view."""
PICTURES = 4
"""Largest number of pictures of comparisons with recordings."""
PICTURE_BYTES = 200_000
"""Largest size of a picture in the page, bytes; larger pictures are left out."""
FRAMES = 6
"""Number of frames in a film strip."""


_NUMBER = (float, None)
_SUMMARY_SHAPE: PlainShape = {
    "robot": str, "variant": str, "total_substeps?": int, "speed?": _NUMBER, "simulated_time?": float,
    "joints": [
        {
            "name": str, "actuator": str, "mode": (int, None), "prismatic": bool, "limits?": {"*": int},
            **dict.fromkeys(("steady_state?", "steady_state_error?", "overshoot?", "settling?"), _NUMBER),
            **dict.fromkeys(("peak_deflection?", "motion_left?"), _NUMBER),
        }
    ],
    "expect": [{"text": str, "holds": bool}],
    "warnings?": [{"message?": str, "file?": (str, None), "line?": (int, None), "key?": (str, None), "hint?": (str, None)}],
    "certificate?": {"joints?": {"*": {"*": _NUMBER}}, "warnings?": [str]},
    "cross_check?": {
        "engine?": str, "other?": str, "joints?": {"*": {"*": _NUMBER}}, **dict.fromkeys(("finding?", "note?"), (str, None)),
    },
}  # fmt: skip
"""Keys of `summary.json` that the page uses, with the types of their values. A summary with another structure was edited. In
this case the page computes its numbers from the log.
"""


@dataclass(frozen=True, kw_only=True)
class ParameterRow:
    """Row of the page's table of parameters: one parameter of one joint."""

    name: str
    value: float
    unit: str
    origin: str
    """Source of the parameter in words: URDF tag with its line, default value, or scenario."""


@dataclass(frozen=True, kw_only=True)
class RunContent:
    """Data of a run for the page, without the run's time series."""

    log: Path
    info: RunInfo
    status: str
    message: str
    summary: Mapping[str, Any]
    """Content of `summary.json`, or the measures computed from the log."""
    parameters: Mapping[str, tuple[ParameterRow, ...]] = field(default_factory=dict)
    """Parameters of each joint."""
    notes: tuple[str, ...] = ()
    """Messages that name the data which could not be read, with the reasons."""


@dataclass(frozen=True, kw_only=True)
class Compared:
    """Comparison of runs with recordings, which `asrsim plot` has written into the folder."""

    metrics: tuple[MetricRow, ...]
    pictures: tuple[Path, ...]


def read_content(log: Path) -> RunContent:
    """Data of one run, read from its log and the files beside the log. Raises LogError."""
    reader = open_log(log)
    notes: list[str] = []
    summary = _summary(log, reader.info) or _own_summary(log)
    parameters: dict[str, tuple[ParameterRow, ...]] = {}
    try:
        parameters = read_parameters(reader.info)
    except AsrsimError as error:
        notes.append(f"the parameters cannot be read: {error}")
    return RunContent(
        log=log,
        info=reader.info,
        status=reader.status,
        message=reader.metadata.get("message", ""),
        summary=summary,
        parameters=parameters,
        notes=tuple(notes),
    )


def read_parameters(info: RunInfo) -> dict[str, tuple[ParameterRow, ...]]:
    """Parameters of each joint with their sources, from the robot and the scenario in a log. Raises InputError."""
    from asrsim.runs.rerun import restore
    from asrsim.scenario import apply_to_robot

    with TemporaryDirectory(prefix="asrsim-report-") as folder:
        scenario, robot = restore(info, Path(folder))
        robot = apply_to_robot(scenario, robot)
    found: dict[str, tuple[ParameterRow, ...]] = {}
    for block in robot.actuators:
        rows = []
        for value in block.parameters.values():
            where = f" <{value.tag}>" if value.tag and value.origin == "tag" else ""
            line = f", line {value.line}" if value.line is not None and value.origin == "tag" else ""
            rows.append(
                ParameterRow(name=value.name, value=value.value, unit=value.unit, origin=f"{value.origin}{where}{line}")
            )
        found[block.joint] = tuple(rows)
    return found


def find_comparison(folder: Path) -> Compared | None:
    """Metrics and pictures of the comparisons in a folder, in the folders of its variants, and in the subfolder `compared` of
    each of these folders. None without metrics.
    """
    metrics: list[MetricRow] = []
    pictures: list[Path] = []
    for place in _compared_folders(folder):
        with suppress(OSError, ValueError):
            metrics += read_metrics(place / METRICS)
            pictures += sorted(path for pattern in ("comparison*.png", "bode*.png") for path in place.glob(pattern))
    return Compared(metrics=tuple(metrics), pictures=tuple(pictures[:PICTURES])) if metrics else None


def _compared_folders(folder: Path) -> list[Path]:
    inner = sorted(path.parent for path in folder.glob(f"*/{METRICS}") if path.parent.name != "compared")
    return [folder, folder / "compared", *inner, *sorted(path.parent for path in folder.glob(f"*/compared/{METRICS}"))]


@dataclass(frozen=True, kw_only=True)
class Films:
    """Film strips and moving view of a page's runs."""

    strips: Mapping[Path, str]
    """Film strip of each log as a data URL (JPEG)."""
    motion: Mapping[str, Any] | None = None
    """Data of the moving view; None if no motion could be drawn."""
    notes: tuple[str, ...] = ()
    """Messages that name the pictures which could not be drawn, with the reasons."""


def read_films(logs: Sequence[Path], labels: Sequence[str]) -> Films:
    """Film strips of the logs, with a common camera and common times, and the moving view. labels: label of each log."""
    from io import BytesIO

    from asrsim.render import Film, film_strip, share_view, telling_times
    from asrsim.report.motion import motion_data

    films: dict[Path, Film] = {}
    said: dict[str, None] = {}
    for log in logs[:STRIPS]:
        try:
            films[log] = Film(log, size=250 if len(logs) > 1 else 300)
            said |= dict.fromkeys(films[log].notes)
        except AsrsimError as error:
            said[f"no film strip of {log.parent.name}: {error}"] = None
    if not films:
        return Films(strips={}, notes=tuple(said))
    share_view(list(films.values()))
    times = telling_times(list(films.values()), FRAMES)
    strips: dict[Path, str] = {}
    for log, film in films.items():
        buffer = BytesIO()
        film_strip([film.frame(time) for time in times], letters=0.07).save(buffer, format="JPEG", quality=84, optimize=True)
        strips[log] = data_address(buffer.getvalue(), "image/jpeg")
    names = [label for log, label in zip(logs, labels, strict=True) if log in films]
    return Films(strips=strips, motion=motion_data(list(films.values()), names), notes=tuple(said))


def recorded_curves(folder: Path, labels: Sequence[str]) -> dict[tuple[str, str, int], tuple[Array, Array]]:
    """Times and values of the recordings that `asrsim plot` compared with the runs, by (joint, quantity, index of the run)."""
    found: dict[tuple[str, str, int], tuple[Array, Array]] = {}
    for place in _compared_folders(folder):
        with suppress(OSError, ValueError, KeyError, TypeError):
            for entry in json.loads((place / RECORDED).read_text(encoding="utf-8"))["curves"]:
                names = (entry["run"], place.parent.name if place.name == "compared" else place.name)
                number = 0 if len(labels) == 1 else next((labels.index(name) for name in names if name in labels), None)
                if number is not None:
                    values = np.array([np.nan if v is None else v for v in entry["values"]], dtype=np.float64)
                    found[entry["joint"], entry["quantity"], number] = (np.array(entry["time"], dtype=np.float64), values)
    return found


def picture(path: Path) -> str | None:
    """PNG file as a data URL, with fewer colours. None if the file cannot be read, or if the picture is still too large."""
    from io import BytesIO

    from PIL import Image

    buffer = BytesIO()
    try:
        with Image.open(path) as image:
            image.convert("RGB").quantize(colors=64, dither=Image.Dither.NONE).save(buffer, format="PNG", optimize=True)
    except (OSError, ValueError):
        return None
    data = buffer.getvalue()
    return None if len(data) > PICTURE_BYTES else data_address(data)


def _summary(log: Path, info: RunInfo) -> dict[str, Any] | None:
    """Content of the `summary.json` beside a log; None if it is missing, damaged, or belongs to another log."""
    with suppress(OSError, ValueError, RecursionError):
        data = json.loads((log.parent / SUMMARY).read_text(encoding="utf-8"))
        fits = not misfit(data, _SUMMARY_SHAPE)
        if fits and data.get("variant") == info.variant and data.get("robot") == info.robot:
            return dict(data)
    return None


def _own_summary(log: Path) -> dict[str, Any]:
    """Summary computed from a log: the measures of each joint, and the claims of the scenario if they can be evaluated."""
    from asrsim.plots.claims import judge

    reader = open_log(log)
    joints = []
    for info in reader.info.joints:
        wanted = recorded_sources(("link_position", *DERIVED_FUNCTIONS), [info])
        samples = reader.read(quantities=wanted, joints=[info.name]).samples
        columns = {name: values[:, 0] for name, values in samples.values.items()}
        if "link_position" in columns:
            columns |= {name: function(samples, [info])[:, 0] for name, function in DERIVED_FUNCTIONS.items()}
        joints.append(
            {
                "name": info.name,
                "actuator": info.actuator,
                "mode": info.mode,
                "prismatic": info.prismatic,
                **summarise(samples.time, columns).as_dict(),
            }
        )
    claims: list[dict[str, Any]] = []
    with suppress(AsrsimError):
        claims = [{"text": result.text, "holds": result.holds} for result in judge(reader)]
    return {"joints": joints, "expect": claims}
