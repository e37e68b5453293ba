"""Make the recordings of this folder: simulations of a robot that differs from the example files, with measurement errors.

Usage: python examples/recordings/record.py [FOLDER]
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import asrsim

HERE = Path(__file__).parent
ROBOT = HERE.parent / "urdf" / "dof2_vertical.urdf"
SPRINGS = {"joint_1": 0.88, "joint_2": 1.08}
"""Spring constants as a fraction of the values in the robot file."""
CLOCK = 12.5
"""Time on the laboratory's clock when the motion starts, s."""
ENCODER = 360.0 / 4096.0
"""Resolution of the encoders, degrees."""
NOISE = 0.1
"""Standard deviation of the encoder noise, degrees."""
STEPS = {"joint_1": (0.5, 0.7, 3.5, -0.3), "joint_2": (1.0, 0.5, 4.0, 0.6)}
"""Two steps of each joint: time (s) and setpoint (rad)."""


def two_joints() -> str:
    """Text of the CSV file with the motion of two joints."""
    springs = {
        joint: {"spring_k_1": 0.02 * share, "spring_k_2": 0.02 * share, "motor_1_friction_torque": 0.025,
                "motor_2_friction_torque": 0.025}
        for joint, share in SPRINGS.items()
    }  # fmt: skip
    references = {
        joint: {
            "equilibrium_position": {"sum": [{"step": {"at": at, "to": to}}, {"step": {"at": then, "to": end - to}}]},
            "stiffness_preset": 0.5,
        }
        for joint, (at, to, then, end) in STEPS.items()
    }
    scenario = asrsim.make_scenario(
        ROBOT, duration=6.5, log_rate=100, parameters=springs, references=references,
        imperfections={"commands": {"*": {"delay": 0.02, "rate": 200}}},
    )  # fmt: skip
    result = asrsim.run(scenario)
    random = np.random.default_rng(7)
    names, columns = ["time [s]"], [result.time + CLOCK]
    for joint, (at, to, then, end) in STEPS.items():
        # The commands are recorded as they were sent, before delay and hold.
        sent = np.where(result.time >= then, end, np.where(result.time >= at, to, 0.0))
        names += [f"{joint}.reference_1 [rad]", f"{joint}.reference_2 [rad]", f"{joint}.link_position [deg]"]
        degrees = np.degrees(result[joint].link_position) + random.normal(0.0, NOISE, len(sent))
        columns += [sent, np.full(len(sent), 0.5), np.round(degrees / ENCODER) * ENCODER]
    rows = (",".join(f"{value + 0.0:.6g}" for value in row) for row in zip(*columns, strict=True))
    return "\n".join([",".join(names), *rows]) + "\n"


def bench_motion() -> str:
    """Text of the CSV file with a motion for the test bench: the link swings while the motor setpoint oscillates."""
    time = np.arange(0, 1001) * 1e-3
    swing = 2.0 * np.pi
    table = {
        "time": time,
        "joint_1.position": 0.2 * (1.0 - np.cos(swing * time)),
        "joint_1.velocity": 0.2 * swing * np.sin(swing * time),
        "joint_1.reference_1": 0.3 * np.sin(0.5 * swing * time),
    }
    rows = (",".join(f"{value + 0.0:.7g}" for value in row) for row in zip(*table.values(), strict=True))
    return "\n".join([",".join(table), *rows]) + "\n"


def main(folder: Path = HERE) -> None:
    """Write both files."""
    (folder / "two_joints.csv").write_text(two_joints(), encoding="utf-8")
    (folder / "bench_motion.csv").write_text(bench_motion(), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE)
