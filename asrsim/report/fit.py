"""Page about a fit: verdict, parameters, recordings beside simulations, profiles, correlations, and what to record next."""

from __future__ import annotations

import math
import shlex
from collections.abc import Sequence
from html import escape
from pathlib import Path

import numpy as np

from asrsim.errors import counted
from asrsim.identification.curves import channel_charts, spectrum_chart
from asrsim.identification.folder import FitFolder, read_fit
from asrsim.identification.profiles import WIDTHS, Profile
from asrsim.identification.result import AT_BOUND, IDENTIFIED, WEAK, Estimate
from asrsim.identification.show import ERRORS
from asrsim.plots import style
from asrsim.plots.chart import Chart, Line
from asrsim.quantities import prefixed
from asrsim.report.charts import page_data
from asrsim.report.html import badge, bullets, number, section, table
from asrsim.report.page import HINT, NO_SCRIPT, folded, page_html, plots
from asrsim.samples import Array

MOST = 40
"""Largest number of parameters in the table of correlations."""
STRONG = 0.9
"""Smallest magnitude of the correlation of two parameters at which the page names the two parameters."""
JUDGED = {True: ("the model fits", "good"), False: ("the model does not fit", "poor"), None: ("not judged", "plain")}
GRADES = {IDENTIFIED: "good", WEAK: "plain", AT_BOUND: "plain"}
"""Style of the page for each verdict on a parameter; verdicts that are not listed have the style `poor`."""


def fit_page(folder: Path) -> str:
    """HTML of the page about the fit in a folder. Raises InputError."""
    fit = read_fit(folder)
    tracks = list(dict.fromkeys(one.track for one in fit.curves))
    groups: list[tuple[str, Sequence[Chart]]] = []
    for track in tracks:
        channels = [one for one in fit.curves if one.track == track]
        charts = [chart for one in channels for chart in (*channel_charts(one), spectrum_chart(one))]
        groups.append((channels[0].recording, charts))
    profiled = [profile_chart(one, fit.estimates) for one in fit.profiles]
    groups.append(("profiles", profiled))
    sections = [
        _verdict(fit),
        _parameters(fit),
        _recordings(groups[:-1]),
        _profiles(len(groups) - 1) if profiled else "",
        _correlations(fit.estimates, fit.correlations),
        _errors(fit),
        _next(fit),
        _repeat(fit),
    ]
    words, grade = JUDGED[fit.fits]
    recordings = ", ".join(Path(one).name for one in fit.experiments)
    head = (
        f"<p>{_badge(words, grade)} {escape(fit.status)}: {escape(Path(fit.scenario).name)} fitted to {escape(recordings)}, "
        f"{counted(fit.evaluations, 'simulation')} in {fit.seconds:.0f} s</p>"
    )
    return page_html(f"Fit {fit.name}", sections, head=head, data=page_data(groups))


def profile_chart(one: Profile, estimates: Sequence[Estimate]) -> Chart:
    """Chart of the misfit over the values of a parameter, with the parabola that the parameter's interval assumes."""
    unit = next((estimate.unit for estimate in estimates if estimate.name == one.name), "")
    fine = np.linspace(WIDTHS[0], WIDTHS[-1], 61)
    places = np.interp(fine, WIDTHS, one.values) if len(one.values) == len(WIDTHS) else one.values
    parabola = fine**2 if len(one.values) == len(WIDTHS) else np.full(len(places), np.nan)
    lines = [
        Line(label="parabola of the interval", x=places, y=parabola, colour=style.LIGHT, width=style.WIDE),
        Line(label="misfit, others fitted again", x=one.values, y=one.rise, colour=style.VERMILION, kind="both"),
    ]
    top = max(9.0, float(np.nanmax(one.rise, initial=0.0)))
    words = style.in_words(one.name)
    return Chart(words=words, across=words, across_unit=unit, lines=lines, span=(-0.05 * top, 1.05 * top))


def _badge(text: str, grade: str) -> str:
    return badge(text, good=grade == "good") if grade != "plain" else f'<span class="badge plain">{escape(text)}</span>'


def _verdict(fit: FitFolder) -> str:
    parts = []
    if fit.misfit:
        parts.append(f"<h3>Why it does not fit</h3>{bullets(fit.misfit)}")
    if fit.causes:
        parts.append(f"<h3>What may be missing, and what each cause would explain</h3>{bullets(fit.causes)}")
    if fit.accepted:
        parts.append("<p>The model was accepted although it does not fit: its robot file was written.</p>")
    if fit.predictions:
        parts.append(f"<h3>How well it predicts other recordings</h3>{bullets(fit.predictions)}")
    if fit.remarks:
        parts.append(f"<h3>How the recordings were read</h3>{bullets(fit.remarks)}")
    return section("Verdict", "".join(parts)) if parts else ""


def _parameters(fit: FitFolder) -> str:
    rows = []
    for one in fit.estimates:
        interval = f"{one.low:.5g} to {one.high:.5g}" if one.has_interval else "-"
        margin = f"± {100.0 * one.margin:.2g} %" if one.has_interval and math.isfinite(one.margin) and not one.is_place else "-"
        verdict = _badge(one.verdict, GRADES.get(one.verdict, "poor"))
        rows.append([one.name, one.unit, number(one.start), f"{one.value:.6g}", interval, margin, verdict, one.reason])
    heads = ["parameter", "unit", "start", "estimate", "95 % interval", "half width", "verdict", "why"]
    known = [
        f"{one['text']} = {number(one['value'])}" + (f" (± {100.0 * one['margin']:.2g} %)" if one["margin"] is not None else "")
        for one in fit.combinations
    ]
    together = f"<h3>Identified together</h3>{bullets(known)}" if known else ""
    return section("Parameters", table(heads, rows, raw=(6,), long=(7,)) + together)


def _recordings(groups: Sequence[tuple[str, Sequence[Chart]]]) -> str:
    if not groups:
        return section(
            "Recordings",
            "<p class='note'>The folder has no curves: an earlier version of asrsim made this fit. A new fit writes them.</p>",
        )
    words = (
        "<p class='note'>Each channel has three charts: recorded and simulated values, their difference, and its spectrum. "
        "If the difference is noise, it has no pattern, and its spectrum is flat at the dashed line.</p>"
    )
    places = [folded(index, name, opened=index < 2, three=True) for index, (name, _) in enumerate(groups)]
    return section("Recordings over simulations", "".join([HINT, words, *places, NO_SCRIPT]))


def _profiles(group: int) -> str:
    words = (
        "<p class='note'>Increase of the misfit over one parameter, with the other parameters fitted again; 1 is the increase "
        "at one standard deviation. Where the curve leaves the parabola, the interval is only approximate.</p>"
    )
    return section("Profiles", words + plots(group))


def _correlations(estimates: Sequence[Estimate], found: Array) -> str:
    rows = [i for i in range(len(found)) if np.isfinite(found[i, i])][:MOST]
    if len(rows) < 2:
        return ""
    names = [estimates[i].name for i in rows]
    heads = "".join(f'<th title="{escape(name, quote=True)}">{n}</th>' for n, name in enumerate(names, 1))
    body = []
    for n, i in enumerate(rows, 1):
        cells = "".join(_cell(float(found[i, j])) for j in rows)
        body.append(f"<tr><th>{escape(names[n - 1])} {n}</th>{cells}</tr>")
    pairs = sorted(((abs(found[i, j]), i, j) for i in rows for j in rows if i < j and abs(found[i, j]) >= STRONG), reverse=True)
    said = [f"{estimates[i].name} and {estimates[j].name} are correlated: {found[i, j]:.3f}" for _, i, j in pairs[:10]]
    matrix = f'<div class="wide"><table class="matrix"><thead><tr><th></th>{heads}</tr></thead>'
    return section("Correlations of the estimates", f"{bullets(said)}{matrix}<tbody>{''.join(body)}</tbody></table></div>")


def _cell(value: float) -> str:
    colour = "0, 114, 178" if value < 0.0 else "213, 94, 0"
    return f'<td style="background: rgba({colour}, {0.75 * value**2:.3f})">{value:.2f}</td>'


def _errors(fit: FitFolder) -> str:
    numbers = {
        "training before": "before",
        "training after": "after",
        "held out before": "held_before",
        "held out after": "held_after",
        "noise": "noise",
        "lag-1 correlation": "correlation",
        "explained": "explained",
    }
    rows = []
    for one in fit.channels:
        known = {key: one[key] for key in numbers.values() if isinstance(one.get(key), float | int)}
        scale, unit = prefixed([known[key] for key in ERRORS if key in known], one["unit"])
        scaled = {key: value * (scale if key in ERRORS else 1.0) for key, value in known.items()}
        cells = [f"{scaled[key]:.3g}" if key in known else "-" for key in numbers.values()]
        rows.append([one["recording"], one["key"], unit, *cells, str(one.get("suspicion") or "")])
    heads = ["recording", "channel", "unit", *numbers, "suspicion"]
    return section("RMS errors", table(heads, rows))


def _next(fit: FitFolder) -> str:
    commands = [text for text in fit.next if text.startswith("asrsim ")]
    words = [text for text in fit.next if text not in commands]
    code = f"<pre>{escape(chr(10).join(commands))}</pre>" if commands else ""
    return section("Next experiment", bullets(words) + code) if fit.next else ""


def _repeat(fit: FitFolder) -> str:
    files = " ".join(f"-e {shlex.quote(one)}" for one in fit.experiments)
    lines = [f"asrsim identify {shlex.quote(fit.scenario)} {files} --out {shlex.quote(str(fit.folder))}"]
    if (fit.folder / "scenario.yaml").is_file():
        lines.append(f"asrsim run {shlex.quote(str(fit.folder / 'scenario.yaml'))}")
    lines.append(f"asrsim sweep {shlex.quote(fit.scenario)} --fit {shlex.quote(str(fit.folder / 'fit.json'))}")
    return section("Go on", f"<pre>{escape(chr(10).join(lines))}</pre>")
