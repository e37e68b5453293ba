"""How the cost of a step grows: with the number of joints, and with the stiffness of springs, which asks for substeps."""

from __future__ import annotations

import statistics
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from worker import bare, whole
from worlds import chain, scenario

from asrsim.simulation.prepare import prepare

JOINTS = (1, 2, 5, 14, 40)
STIFFNESSES = (10.0, 30.0, 100.0, 300.0, 1e3, 3e3, 1e4, 3e4, 1e5)
"""N m/rad of the springs of two SEAs."""


@dataclass(frozen=True, kw_only=True)
class Point:
    """CPU time in s of a step of 1 ms, by the way it is run."""

    bare: float
    """PyBullet's own, nothing applied or recorded."""
    plain: float
    """PyBullet, the loop in plain Python."""
    fast: float
    """PyBullet, compiled."""
    mujoco: float
    """MuJoCo, compiled."""
    substeps: int = 1


def over_joints(folder: Path, repeats: int = 3) -> dict[int, Point]:
    """One substep, 1 .. 40 joints with qbMoves."""
    points = {}
    for joints in JOINTS:
        # Motors that carry two links cannot carry forty.
        points[joints] = _point(chain(folder, joints), repeats, 10.0 if joints < 14 else 3.0, "", gravity=False)
    return points


def over_stiffness(folder: Path, repeats: int = 3) -> dict[float, Point]:
    """Two joints with SEAs of every stiffness, substeps chosen by asrsim."""
    from asrsim.scenario import load_scenario

    robot = chain(folder, 2, actuator="sea")
    points = {}
    for stiffness in STIFFNESSES:
        extra = f"parameters: {{'*': {{spring_stiffness: {stiffness}}}}}\n"
        (loaded,) = load_scenario(scenario(robot, duration=6.0, substeps=None, preset=None, extra=extra))
        substeps = prepare(loaded).resolution.substeps
        points[stiffness] = replace(_point(robot, repeats, 6.0, extra, substeps=None, preset=None), substeps=substeps)
    return points


def _point(robot: Path, repeats: int, duration: float, extra: str, **options: Any) -> Point:
    ways = (("bullet", False), ("bullet", True), ("mujoco", True))
    files = [scenario(robot, duration=duration, engine=name, compiled=c, extra=extra, **options) for name, c in ways]
    request = {"scenario": files[0], "engine": "bullet"}
    rounds = [(bare(request), *(whole({"scenario": file}) for file in files)) for _ in range(repeats)]
    medians = [statistics.median(values) for values in zip(*rounds, strict=True)]
    return Point(bare=medians[0], plain=medians[1], fast=medians[2], mujoco=medians[3])
