"""Pictures of a test bench: positions, torques and stiffness of the actuators under the prescribed motion."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from asrsim.plots.curves import RunCurves
from asrsim.plots.decimate import decimate
from asrsim.plots.figures import grid_pages
from asrsim.plots.output import save_figure, styled
from asrsim.plots.panels import PANELS
from asrsim.plots.world import Curve
from asrsim.robot.model import Robot
from asrsim.samples import Array, JointInfo, RunInfo

NAMES = {"position": "link_position", "motor_1_effort": "motor_1_torque", "motor_2_effort": "motor_2_torque"}
"""Column names of the bench that differ from the quantity names of the other pictures."""
SHOWN = ("position", "adjuster", "stiffness", "torque", "motor_torque")
"""Panels of the picture, see `asrsim.plots.panels.PANELS`."""


def draw_bench(path: Path, time: Array, results: Mapping[str, Mapping[str, Array]], robot: Robot) -> list[Path]:
    """Draw the bench's outputs as PNG files beside the table at `path`, three joints per picture, and return the files.

    time: (n,) s; results: joint -> column of `asrsim.simulation.bench.OUTPUTS` -> values (n,). Raises OutputError.
    """
    prismatic = {joint.name for joint in robot.joints if joint.kind == "prismatic"}
    joints = tuple(
        JointInfo(name=block.joint, actuator=block.actuator, mode=block.mode, prismatic=block.joint in prismatic)
        for block in robot.actuators
        if block.joint in results
    )
    curves = {}
    for joint, columns in results.items():
        for name, values in columns.items():
            if np.isfinite(values).any():
                moments, kept = decimate(time, values)
                curves[joint, NAMES.get(name, name)] = Curve(time=moments, values=kept)
    run = RunCurves(
        path=path, info=RunInfo(robot=robot.name, joints=joints, step=0.0), label="", joints=joints, curves=curves,
        samples=len(time),
    )  # fmt: skip
    files = []
    with styled():
        for page in grid_pages(path.stem, "test bench", [PANELS[key] for key in SHOWN], [run]):
            files += save_figure(page.figure, path.parent, page.name, ("png",))
    return files
