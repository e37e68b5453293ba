"""How the cost of a step grows: with the number of joints, and with the stiffness of springs, which asks for substeps."""

from __future__ import annotations

import statistics
from dataclasses import dataclass
from pathlib import Path

from loops import bare_seconds, loop_seconds
from worlds import BareWorld, chain, scenario

from asrsim.simulation.prepare import prepare

JOINTS = (1, 2, 5, 14, 40)
STIFFNESSES = (10.0, 30.0, 100.0, 300.0, 1e3, 3e3, 1e4, 3e4, 1e5)
"""N m/rad of the springs of two SEAs."""


@dataclass(frozen=True, kw_only=True)
class Point:
    """CPU time in s of a step of 1 ms, by the way it is run."""

    bare: float
    plain: float
    fast: float
    substeps: int = 1


def over_joints(folder: Path, repeats: int = 3) -> dict[int, Point]:
    """One substep, 1 .. 40 joints with qbMoves."""
    points = {}
    for joints in JOINTS:
        robot = chain(folder, joints)
        world = BareWorld(robot)
        duration = 20.0 if joints < 14 else 6.0
        # Motors that carry two links cannot carry forty.
        runs = [scenario(robot, duration=duration, compiled=compiled, gravity=False) for compiled in (False, True)]
        rounds = [(bare_seconds(world), *(loop_seconds(run, robot) for run in runs)) for _ in range(repeats)]
        world.engine.close()
        bare, plain, fast = map(statistics.median, zip(*rounds, strict=True))
        points[joints] = Point(bare=bare, plain=plain, fast=fast)
    return points


def over_stiffness(folder: Path, repeats: int = 3) -> dict[float, Point]:
    """Two joints with SEAs of every stiffness, substeps chosen by asrsim."""
    robot = chain(folder, 2, actuator="sea")
    world = BareWorld(robot)
    points = {}
    for stiffness in STIFFNESSES:
        runs = [
            scenario(
                robot, duration=6.0, compiled=compiled, substeps=None, motor_substeps=None, stiffness=stiffness,
            )
            for compiled in (False, True)
        ]  # fmt: skip
        prepared = prepare(runs[0], robot)
        prepared.engine.close()
        rounds = [(bare_seconds(world), *(loop_seconds(run, robot) for run in runs)) for _ in range(repeats)]
        bare, plain, fast = map(statistics.median, zip(*rounds, strict=True))
        points[stiffness] = Point(bare=bare, plain=plain, fast=fast, substeps=prepared.resolution.substeps)
    world.engine.close()
    return points
