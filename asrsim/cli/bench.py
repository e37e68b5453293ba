"""`asrsim bench`: a recorded or computed link motion played into the actuators of a URDF."""

from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from asrsim.cli.options import Plugins, load_plugins
from asrsim.errors import Problem, RecordingError, did_you_mean, similar_file
from asrsim.outfile import check_output, csv_text, write_text

if TYPE_CHECKING:
    from asrsim.robot.model import Robot
    from asrsim.samples import Array
    from asrsim.simulation.bench import Motion

INPUTS = ("position", "velocity", "reference_1", "reference_2", "external_torque")
"""Columns a joint may have; position and velocity are required."""


def bench(
    robot: Annotated[Path, typer.Argument(help="URDF or xacro file.", show_default=False)],
    motion: Annotated[
        Path,
        typer.Argument(
            help="CSV with time and <joint>.position, .velocity, and any of .reference_1, .reference_2, .external_torque.",
            show_default=False,
        ),
    ],
    out: Annotated[Path, typer.Option("--out", "-o", help="CSV to write.")] = Path("bench.csv"),
    stepping: Annotated[str, typer.Option(help="leapfrog, euler, or toolbox: the released code's order.")] = "leapfrog",
    first_step: Annotated[
        float | None,
        typer.Option(
            help="Length of the first row's step in s; by default as long as the second's, in leapfrog a start from rest."
        ),
    ] = None,
    plugin: Plugins = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing.")] = False,
) -> None:
    """Play a prescribed link motion into the actuators, as on a test bench.

    A row of the CSV is a step, at the row's time. The output has time and per joint position, velocity, references,
    link and elastic torques, stiffness and motor states; floats survive the round trip.

    Example: asrsim bench examples/urdf/dof1_sea.urdf examples/recordings/bench_motion.csv -o bench.csv
    """
    load_plugins(plugin)
    rows = bench_files(robot, motion, out, stepping=stepping, first_step=first_step)
    if not quiet:
        from asrsim.cli.console import say

        say(f"{rows} rows -> {out}")


def bench_files(robot_file: Path, motion_file: Path, out: Path, *, stepping: str, first_step: float | None) -> int:
    """Run the bench from files; returns the number of rows written."""
    import numpy as np

    from asrsim.robot import load_robot
    from asrsim.simulation.bench import OUTPUTS, run_bench

    check_output(out, "bench", inputs=[robot_file, motion_file])
    robot = load_robot(robot_file)
    time, motions = read_motion(motion_file, robot)
    results = run_bench(robot, time, motions, stepping=stepping, first_step=first_step)
    names = [f"{joint}.{column}" for joint in results for column in OUTPUTS]
    columns = [results[joint][column] for joint in results for column in OUTPUTS]
    write_text(out, csv_text(["time", *names], np.column_stack([time, *columns])), "bench")
    return len(time)


def read_motion(path: Path, robot: Robot) -> tuple[Array, dict[str, Motion]]:
    """Times (n,) in s and the motion of each joint of a motion CSV; raises RecordingError with every problem found."""
    import numpy as np

    from asrsim.simulation.bench import Motion

    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            rows = list(csv.reader(stream))
    except (OSError, UnicodeDecodeError) as error:
        said = error.strerror if isinstance(error, OSError) else error
        raise RecordingError(f"cannot be read: {said}", file=path, hint=similar_file(path), code="unreadable") from error
    if len(rows) < 2:
        raise RecordingError(
            "has no rows; expected a header with time, <joint>.position, <joint>.velocity", file=path, code="empty"
        )
    header = [name.strip() for name in rows[0]]
    joints, problems = _check_header(path, header, robot)
    table = np.full((len(rows) - 1, len(header)), math.nan)
    for line, row in enumerate(rows[1:], start=2):
        if len(row) != len(header):
            problems.append(Problem(f"has {len(row)} cells, the header {len(header)}", file=path, line=line, code="ragged-row"))
            continue
        for index, text in enumerate(row):
            try:
                value = float(text)
            except ValueError:
                value = math.nan
            if not math.isfinite(value):
                problems.append(
                    Problem(
                        "must be a finite number",
                        file=path,
                        line=line,
                        key=header[index],
                        value=text,
                        code="not-a-number",
                    )
                )
            table[line - 2, index] = value
        if len(problems) > 20:
            break
    if not problems:
        time = table[:, header.index("time")]
        backward = np.flatnonzero(np.diff(time) <= 0.0)
        if len(backward):
            problems.append(Problem("time must ascend", file=path, line=int(backward[0]) + 3, key="time", code="backward-time"))
    if problems:
        raise RecordingError(problems)

    def column(joint: str, name: str) -> Array:
        key = f"{joint}.{name}"
        return table[:, header.index(key)] if key in header else np.zeros(len(table))

    return table[:, header.index("time")], {
        joint: Motion(
            position=column(joint, "position"),
            velocity=column(joint, "velocity"),
            reference_1=column(joint, "reference_1"),
            reference_2=column(joint, "reference_2"),
        )
        for joint in joints
    }


def _column_hint(name: str, valid: list[str], actuated: list[str]) -> str:
    if name in actuated:
        return f"Expected {', '.join(f'{name}.{column}' for column in INPUTS)}."
    return did_you_mean(name, valid) or f"Joints with an actuator: {', '.join(actuated) or 'none'}."


def _check_header(path: Path, header: list[str], robot: Robot) -> tuple[list[str], list[Problem]]:
    """Joints of the header in the robot's order, and what is wrong with it."""
    problems = []
    actuated = [joint.name for joint in robot.moving_joints if any(block.joint == joint.name for block in robot.actuators)]
    valid = ["time", *(f"{joint}.{name}" for joint in actuated for name in INPUTS)]
    for name in header:
        if name not in valid:
            problems.append(
                Problem(
                    "is not a column of the bench",
                    file=path,
                    line=1,
                    key=name,
                    hint=_column_hint(name, valid, actuated),
                    code="unknown-column",
                )
            )
        elif header.count(name) > 1:
            problems.append(Problem("stands twice in the header", file=path, line=1, key=name, code="duplicate-column"))
    joints = [joint for joint in actuated if any(name.startswith(f"{joint}.") for name in header)]
    required = ["time", *(f"{joint}.{name}" for joint in joints or actuated[:1] for name in INPUTS[:2])]
    problems += [
        Problem("column is missing", file=path, line=1, key=name, code="missing-column")
        for name in required
        if name not in header
    ]
    return joints, problems
