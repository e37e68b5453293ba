"""Section of a report on accuracy: error of the time step, and differences from another engine."""

from __future__ import annotations

from collections.abc import Sequence

from asrsim.report.content import RunContent
from asrsim.report.html import bullets, number, section, table

FIGURES = {
    "position_max": "position, largest", "position_rms": "position, RMS", "torque_max": "torque, largest",
    "torque_rms": "torque, RMS", "order": "order",
}  # fmt: skip
"""Numbers of a joint in `summary.json`, and the heads of their columns."""
TABLES = {
    "certificate": "Estimated from runs at a half and a quarter of the step; SI units. Model errors come on top.",
    "cross_check": "Differences between engines; SI units.",
}
"""Tables of `summary.json` on accuracy, and their descriptions."""
NONE = "<p class='note'>Not estimated. <code>asrsim run --certify</code> estimates it from runs at finer steps.</p>"


def numerical_error(runs: Sequence[RunContent], labels: Sequence[str]) -> str:
    """Section (HTML) on the time-step error of certified runs, and on cross-checks."""
    parts = []
    for key, description in TABLES.items():
        rows, notes = [], []
        for run, label in zip(runs, labels, strict=True):
            data = run.summary.get(key) or {}
            engines = " and ".join(filter(None, (data.get("engine"), data.get("other"))))
            for name, joint in (data.get("joints") or {}).items():
                rows.append([label, name, engines, *(number(joint.get(figure)) for figure in FIGURES)])
            texts = [*(data.get("warnings") or ()), *filter(None, (data.get("finding"), data.get("note")))]
            notes += [f"{label}: {text}" if len(runs) > 1 else str(text) for text in texts]
        if rows or notes:
            heads = ["variant", "joint", "engines", *FIGURES.values()]
            parts.append(f"<p class='note'>{description}</p>{table(heads, rows)}{bullets(notes)}")
    return section("Numerical error", "".join(parts) or NONE)
