"""Page about runs: motion, claims, measures, plots, parameters, and commands that repeat the runs."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from asrsim.errors import Problem
from asrsim.plots.rows import metric_tables
from asrsim.report.content import Compared, Films, RunContent, picture
from asrsim.report.html import badge, bullets, column_table, number, section, table
from asrsim.report.page import HINT, NO_SCRIPT, folded, page_html
from asrsim.summary.table import difference_columns, limit_columns, measure_columns, rest_note
from asrsim.tables import TableColumn

OPENED = 2
"""Number of joints whose plots are unfolded at first."""


def runs_page(
    runs: Sequence[RunContent],
    labels: Sequence[str],
    *,
    data: Mapping[str, Any],
    films: Films,
    compared: Compared | None,
) -> str:
    """HTML of the page about runs. labels: label of each run; data: data of the page's plots."""
    first = runs[0].info
    sections = [
        _strips(runs, labels, films),
        _claims(runs, labels),
        _joints(runs, labels),
        _compared(compared),
        _plots(data),
        _accuracy(runs, labels),
        _parameters(runs, labels),
        _warnings(runs, labels, films.notes),
        _repeat(runs),
    ]
    title = " · ".join(filter(None, (first.robot, first.scenario_name)))
    return page_html(title, sections, head=_head(runs, labels), data=data, motion=films.motion)


def _head(runs: Sequence[RunContent], labels: Sequence[str]) -> str:
    rows = []
    for run, label in zip(runs, labels, strict=True):
        s, meta = run.summary, run.info.metadata
        substeps = str(meta.get("substeps", "?"))
        more = meta.get("motor_substeps", "1")
        rows.append(
            [
                label or "default",
                badge(run.status, good=run.status == "complete"),
                f"{s['simulated_time']:.6g} s" if "simulated_time" in s else "",
                f"{run.info.step * 1e3:g} ms",
                substeps if more == "1" else f"{substeps} x {more}",
                meta.get("stepping", ""),
                meta.get("engine", ""),
                meta.get("seed", ""),
                f"{s['speed']:.3g} x real time" if s.get("speed") else "",
            ]
        )
    heads = ["variant", "status", "time", "step", "substeps", "stepping", "engine", "seed", "speed"]
    messages = "".join(f'<p class="bad">{escape(run.message)}</p>' for run in runs if run.message)
    return f"{table(heads, rows, raw=(1,))}{messages}"


def _claims(runs: Sequence[RunContent], labels: Sequence[str]) -> str:
    items = []
    for run, label in zip(runs, labels, strict=True):
        for claim in run.summary.get("expect", ()):
            who = f"<b>{escape(label)}</b> " if len(runs) > 1 else ""
            verdict = badge("holds" if claim["holds"] else "fails", good=bool(claim["holds"]))
            text = str(claim["text"]).removesuffix(": holds").removesuffix(": does not hold")
            items.append(f"<li>{verdict} {who}{escape(text)}</li>")
    return section("Expectations", f'<ul class="plain">{"".join(items)}</ul>') if items else ""


_MOTION = (
    '<div id="motion"><canvas aria-label="the moving robot"></canvas><div class="controls">'
    '<button type="button" class="play" aria-label="play">▶</button>'
    '<input type="range" aria-label="time"><span class="clock"></span>'
    '<select class="speed" aria-label="speed"><option value="0.1">0.1 x</option><option value="0.25">0.25 x</option>'
    '<option value="1" selected>1 x</option><option value="4">4 x</option></select>'
    '<select class="run" aria-label="run"></select></div>'
    '<p class="note">Drag to turn, wheel to zoom, Shift or right button to move, double-click for the first view.</p></div>'
)
"""HTML of the moving view, which `motion.js` draws."""


def _strips(runs: Sequence[RunContent], labels: Sequence[str], films: Films) -> str:
    figures = [
        f'<figure><img src="{films.strips[run.log]}" alt="film strip of {escape(label, quote=True)}">'
        f"<figcaption>{escape(label)}</figcaption></figure>"
        for run, label in zip(runs, labels, strict=True)
        if run.log in films.strips
    ]
    left = f"<p class='note'>Of the first {len(figures)} runs.</p>" if 0 < len(figures) < len(runs) else ""
    moving = _MOTION if films.motion else ""
    return section("Motion", f'{moving}<div class="strips">{"".join(figures)}</div>{left}') if figures else ""


def _joints(runs: Sequence[RunContent], labels: Sequence[str]) -> str:
    entries = [(run, label, joint) for run, label in zip(runs, labels, strict=True) for joint in run.summary.get("joints", ())]
    joints = [joint for *_, joint in entries]
    limits = limit_columns(joints, [run.summary.get("total_substeps") or 1 for run, *_ in entries])
    columns = [TableColumn("variant", [label for _, label, _ in entries])] if len(runs) > 1 else []
    note = f"<p class='note'>{escape(moving[:1].upper() + moving[1:])}.</p>" if (moving := rest_note(joints)) else ""
    note += "<p class='note'>Limits: share of the substeps at or beyond the limit.</p>" if limits else ""
    return section("Joints", column_table([*columns, *measure_columns(joints), *limits]) + note) if joints else ""


def _compared(compared: Compared | None) -> str:
    if compared is None:
        return ""
    words = (
        [one._replace(heading=one.heading.replace("_", " ")) for one in found] for found in metric_tables(compared.metrics)
    )
    tables = "".join(map(column_table, words))
    images = "".join(
        f'<figure><img src="{data}" alt="{escape(path.stem, quote=True)}"></figure>'
        for path in compared.pictures
        if (data := picture(path)) is not None
    )
    return section("Beside experiments", images + tables)


def _plots(data: Mapping[str, Any]) -> str:
    note = (
        "<p class='note'><span class='hint'>The cursor moves the robot, too. </span>"
        "Long series are thinned: every interval keeps its smallest and largest sample.</p>"
    )
    parts = [HINT, note]
    if len(data["runs"]) > 1:
        parts.append('<div id="runs" role="group" aria-label="variants"></div>')
    groups = enumerate(data["groups"])
    parts += [folded(index, group["name"], group["words"], opened=index < OPENED) for index, group in groups]
    return section("Plots", "".join([*parts, NO_SCRIPT]))


_TABLES = {
    "certificate": "Estimated from runs at a half and a quarter of the step. Errors of the model are not included.",
    "cross_check": "Differences between engines.",
}
"""Entries of `summary.json` about accuracy, each with its description on the page."""
_NO_ERROR = "<p class='note'>Not estimated. <code>asrsim run --certify</code> estimates it from runs at finer steps.</p>"


def _accuracy(runs: Sequence[RunContent], labels: Sequence[str]) -> str:
    """Section about the time-step error of certified runs, and about differences from runs in another engine."""
    parts = []
    for key, description in _TABLES.items():
        whose: list[str] = []
        joints: dict[tuple[str, str], Any] = {}
        prismatic = {
            (label, one["name"]): one["prismatic"]
            for run, label in zip(runs, labels, strict=True)
            for one in run.summary["joints"]
        }
        notes: list[str] = []
        for run, label in zip(runs, labels, strict=True):
            data = run.summary.get(key) or {}
            joints |= {(label, name): joint for name, joint in (data.get("joints") or {}).items()}
            engines = " and ".join(filter(None, (data.get("engine"), data.get("other"))))
            whose += [engines] * len(data.get("joints") or {})
            texts = [*(data.get("warnings") or ()), *filter(None, (data.get("finding"), data.get("note")))]
            notes += [f"{label}: {text}" if len(runs) > 1 else str(text) for text in texts]
        if joints or notes:
            first = [TableColumn("variant", [label for label, _ in joints]), TableColumn("engines", whose)]
            columns = [
                *first,
                *difference_columns(
                    [name for _, name in joints], [*joints.values()], [prismatic.get(one, False) for one in joints]
                ),
            ]
            parts.append(f"<p class='note'>{description}</p>{column_table(columns)}{bullets(notes)}")
    return section("Numerical error", "".join(parts) or _NO_ERROR)


def _parameters(runs: Sequence[RunContent], labels: Sequence[str]) -> str:
    # Show one table for all joints and variants that have equal parameters.
    groups: dict[Any, list[tuple[str, str]]] = {}
    for run, label in zip(runs, labels, strict=True):
        for joint, values in run.parameters.items():
            # Compare the parameters without the line number in their sources, which differs from joint to joint.
            key = tuple((p.name, p.value, p.unit, p.origin.split(", line")[0]) for p in values)
            groups.setdefault(key, []).append((label, joint))
    parts = []
    for key, members in groups.items():
        joints = list(dict.fromkeys(joint for _, joint in members))
        variants = list(dict.fromkeys(label for label, _ in members))
        whose = ", ".join(joints) + (f" ({', '.join(variants)})" if len(variants) < len(runs) else "")
        rows = [[name, number(value), unit, origin] for name, value, unit, origin in key]
        parts.append(
            f"<details><summary>{escape(whose)} <span class='note'>{len(rows)} parameters</span></summary>"
            f"{table(['parameter', 'value', 'unit', 'from'], rows)}</details>"
        )
    return section("Parameters", "".join(parts)) if parts else ""


def _warnings(runs: Sequence[RunContent], labels: Sequence[str], notes: Sequence[str]) -> str:
    said: dict[str, None] = {}
    for run, label in zip(runs, labels, strict=True):
        said |= {_sentence(warning): None for warning in run.summary.get("warnings", ())}
        if run.status != "complete":
            said[f"{label}: the run is {run.status}; the page shows it up to its last sample"] = None
        said |= dict.fromkeys(run.notes)
    said |= dict.fromkeys(notes)
    return section("Warnings and notes", bullets(said)) if said else ""


def _sentence(warning: Mapping[str, Any]) -> str:
    """Warning in a summary as a sentence, like the sentences that commands print; its file is named without the folder."""
    known = {name: warning[name] for name in ("line", "key", "value", "hint") if name in warning}
    file = Path(Path(warning["file"]).name) if warning.get("file") else None
    return str(Problem(warning.get("message", ""), file=file, choices=tuple(warning.get("choices", ())), **known))


def _repeat(runs: Sequence[RunContent]) -> str:
    commands = [f"asrsim rerun {shlex.quote(str(run.log))}" for run in runs]
    info = runs[0].info
    if info.scenario_path:
        only = f" --variant {shlex.quote(info.variant)}" if len(runs) == 1 and info.variant not in ("", "default") else ""
        commands.append(f"asrsim run {shlex.quote(info.scenario_path)}{only}")
    libraries = {"asrsim": "asrsim ", "engine_version": "", "numpy": "numpy "}
    versions = ", ".join(f"{word}{info.metadata[name]}" for name, word in libraries.items() if name in info.metadata)
    scenario = (
        f"<details><summary>Scenario as read</summary><pre>{escape(info.scenario)}</pre></details>" if info.scenario else ""
    )
    text = "<p>Repeat from the log, compared bit for bit, or from the scenario:</p>"
    return section(
        "Repeat it", f"{text}<pre>{escape(chr(10).join(commands))}</pre><p class='note'>{escape(versions)}</p>{scenario}"
    )
