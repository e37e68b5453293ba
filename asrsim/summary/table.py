"""Summary as text: cells of the table of joints, and the lines around it."""

from __future__ import annotations

import math
from collections.abc import Sequence

from asrsim.errors import counted
from asrsim.quantities import LIMITS
from asrsim.summary.data import JointReport, RunSummary

Column = tuple[str, tuple[str, ...], bool]
"""Heading of a table's column, a cell for each joint, and whether the cells are right-aligned."""


def measure_columns(summary: RunSummary) -> tuple[Column, ...]:
    """Columns of the table of joints: names, actuators and measures."""
    joints = summary.joints
    measures = [joint.measures for joint in joints]
    length = " or ".join(dict.fromkeys("m" if joint.prismatic else "rad" for joint in joints)) or "rad"
    return (
        ("joint", tuple(joint.name for joint in joints), False),
        ("actuator", tuple(_actuator(joint) for joint in joints), False),
        (f"steady\n{length}", cells([one.steady_state for one in measures]), True),
        (f"error\n{length}", cells([one.steady_state_error for one in measures], "{:.3g}"), True),
        ("over-\nshoot %", cells([100.0 * one.overshoot for one in measures], "{:.1f}"), True),
        ("settling\ns", cells([one.settling for one in measures], "{:.3f}"), True),
        (f"peak defl.\n{length}", cells([one.peak_deflection for one in measures], "{:.3g}"), True),
    )


def limit_columns(summary: RunSummary) -> tuple[Column, ...]:
    """Columns of the limits that a joint reached, with each joint's share of the substeps."""
    return tuple(
        (heading.replace(" ", "\n"), tuple(share(joint.limits[kind], summary.total_substeps) for joint in summary.joints), True)
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
