"""`asrsim bench`: applies a recorded or computed link motion to the actuators of a URDF."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from asrsim.cli.command import Done, command
from asrsim.cli.console import say_written
from asrsim.cli.options import Plot, into_file
from asrsim.errors import Problem, RecordingError
from asrsim.outfile import check_output, csv_text, write_text

INPUTS = ("position", "reference_1", "reference_2", "external_torque")
"""Columns that the table may have for a joint; the position is required."""


@command("Print nothing.")
def bench(
    robot: Annotated[Path, typer.Argument(metavar="ROBOT", help="URDF or xacro file.", show_default=False)],
    motion: Annotated[
        Path,
        typer.Argument(
            metavar="MOTION",
            help="CSV with time and <joint>.position, and any of .reference_1, .reference_2, .external_torque.",
            show_default=False,
        ),
    ],
    out: Annotated[Path, into_file("CSV to write.", ".csv")] = Path("bench.csv"),
    plot: Plot = True,
) -> Done:
    """Apply a prescribed link motion to the actuators, as on a test bench.

    Runs a scenario with `engine: bench` that plays the columns of the table, with its mean time step. The output has a row
    for each step, with the time and everything that the joints record, in full precision.

    Example: asrsim bench examples/urdf/dof1_sea.urdf examples/recordings/bench_motion.csv -o bench.csv
    """
    import numpy as np

    from asrsim.api import run
    from asrsim.scenario import make_scenario
    from asrsim.signals.recorded import read_column, series_names

    check_output(out, "bench", inputs=[robot, motion])
    joints = _joints(motion, series_names(motion), robot)
    time = read_column(motion, f"{next(iter(joints))}.position", "time")[0]
    duration = float(time[-1] - time[0])
    if len(time) < 2:
        raise RecordingError("needs two rows at least", file=motion, code="too-short")

    def played(column: str) -> dict[str, Any]:
        return {"playback": {"file": str(motion.resolve()), "column": column, "time": "time", "start": 0.0}}

    tables: dict[str, Any] = {"motion": {}, "references": {}, "external_torques": {}}
    for joint, (names, references) in joints.items():
        tables["motion"][joint] = played(f"{joint}.position")
        given = zip(INPUTS[1:], references, strict=False)
        tables["references"][joint] = {own: played(f"{joint}.{name}") for name, own in given if name in names}
        if "external_torque" in names:
            tables["external_torques"][joint] = played(f"{joint}.external_torque")
    step = float(f"{duration / (len(time) - 1):.12g}")
    scenario = make_scenario(robot, duration=duration, step=step, engine="bench", **tables)
    result = run(scenario)
    columns = {f"{joint}.{name}": result[joint][name] for joint in joints for name in result[joint].info.quantities}
    table = np.column_stack([result.time + time[0], *columns.values()])
    write_text(out, csv_text(["time", *columns], table), "bench")
    files = [out]
    if plot:
        from asrsim.plots.output import save_figure

        files += save_figure(result.plot(joints=list(joints)), out.parent, out.stem, ("png",))
    return Done(data={"ok": True, "files": [str(path) for path in files]}, text=lambda: say_written(files))


def _joints(path: Path, header: Sequence[str], file: Path) -> dict[str, tuple[list[str], tuple[str, ...]]]:
    """Columns of the header that belong to each joint, and the references of the joint's mode. Raises RecordingError for a
    wrong header.
    """
    from asrsim.actuators import ACTUATORS, MODES
    from asrsim.robot import load_robot

    modes = {one.joint: MODES[one.mode].references_of(ACTUATORS.get(one.actuator).motors) for one in load_robot(file).actuators}
    if not modes:
        raise RecordingError("the robot has no actuator", file=file, code="no-actuator")
    valid = [f"{joint}.{name}" for joint in modes for name in INPUTS]
    joints = {joint: ([name for name in INPUTS if f"{joint}.{name}" in header], modes[joint]) for joint in modes}
    joints = {joint: found for joint, found in joints.items() if found[0]}
    problems = [
        Problem("is not a column of the bench", file=path, line=1, key=name, choices=tuple(valid), meant=name,
                code="unknown-column")
        for name in header if name not in valid and not name.endswith(".velocity")
    ]  # fmt: skip
    problems += [
        Problem("column of numbers is missing", file=path, line=1, key=name, code="missing-column")
        for name in (f"{joint}.position" for joint in joints or [*modes][:1])
        if name not in header
    ]
    if problems:
        raise RecordingError(problems)
    return joints
