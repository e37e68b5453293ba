"""Laboratory work between two trials of learning: play an input on the robot, and record the motion."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from asrsim.learning.plant import Plant
from asrsim.signals.recorded import read_column
from support.independent_arm import Arm


def record(path: Path, plant: Plant, robot: Arm, inputs: np.ndarray, *, seed: int = 0) -> float:
    """Write a recording of the robot at 200 Hz with 1 mrad of noise, and return the largest noise-free error in rad."""
    outputs = robot.move(plant.time, inputs)
    time = np.arange(0.0, plant.time[-1] + 1e-9, 0.005)
    seen = np.column_stack([np.interp(time, plant.time, column) for column in outputs.T])
    seen += np.random.default_rng(seed).normal(0.0, 1e-3, seen.shape)
    header = ",".join(["time [s]", *(f"{joint}.link_position [rad]" for joint in plant.joints)])
    np.savetxt(path, np.column_stack([time, seen]), delimiter=",", header=header, comments="")
    return float(np.abs(plant.reference - outputs).max())


def inputs_in(path: Path, plant: Plant) -> np.ndarray:
    """Inputs (n, joints) read from a file."""
    return np.column_stack([read_column(path, joint, None)[1] for joint in plant.joints])
