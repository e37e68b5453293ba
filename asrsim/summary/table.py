"""Summary as text: cells of the table of joints, and the lines around it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from asrsim.errors import counted
from asrsim.quantities import LIMITS
from asrsim.summary.data import JointReport, RunSummary


@dataclass(frozen=True, kw_only=True)
class TableColumn:
    """Column of the table: its heading and a cell for each joint."""

    heading: str
    cells: tuple[str, ...]
    right: bool = True


def measure_columns(summary: RunSummary) -> tuple[TableColumn, ...]:
    """Columns of the table of joints: names, actuators and measures."""
    joints = summary.joints
    length = " or ".join(dict.fromkeys("m" if joint.prismatic else "rad" for joint in joints)) or "rad"
    return (
        TableColumn(heading="joint", cells=tuple(joint.name for joint in joints), right=False),
        TableColumn(heading="actuator", cells=tuple(_actuator(joint) for joint in joints), right=False),
        TableColumn(heading=f"steady\n{length}", cells=cells([joint.measures.steady_state for joint in joints])),
        TableColumn(heading=f"error\n{length}", cells=cells([joint.measures.steady_state_error for joint in joints], "{:.3g}")),
        TableColumn(heading="over-\nshoot %", cells=cells([100.0 * joint.measures.overshoot for joint in joints], "{:.1f}")),
        TableColumn(heading="settling\ns", cells=cells([joint.measures.settling for joint in joints], "{:.3f}")),
        TableColumn(
            heading=f"peak defl.\n{length}", cells=cells([joint.measures.peak_deflection for joint in joints], "{:.3g}")
        ),
    )


def limit_columns(summary: RunSummary) -> tuple[TableColumn, ...]:
    """Columns of the limits that a joint reached, with each joint's share of the substeps."""
    return tuple(
        TableColumn(
            heading=heading.replace(" ", "\n"),
            cells=tuple(share(joint.limits[kind], summary.total_substeps) for joint in summary.joints),
        )
        for kind, heading in LIMITS.items()
        if any(joint.limits[kind] for joint in summary.joints)
    )


def headline(summary: RunSummary) -> str:
    """Line with the scenario, simulated time, speed and step."""
    words = {"complete": "", "interrupted": "interrupted, ", "diverged": "diverged, "}
    status = words.get(summary.status, f"{summary.status}, ")
    of = f" of {summary.duration:g} s" if summary.status != "complete" else ""
    time = f"{summary.simulated_time:.6g} s{of}" if summary.status == "complete" or of else ""
    speed = f"{summary.speed:.3g} x real time" if math.isfinite(summary.speed) else ""
    parts = [f"{status}{time} simulated in {summary.wall_time:.2g} s ({speed})", f"step {summary.step * 1e3:g} ms"]
    parts.append(counted(summary.substeps, "substep") + (f" x {summary.motor_substeps}" if summary.motor_substeps > 1 else ""))
    parts += [summary.stepping, f"{summary.engine}, {summary.loop} loop"]
    return ", ".join(parts)


def limit_note(summary: RunSummary) -> str:
    """Explanation of the limits' columns, or the statement that no limit was reached."""
    if not summary.samples:
        return "nothing was simulated"
    if any(any(joint.limits.values()) for joint in summary.joints):
        return f"limits: share of {summary.total_substeps} substeps at or beyond the limit"
    return "no limit of effort, velocity, motor torque, deflection or position was reached"


def _actuator(joint: JointReport) -> str:
    return joint.actuator if joint.mode is None else f"{joint.actuator}, mode {joint.mode}"


def cells(values: Sequence[float], form: str = "{:.5g}") -> tuple[str, ...]:
    """Numbers as text for a table; a dash for a missing number."""
    # Values below 1e-12 are rounding errors: show 0.
    return tuple(form.format(round(value, 12) + 0.0) if math.isfinite(value) else "-" for value in values)


def share(count: int, total: int) -> str:
    """Fraction of the run's substeps as text for a cell of a table."""
    if not count:
        return "-"
    percent = 100.0 * count / total
    if percent < 0.01:
        return "< 0.01 %"
    return f"{percent:.2g} %" if percent < 99.5 else "100 %"
