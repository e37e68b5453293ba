"""The cells of a row: what a study's point, and the summary of its run, say in plain numbers and texts."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from asrsim.plain import finite_or_none
from asrsim.quantities import LIMITS
from asrsim.summary import RunSummary
from asrsim.sweeps.cases import MEASURES, TIP, Payload

Row = tuple[Any, ...]


def summary_cells(summary: RunSummary) -> dict[str, Any]:
    """What came out of a run."""
    cells: dict[str, Any] = {
        "status": summary.status,
        "reason": summary.message or None,
        "ok": summary.ok,
        "warnings": ", ".join(dict.fromkeys(w.code + (f":{w.key}" if w.key else "") for w in summary.warnings)) or None,
        "substeps": summary.substeps,
        "motor_substeps": summary.motor_substeps,
        "simulated_time": summary.simulated_time,
    }
    if summary.claims:
        cells["claims_met"] = sum(claim.holds for claim in summary.claims) / len(summary.claims)
    for joint in summary.joints:
        cells |= {f"{joint.name}.{name}": finite_or_none(getattr(joint.measures, name)) for name in MEASURES}
        cells |= {f"{joint.name}.{name}_count": getattr(joint, name) for name in LIMITS}
    cells |= {f"tip.{name}": summary.tip[name] for name in TIP if name in summary.tip}
    for index, claim in enumerate(summary.claims):
        cells |= {f"claim_{index}": claim.holds, f"claim_{index}.measured": finite_or_none(claim.measured)}
    return cells


def plain_cells(values: Mapping[str, Any], payload: Payload) -> dict[str, Any]:
    """What was varied."""
    kinds = payload.kinds
    return {
        key: float(value) if kinds[key] == "float" else (value if isinstance(value, str) else json.dumps(value))
        for key, value in values.items()
    }


def one_line(error: BaseException) -> str:
    """An error as the reason of a row."""
    lines = [" ".join(line.split()) for line in str(error).splitlines()]
    return "; ".join(line for line in lines if line)[:500]


def lost(payload: Payload, run: int, reason: str) -> Row:
    """The row of a run that gave none."""
    variant, values = payload.study.point(run)
    cells = {"run": run, "variant": variant, **plain_cells(values, payload)}
    cells |= {"status": "crashed", "reason": reason, "ok": False}
    return tuple(cells.get(name) for name in payload.names)
