"""`asrsim bench`: applies a recorded or computed link motion to the actuators of a URDF."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from asrsim.cli.command import Done, command
from asrsim.cli.console import say_written
from asrsim.cli.options import Plot, into_file
from asrsim.errors import Problem, RecordingError
from asrsim.outfile import check_output, csv_text, write_text

if TYPE_CHECKING:
    from asrsim.robot.model import Robot
    from asrsim.samples import Array
    from asrsim.simulation.bench import Motion

INPUTS = ("position", "velocity", "reference_1", "reference_2", "external_torque")
"""Possible columns of a joint; position and velocity are required."""


@command("Print nothing.")
def bench(
    robot: Annotated[Path, typer.Argument(metavar="ROBOT", help="URDF or xacro file.", show_default=False)],
    motion: Annotated[
        Path,
        typer.Argument(
            metavar="MOTION",
            help="CSV with time and <joint>.position, .velocity, and any of .reference_1, .reference_2, .external_torque.",
            show_default=False,
        ),
    ],
    out: Annotated[Path, into_file("CSV to write.", ".csv")] = Path("bench.csv"),
    stepping: Annotated[str, typer.Option(help="leapfrog, euler, or toolbox (order of the released code).")] = "leapfrog",
    first_step: Annotated[
        float | None,
        typer.Option(help="Length of the first step in s; by default that of the second step, for leapfrog a start from rest."),
    ] = None,
    plot: Plot = True,
) -> Done:
    """Apply a prescribed link motion to the actuators, as on a test bench.

    Each row of the CSV is a step. The output has time, and for each joint position, velocity, references,
    link and elastic torques, stiffness and motor states; numbers are written in full precision.

    Example: asrsim bench examples/urdf/dof1_sea.urdf examples/recordings/bench_motion.csv -o bench.csv
    """
    import numpy as np

    from asrsim.robot import load_robot
    from asrsim.simulation.bench import OUTPUTS, run_bench

    check_output(out, "bench", inputs=[robot, motion])
    loaded = load_robot(robot)
    time, motions = read_motion(motion, loaded)
    results = run_bench(loaded, time, motions, stepping=stepping, first_step=first_step)
    names = [f"{joint}.{column}" for joint in results for column in OUTPUTS]
    columns = [results[joint][column] for joint in results for column in OUTPUTS]
    write_text(out, csv_text(["time", *names], np.column_stack([time, *columns])), "bench")
    files = [out]
    if plot:
        from asrsim.plots.bench import draw_bench

        files += draw_bench(out, time, results)
    return Done(data={"ok": True, "files": [str(path) for path in files]}, text=lambda: say_written(files))


def read_motion(path: Path, robot: Robot) -> tuple[Array, dict[str, Motion]]:
    """Times (n,) in s and the motion of each joint from a motion CSV; raises RecordingError with every problem."""
    import numpy as np

    from asrsim.signals.recorded import read_column, series_names
    from asrsim.simulation.bench import Motion

    names = series_names(path)
    joints = _check_names(path, names, robot)
    found: dict[str, Array] = {}
    problems: list[Problem] = []
    for name in names:
        try:
            time, found[name] = read_column(path, name, "time")
        except RecordingError as error:
            problems += [problem for problem in error.problems if problem not in problems]
    if problems:
        raise RecordingError(problems)
    return time, {
        joint: Motion(**{name: found.get(f"{joint}.{name}", np.zeros(len(time))) for name in INPUTS[:4]}) for joint in joints
    }


def _check_names(path: Path, names: Sequence[str], robot: Robot) -> list[str]:
    """Joints in the header, in the robot's order. Raises RecordingError for unknown and missing columns."""
    blocks = {block.joint for block in robot.actuators}
    actuated = [joint.name for joint in robot.moving_joints if joint.name in blocks]
    valid = ("time", *(f"{joint}.{name}" for joint in actuated for name in INPUTS))
    joints = [joint for joint in actuated if any(name.startswith(f"{joint}.") for name in names)]
    required = ["time", *(f"{joint}.{name}" for joint in joints or actuated[:1] for name in INPUTS[:2])]
    wrong = {name: ("is not a column of the bench", "unknown-column") for name in names if name not in valid}
    wrong |= {name: ("column is missing", "missing-column") for name in required if name not in names}
    if wrong:
        raise RecordingError(
            Problem(message, file=path, line=1, key=name, choices=valid, meant=name, code=code)
            for name, (message, code) in wrong.items()
        )
    return joints
