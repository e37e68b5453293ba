"""Tables about the joints of a run, and the lines of text around these tables, for terminal, notebook and report.

The tables are made from the entries of `summary.json`, in which a missing number is None.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from asrsim.errors import counted
from asrsim.quantities import LIMITS, shown
from asrsim.summary.data import RunSummary
from asrsim.tables import TableColumn

Joints = Sequence[Mapping[str, Any]]
"""Entries of `summary.json` about joints, of one run or of several."""


def measure_columns(joints: Joints) -> tuple[TableColumn, ...]:
    """Columns of the table of joints, with their names, actuators and measures."""
    length = " or ".join(dict.fromkeys("m" if joint["prismatic"] else "rad" for joint in joints)) or "rad"
    modes = ("" if joint["mode"] is None else f", mode {joint['mode']}" for joint in joints)
    return (
        TableColumn("joint", tuple(joint["name"] for joint in joints)),
        TableColumn("actuator", tuple(joint["actuator"] + mode for joint, mode in zip(joints, modes, strict=True))),
        _numbers(f"steady\n{length}", joints, "steady_state", "{:.5g}"),
        TableColumn("error", tuple(map(_error, joints)), right=True),
        _numbers("over-\nshoot %", joints, "overshoot", "{:.1f}", 100.0),
        _numbers("settling\ns", joints, "settling", "{:.3f}"),
        _numbers(f"peak defl.\n{length}", joints, "peak_deflection", "{:.3g}"),
    )


def limit_columns(joints: Joints, totals: Sequence[int]) -> tuple[TableColumn, ...]:
    """Columns for the limits that any joint reached, with the fraction of the substeps in which each joint was at the limit.
    totals: number of substeps in the run of each joint.
    """
    shares = [
        (heading, [joint.get("limits", {}).get(kind, 0) / total for joint, total in zip(joints, totals, strict=True)])
        for kind, heading in LIMITS.items()
    ]
    return tuple(
        TableColumn(heading.replace(" ", "\n"), tuple(map(_share, values)), right=True)
        for heading, values in shares
        if any(values)
    )


def difference_columns(names: Sequence[str], joints: Joints, prismatic: Sequence[bool]) -> tuple[TableColumn, ...]:
    """Columns of the table of a certificate or a cross-check: largest and RMS differences of each joint, and the order of
    convergence if it is known. names: names of the joints; prismatic: whether each joint is prismatic."""
    rows = [*zip(joints, prismatic, strict=True)]
    columns = [
        TableColumn(
            f"{quantity}\n{word}", [_difference(one, f"{quantity}_{key}", units[linear]) for one, linear in rows], right=True
        )
        for quantity, units in (("position", ("rad", "m")), ("torque", ("N m", "N")))
        for key, word in (("max", "max"), ("rms", "RMS"))
    ]
    order = [_numbers("order", joints, "order", "{:.2g}")] if any("order" in joint for joint in joints) else []
    return (TableColumn("joint", tuple(names)), *columns, *order)


def _difference(joint: Mapping[str, Any], key: str, unit: str) -> str:
    value = joint.get(key)
    return "-" if value is None else shown(value, unit, 2)


def _numbers(heading: str, joints: Joints, key: str, form: str, factor: float = 1.0, digits: int = 12) -> TableColumn:
    """Column of the number `key` of each joint times `factor`, rounded to `digits` decimals, with a dash where it is missing.
    form: format of the number.
    """
    numbers = (joint.get(key) for joint in joints)
    cells = ("-" if number is None else form.format(round(factor * number, digits) + 0.0) for number in numbers)
    return TableColumn(heading, tuple(cells), right=True)


def _error(joint: Mapping[str, Any]) -> str:
    """Steady-state error of a joint with its unit, whose prefix follows from the size of the error, from degrees to µrad."""
    error = joint.get("steady_state_error")
    return "-" if error is None else shown(round(error, 9) + 0.0, "m" if joint["prismatic"] else "rad")


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
    """Explanation of the columns for the limits, or a statement that no joint reached a limit."""
    if not summary.samples:
        return "nothing was simulated"
    if any(any(joint.limits.values()) for joint in summary.joints):
        return f"limits: share of {summary.total_substeps} substeps at or beyond the limit"
    return "no limit of effort, velocity, motors, deflection or position was reached"


def rest_note(joints: Joints) -> str:
    """Reason why some measures are missing for joints that are not at rest at the end; "" if all joints are at rest."""
    moving = [
        f"{joint['name']} ({joint['motion_left']:.2g} {'m' if joint['prismatic'] else 'rad'} of motion is left)"
        for joint in joints
        if joint.get("motion_left")
    ]
    return f"not at rest at the end, so measures that need rest are missing: {', '.join(moving)}" if moving else ""


def _share(fraction: float) -> str:
    """Fraction of a run's substeps, as text for a cell of a table."""
    if not fraction:
        return "-"
    percent = 100.0 * fraction
    if percent < 0.01:
        return "< 0.01 %"
    return f"{percent:.2g} %" if percent < 99.5 else "100 %"
