"""Page about iterative learning: errors over the iterations, learned inputs beside the desired motion, and motor demands."""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.errors import InputError
from asrsim.plain import PlainShape, misfit
from asrsim.plots import style
from asrsim.plots.chart import Chart, Line
from asrsim.recordings import read_recording
from asrsim.report.charts import page_data
from asrsim.report.html import badge, number, section, table
from asrsim.report.page import HINT, NO_SCRIPT, folded, page_html

NUMBERS, INPUTS, DESIRED, PLAYBACK = "ilc.json", "learned.csv", "desired.csv", "learned.yaml"
_NUMBER = (float, None)
_SHAPE: PlainShape = {
    "scenario": str,
    "variant": str,
    "outcome": str,
    "converged": bool,
    "reason": str,
    "iterations": int,
    "best": int,
    "law": str,
    "reach?": str,
    "trials": [{"iteration": int, "largest_error": {"*": _NUMBER}, "rms_error": {"*": _NUMBER}, "*": object}],
    "demands?": [{"joint?": str, "what?": str, "needed?": _NUMBER, "limit?": _NUMBER, "unit?": str, "*": object}],
    "*": object,
}


def learning_page(folder: Path) -> str:
    """HTML of the page about the learning in a folder. Raises InputError."""
    data = _read(folder / NUMBERS)
    joints = list(data["trials"][0]["largest_error"]) if data["trials"] else []
    groups = [(joint, [_errors(data, joint), *_motions(folder, joint)]) for joint in joints]
    shown = "".join(folded(n, joint, opened=n < 4) for n, joint in enumerate(joints))
    trials = [
        [str(one["iteration"]), *(number(one[kind].get(joint)) for joint in joints for kind in ("largest_error", "rms_error"))]
        for one in data["trials"]
    ]
    heads = ["iteration", *(f"{kind} error of {joint}" for joint in joints for kind in ("largest", "RMS"))]
    demands = [
        [one.get("joint", ""), one.get("what", ""), number(one.get("needed")), number(one.get("limit")), one.get("unit", "")]
        for one in data.get("demands", ())
    ]
    commands = f"asrsim run {shlex.quote(str(folder / PLAYBACK))}"
    sections = [
        section("Errors and motions", HINT + shown + NO_SCRIPT) if joints else "",
        section(
            "Demands of the motion",
            f"<p>{escape(data.get('reach', ''))}</p>" + table(["joint", "demand", "needed", "limit", "unit"], demands),
        )
        if demands
        else "",
        section("Iterations", table(heads, trials)) if trials else "",
        section("Play what was learned", f"<pre>{escape(commands)}</pre>"),
    ]
    name = Path(data["scenario"]).stem + (f" · {data['variant']}" if data["variant"] not in ("", "default") else "")
    head = f"<p>{badge(data['outcome'], good=data['converged'])} {escape(data['reason'])}; law {escape(data['law'])}</p>"
    return page_html(f"Learning {name}", sections, head=head, data=page_data(groups))


def _errors(data: Mapping[str, Any], joint: str) -> Chart:
    numbers = np.array([float(one["iteration"]) for one in data["trials"]])
    lines = [
        Line(
            label=label,
            x=numbers,
            y=np.array([one[kind].get(joint) or np.nan for one in data["trials"]], float),
            colour=colour,
            kind="both",
        )
        for label, kind, colour in (("largest", "largest_error", style.VERMILION), ("RMS", "rms_error", style.GREY))
    ]
    return Chart(words="error", across="iteration", across_unit="", lines=lines, logarithmic="y")


def _motions(folder: Path, joint: str) -> list[Chart]:
    """Desired position and learned inputs of a joint, from the files beside ilc.json that can be read."""
    series: dict[str, list[Line]] = {}
    for name, label, colour in ((DESIRED, "desired position", style.BLACK), (INPUTS, "learned input", style.BLUE)):
        try:
            channels = read_recording(folder / name).channels.values()
        except (InputError, OSError):
            continue
        for one in (one for one in channels if one.joint == joint and one.quantity):
            series.setdefault(one.unit, []).append(Line(label=label, x=one.time, y=one.values, colour=colour))
    return [Chart(words="motion and input", unit=unit, lines=lines) for unit, lines in series.items()]


def _read(path: Path) -> Any:
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"cannot be read: {error}", file=path, code="unreadable-learning") from error
    if fault := misfit(data, _SHAPE):
        raise InputError(fault, file=path, hint="Expected ilc.json of asrsim ilc", code="unreadable-learning")
    return data
