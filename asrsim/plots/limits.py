"""Limits of a joint as curves: joint stops, and the largest torques and deflections of its actuator."""

from __future__ import annotations

import math
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.errors import RobotError
from asrsim.plots import style
from asrsim.plots.curves import RunCurves
from asrsim.plots.decimate import Curve
from asrsim.quantities import each_motor
from asrsim.samples import Array, JointInfo


def panel_limits(run: RunCurves, joint: str, panel: str) -> list[Curve]:
    """Upper and lower limits of a joint for a panel of `asrsim.plots.panels.PANELS`, read from the log."""
    kind = panel.removeprefix("quantity:")
    link = run.get(joint, "link_position")
    stops = _joint_limits(run.info.urdf).get(joint, {})
    values: dict[str, Any] = dict(run.info.resolved.get("parameters", {}).get(joint, {}))
    pairs: list[tuple[float, float]] = []
    if kind in ("position", "link_position"):
        pairs = [(stops.get("lower", math.nan), stops.get("upper", math.nan))]
    elif kind in ("torque", "link_torque"):
        pairs = [_both(stops.get("effort", math.nan))]
    elif kind == "motor_torque" or kind in each_motor("motor_{}_torque"):
        limits = each_motor("motor_{}_max_torque") if kind == "motor_torque" else (kind.replace("torque", "max_torque"),)
        pairs = [_both(values.get(limit, math.nan)) for limit in limits]
    elif kind == "deflection":
        return _deflection_limits(run, joint, float(values.get("max_deflection", math.nan)))
    # Ignore a limit of 0, which means in URDF that the joint has no limit.
    curves = link or next((curve for (name, _), curve in run.curves.items() if name == joint), None)
    if curves is None:
        return []
    span = np.array([curves.time[0], curves.time[-1]])
    edges = dict.fromkeys(edge for pair in pairs if pair[0] < pair[1] for edge in pair if math.isfinite(edge))
    return [Curve(time=span, values=np.full(2, edge)) for edge in edges]


def _deflection_limits(run: RunCurves, joint: str, limit: float) -> list[Curve]:
    """Upper and lower limit of a joint's deflection. limit: deflection limit of the joint's springs, rad (m)."""
    info = next((info for info in run.joints if info.name == joint), None)
    one, two = run.get(joint, "motor_1_position"), run.get(joint, "motor_2_position")
    if info is None or not math.isfinite(limit) or run.get(joint, "deflection") is None:
        return []
    if one is None or two is None:
        time = np.asarray(run.curves[joint, "deflection"].time[[0, -1]])
        left = largest_deflection(info, limit)
    else:
        time = one.time
        left = largest_deflection(info, limit, one.values, np.interp(time, two.time, two.values))
    if left is None:
        return []
    if left.ndim == 0:
        time, left = time[[0, -1]], np.full(2, left)
    return [Curve(time=time, values=left), Curve(time=time, values=-left)]


def largest_deflection(joint: JointInfo, limit: float, one: Array | None = None, two: Array | None = None) -> Array | None:
    """Largest deflection of a joint, rad (m). The result is one number, or a number for each sample (n,); None if it is not
    known.

    limit: deflection limit of the joint's springs, rad (m); one, two: positions (n,) of the joint's two motors, rad (m). With
    two antagonistic springs, the preset uses up part of the range.
    """
    if joint.motors > 2:
        return None
    if joint.motors < 2 or style.has_adjuster(joint):
        return np.asarray(limit)
    return None if one is None or two is None else np.asarray(limit - 0.5 * np.abs(one - two))


def _both(limit: float) -> tuple[float, float]:
    return -float(limit), float(limit)


@lru_cache(maxsize=8)
def _joint_limits(urdf: str) -> dict[str, dict[str, float]]:
    """Attributes lower, upper and effort of each joint's `<limit>` element; empty if the text is not URDF."""
    from asrsim.robot.xmlfile import parse_xml

    try:
        root = parse_xml(urdf.encode(), Path("robot.urdf"), large=True)
    except RobotError:
        return {}
    found: dict[str, dict[str, float]] = {}
    for joint in root.findall("joint"):
        limit = joint.find("limit")
        if limit is None:
            continue
        keys = ("lower", "upper", "effort") if joint.get("type") in ("revolute", "prismatic") else ("effort",)
        try:
            numbers = {key: float(limit.get(key, "0")) for key in keys}
        except ValueError:
            continue
        if not numbers["effort"] > 0:
            del numbers["effort"]
        found[(joint.get("name") or "").strip()] = numbers
    return found
