"""What a report says, gathered from a folder: logs, their summaries, comparisons."""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from asrsim.errors import AsrsimError, InputError, Problem
from asrsim.log import open_log
from asrsim.log.derived import DERIVED_FUNCTIONS, DERIVED_SOURCES
from asrsim.metrics import MetricRow, summarise
from asrsim.plain import Shape, misfit
from asrsim.samples import RunInfo

LOG, SUMMARY = "log.mcap", "summary.json"


_NUMBER = (float, None)
_SUMMARY_SHAPE: Shape = {
    "robot": str, "variant": str, "total_substeps?": int, "speed?": _NUMBER, "simulated_time?": float,
    "joints": [
        {
            "name": str, "actuator": str, "mode?": (int, None), "prismatic?": bool, "limits?": {"*": int},
            **dict.fromkeys(("steady_state?", "steady_state_error?", "overshoot?", "settling?", "frequency?"), _NUMBER),
            "peak_deflection?": _NUMBER,
        }
    ],
    "expect": [{"text": str, "holds": bool}],
    "warnings?": [{"message?": str, "file?": (str, None), "line?": (int, None), "key?": (str, None), "hint?": (str, None)}],
    "certificate?": {"joints?": {"*": {"*": _NUMBER}}, "warnings?": [str], "step?": _NUMBER, "scheme_order?": int},
}  # fmt: skip
"""What the page takes of a `summary.json`; one of another shape was edited, and is worked out anew."""
_METRICS_SHAPE: Shape = {
    "metrics": [{"source": str, "joint": str, "quantity": str, "measure": str, "unit": str, "value": _NUMBER}],
}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """A row of the table of parameters."""

    name: str
    value: float
    unit: str
    origin: str
    """In words: tag with line, default, scenario."""


@dataclass(frozen=True, kw_only=True)
class RunContent:
    """One run, besides its series."""

    log: Path
    info: RunInfo
    status: str
    message: str
    summary: Mapping[str, Any]
    """`summary.json`, or what could be worked out without one."""
    parameters: Mapping[str, tuple[Parameter, ...]] = field(default_factory=dict)
    """Joint -> parameters."""
    notes: tuple[str, ...] = ()
    """What could not be found out, and why."""


@dataclass(frozen=True, kw_only=True)
class Compared:
    """A comparison with experiments that `asrsim plot` left in the folder."""

    folder: Path
    metrics: tuple[MetricRow, ...]
    pictures: tuple[Path, ...]


def find_logs(folder: Path) -> list[Path]:
    """Logs of a folder: its own, else those of its subfolders (variants). Raises InputError where there is none."""
    if folder.is_file():
        return [folder]
    own = [folder / LOG] if (folder / LOG).is_file() else sorted(folder.glob("*.mcap"))
    logs = own or sorted(folder.glob(f"*/{LOG}"))
    if not logs:
        message = "holds no log of a run (log.mcap), nor does a folder in it"
        hint = "Run a scenario first: asrsim run scenario.yaml"
        raise InputError(Problem(message=message, file=folder, hint=hint, code="no-log"))
    return logs


def read_content(log: Path) -> RunContent:
    """Everything about one run. Raises LogError."""
    reader = open_log(log)
    notes: list[str] = []
    summary = _summary(log, reader.info) or _own_summary(log)
    parameters: dict[str, tuple[Parameter, ...]] = {}
    try:
        parameters = read_parameters(reader.info)
    except AsrsimError as error:
        notes.append(f"parameters' sources cannot be told: {error}")
        parameters = {
            joint: tuple(Parameter(name=name, value=value, unit="", origin="log") for name, value in values.items())
            for joint, values in reader.info.resolved.get("parameters", {}).items()
        }
    return RunContent(
        log=log, info=reader.info, status=reader.status, message=reader.metadata.get("message", ""), summary=summary,
        parameters=parameters, notes=tuple(notes),
    )  # fmt: skip


def read_parameters(info: RunInfo) -> dict[str, tuple[Parameter, ...]]:
    """Joint -> parameters with their sources, as the log's robot and scenario give them. Raises InputError."""
    from asrsim.runs.repeat import restore
    from asrsim.scenario import apply_to_robot

    with TemporaryDirectory(prefix="asrsim-report-") as folder:
        scenario, robot = restore(info, Path(folder))
        robot = apply_to_robot(scenario, robot)
    found: dict[str, tuple[Parameter, ...]] = {}
    for block in robot.actuators:
        rows = []
        for value in block.parameters.values():
            where = f" <{value.tag}>" if value.tag and value.origin == "tag" else ""
            line = f", line {value.line}" if value.line is not None and value.origin == "tag" else ""
            rows.append(Parameter(name=value.name, value=value.value, unit=value.unit, origin=f"{value.origin}{where}{line}"))
        found[block.joint] = tuple(rows)
    return found


def find_comparison(folder: Path) -> Compared | None:
    """The metrics and pictures of a comparison in the folder or its `compared`, if there is one."""
    for place in (folder, folder / "compared"):
        with suppress(OSError, ValueError, RecursionError):
            data = json.loads((place / "metrics.json").read_text(encoding="utf-8"))
            if misfit(data, _METRICS_SHAPE):
                continue
            rows = data["metrics"]
            pictures = sorted(path for pattern in ("comparison*.png", "bode*.png") for path in place.glob(pattern))
            metrics = tuple(MetricRow(**{**row, "value": math.nan if row["value"] is None else row["value"]}) for row in rows)
            return Compared(folder=place, metrics=metrics, pictures=tuple(pictures[:6]))
    return None


def film_strips(logs: list[Path], *, frames: int = 6) -> tuple[dict[Path, str], list[str]]:
    """Log -> film strip as a data address (JPEG); and why there is none for some."""
    from io import BytesIO

    from asrsim.plots.output import styled
    from asrsim.render import Film, even_times, film_strip

    strips: dict[Path, str] = {}
    said: dict[str, None] = {}
    for log in logs[:4]:
        try:
            with Film(log, size=380) as film:
                pictures = list(film.frames(even_times(film, frames)))
                said |= dict.fromkeys(film.notes)
        except AsrsimError as error:
            said[f"no film strip of {log.parent.name}: {error}"] = None
            continue
        with styled():
            buffer = BytesIO()
            film_strip(pictures).savefig(buffer, format="jpeg", dpi=130, pil_kwargs={"quality": 82, "optimize": True})
        strips[log] = "data:image/jpeg;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")
    return strips, list(said)


def picture(path: Path, *, most: int = 250_000) -> str | None:
    """A PNG as a data address, None if it is too large for the page."""
    data = path.read_bytes()
    return None if len(data) > most else "data:image/png;base64," + base64.b64encode(data).decode("ascii")


def _summary(log: Path, info: RunInfo) -> dict[str, Any] | None:
    """The summary beside a log, if it is that log's."""
    with suppress(OSError, ValueError, RecursionError):
        data = json.loads((log.parent / SUMMARY).read_text(encoding="utf-8"))
        fits = not misfit(data, _SUMMARY_SHAPE)
        if fits and data.get("variant") == info.variant and data.get("robot") == info.robot:
            return dict(data)
    return None


def _own_summary(log: Path) -> dict[str, Any]:
    """Measures of each joint, from the log; the claims of its scenario, if they can be judged."""
    from asrsim.plots.claims import judge

    reader = open_log(log)
    joints = []
    for info in reader.info.joints:
        wanted = {"link_position", *(name for sources in DERIVED_SOURCES.values() for name in sources)}
        samples = reader.read(quantities=[n for n in info.quantities if n in wanted], joints=[info.name]).samples
        columns = {name: values[:, 0] for name, values in samples.values.items()}
        if "link_position" in columns:
            columns |= {name: function(samples, [info])[:, 0] for name, function in DERIVED_FUNCTIONS.items()}
        joints.append(
            {"name": info.name, "actuator": info.actuator, "mode": info.mode, "prismatic": info.prismatic,
             **summarise(samples.time, columns).as_dict()}
        )  # fmt: skip
    claims: list[dict[str, Any]] = []
    with suppress(AsrsimError):
        claims = [{"text": result.text, "holds": result.holds} for result in judge(reader)]
    return {"joints": joints, "expect": claims}
