"""`asrsim twin`: a twin follows a recording of the robot."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from asrsim.cli.command import Done, command
from asrsim.cli.console import say, say_table, say_written
from asrsim.cli.interrupt import INTERRUPTED, Interruption
from asrsim.cli.options import ColumnMap, Overrides, Plot, Rate, Scenario, Variant, View, into_folder, option
from asrsim.tables import TableColumn


@command()
def twin(
    scenario: Scenario,
    experiment: Annotated[Path, option("Recording of commands and link positions.", "--experiment", "-e", metavar="FILE")],
    bandwidth: Annotated[
        float | None, option("Bandwidth of the observer, Hz.", default="8, but at most a twentieth of the rate of steps")
    ] = None,
    mapping: ColumnMap = None,
    rate: Rate = None,
    clock_offset: Annotated[
        float, option("Time by which the clock of the positions is ahead of the clock of the commands, s.")
    ] = 0.0,
    variant: Variant = None,
    overrides: Overrides = None,
    out: Annotated[Path, into_folder("Folder for table and picture.")] = Path("out/twin"),
    plot: Plot = True,
    view: View = False,
    *,
    quiet: bool,
) -> Done:
    """Find the external torques on a robot, and the stiffness of its joints, from a recording of commands and link positions.

    A simulation receives the commands, and an observer corrects it towards the measured positions. An alarm means contact, or a
    robot that differs from its model.

    Example: asrsim twin lab.yaml --experiment examples/recordings/two_joints.csv
    """
    from asrsim.cli.progress import FractionBar
    from asrsim.twin.follow import Followed, follow_recording, write

    options: dict[str, Any] = {
        "bandwidth": bandwidth,
        "mapping": mapping,
        "rate": rate,
        "clock_offset": clock_offset,
        "variant": variant,
        "overrides": overrides or (),
    }
    written: list[Path] = []
    message = "asrsim: stopping; the results so far are kept (Ctrl-C again to abort)"
    with Interruption(message) as interruption, FractionBar(show=not quiet) as bar:

        def work(**more: Any) -> Followed:
            return follow_recording(scenario, experiment, progress=bar.update, **options, **more)

        def done(found: Followed) -> None:
            written.extend(write(found, out, plot=plot))

        if view:
            from asrsim.cli.view import show_page
            from asrsim.simulation.prepare import prepare
            from asrsim.viewer.twin import FollowView

            ready = prepare(scenario, variant=variant, overrides=overrides or ())
            _, found = show_page(lambda page: FollowView(page, ready, work, done), interruption.stop, quiet=quiet)
        else:
            found = work(stop=interruption.stop)
            done(found)
    rows = found.rows()

    def text() -> None:
        torque, stiffness, length = (
            " or ".join(dict.fromkeys(found.units[field])) for field in ("external_torque", "stiffness", "residual")
        )
        heads = {
            f"external torque\nrms, {torque}": "external_torque_rms",
            f"largest\n{torque}": "largest",
            "at\ns": "largest_at",
            f"residual\nrms, {length}": "residual_rms",
        }
        say_table(
            [
                TableColumn("joint", [row["joint"] for row in rows]),
                *(TableColumn(head, [f"{row[key]:.3g}" for row in rows], right=True) for head, key in heads.items()),
                TableColumn("alarms", [str(len(row["alarms"])) for row in rows], right=True),
                TableColumn(f"stiffness\n{stiffness}", [_range(row["stiffness"]) for row in rows], right=True),
            ]
        )
        for note in found.notes[:20]:
            say(note)
        if len(found.notes) > 20:
            say(f"and {len(found.notes) - 20} further notes (--json prints all)")
        say_written(written)

    data = {"ok": True, "joints": rows, "notes": list(found.notes), "files": written}
    return Done(data=data, text=text, code=INTERRUPTED if found.interrupted else 0)


def _range(ends: list[float] | None) -> str:
    return f"{ends[0]:.3g} to {ends[1]:.3g}" if ends else "-"
