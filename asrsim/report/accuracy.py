"""Section of a report on accuracy: error of the time step, and differences from another engine."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from asrsim.report.content import RunContent
from asrsim.report.html import bullets, number, section, table

FIGURES = ("position_max", "position_rms", "torque_max", "torque_rms")
DIFFERENCES = ["variant", "joint", "position, largest", "position, RMS", "torque, largest", "torque, RMS"]


def numerical_error(runs: Sequence[RunContent], labels: Sequence[str]) -> str:
    """Section (HTML) on the time-step error of certified runs, and on cross-checks."""
    rows, notes = [], []
    for run, label in zip(runs, labels, strict=True):
        certificate = run.summary.get("certificate") or {}
        for name, joint in (certificate.get("joints") or {}).items():
            rows.append([label, name, *(number(joint.get(k)) for k in FIGURES), number(joint.get("order"))])
        notes += [f"{label}: {text}" if len(runs) > 1 else str(text) for text in certificate.get("warnings") or ()]
    other = _cross_checks(runs, labels)
    if not rows and not other:
        return section(
            "Numerical error",
            "<p class='note'>Not estimated. <code>asrsim run --certify</code> estimates it from runs at finer steps.</p>",
        )
    text = ""
    if rows:
        text = "<p class='note'>Estimated from runs at a half and a quarter of the step; SI units. Model errors come on top."
        text += "</p>" + table([*DIFFERENCES, "order"], rows) + bullets(notes)
    return section("Numerical error", text + other)


def _cross_checks(runs: Sequence[RunContent], labels: Sequence[str]) -> str:
    """Differences (HTML) between the runs and repetitions in another engine; empty without cross-checks."""
    rows: list[list[str]] = []
    notes: list[str] = []
    engines: dict[str, None] = {}
    for run, label in zip(runs, labels, strict=True):
        check = run.summary.get("cross_check") or {}
        for name, joint in (check.get("joints") or {}).items():
            rows.append([label, name, *(number(joint.get(k)) for k in FIGURES)])
            engines[f"{check.get('engine')} and {check.get('other')}"] = None
        notes += [f"{label}: {check[key]}" for key in ("finding", "note") if check.get(key)]
    if not rows and not notes:
        return ""
    text = f"<p class='note'>Differences between engines ({escape(', '.join(engines))}); SI units.</p>"
    return text + table(DIFFERENCES, rows) + bullets(notes)
