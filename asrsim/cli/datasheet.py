"""`asrsim datasheet`: writes the data sheet of an actuator, after Grioli et al. (2015)."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from asrsim.cli import complete
from asrsim.cli.command import Done, command
from asrsim.cli.console import say, say_table, say_written, styled
from asrsim.cli.options import Arguments, ColumnMap, Packages, Rate, Texts, argument, folders, into_folder, option, pairs
from asrsim.tables import TableColumn


@command()
def datasheet(
    target: Annotated[
        list[str],
        argument(
            "TARGET...",
            "Name of an actuator, or a robot (.urdf, .xacro), scenario (.yaml) or plugin file (.py).",
            autocompletion=complete.actuators,
        ),
    ],
    joint: Annotated[
        Texts,
        option(
            "Joint of a robot or scenario; may be repeated.", "--joint", default="all joints with actuators", metavar="NAME"
        ),
    ] = None,
    compare: Annotated[bool, option("Also write a page with the numbers of all sheets side by side.", "--compare")] = False,
    presets: Annotated[
        tuple[float, float] | None,
        option(
            "Smallest and largest stiffness preset of the sheet, rad or m.",
            "--presets",
            default="the actuator's range",
            metavar="LOW HIGH",
        ),
    ] = None,
    inertia: Annotated[
        float | None, option("Inertia of the test load, kg m^2.", default="resonance at 3 Hz with the mean stiffness")
    ] = None,
    experiment: Annotated[
        Path | None,
        option("Recording of a test bench to draw beside the law.", "--experiment", "-e", metavar="FILE"),
    ] = None,
    mapping: ColumnMap = None,
    rate: Rate = None,
    formats: Annotated[
        Texts, option("Format of the pictures: png, pdf, svg.", "--format", default="png", metavar="NAME")
    ] = None,
    out: Annotated[Path, into_folder("Folder for the sheets.")] = Path("datasheet"),
    arg: Arguments = None,
    package: Packages = None,
    *,
    plugin: list[Path],
    quiet: bool,
) -> Done:
    """Write the data sheet of an actuator: torque, speed, power, stiffness, energy, times and bandwidths, with curves and
    simulated responses. Each number states its origin. If a number needs a parameter that the
    file does not state, its field is empty, and the sheet names the missing tag.

    Example: asrsim datasheet qbmove

    Example: asrsim datasheet examples/urdf/dof2_vertical.urdf --joint joint_1

    Example: asrsim datasheet sea examples/plugins/my_vsa.py --compare --format pdf
    """
    from asrsim.cli.progress import FractionBar
    from asrsim.datasheet import make_sheet, measured_curve, sources_of, write_sheets
    from asrsim.progress import Progress

    if inertia is not None and not 0.0 < inertia < 1e6:
        raise typer.BadParameter("must be positive", param_hint="--inertia")
    if presets is not None and not 0.0 <= presets[0] < presets[1]:
        raise typer.BadParameter("must be two numbers of at least 0, the smaller one first", param_hint="--presets")
    sources = sources_of(
        target, joints=joint or (), arguments=pairs(arg, "--arg"), packages=folders(package, "--package"), plugins=plugin
    )
    if experiment is not None and len(sources) != 1:
        raise typer.BadParameter("is a recording of one actuator: name only this actuator", param_hint="--experiment")
    sheets = []
    with FractionBar(show=not quiet) as bar:
        for i, source in enumerate(sources):
            bar.update(Progress(task=source.name, fraction=i / len(sources)))
            measured = [] if experiment is None else [measured_curve(source, experiment, mapping or (), rate=rate)]
            sheets.append(make_sheet(source, presets=presets, inertia=inertia, measured=measured))
    files = write_sheets(sheets, out, compare=compare, formats=formats or ("png",))

    def text() -> None:
        for sheet in sheets:
            say(f"{styled(sheet.title, 'bold cyan')}  {sheet.origin}")
            rows = sheet.entries
            say_table(
                [
                    TableColumn("quantity", [one.words for one in rows]),
                    TableColumn("value", [f"{one.value:.4g}" if one.known else "" for one in rows], right=True),
                    TableColumn("unit", [one.unit if one.known else "" for one in rows]),
                    TableColumn("how", [one.how for one in rows]),
                ]
            )
            for doubt in sheet.doubts:
                say(f"note {doubt}", "yellow")
            say(f"to repeat the simulations, run in {out}/: {sheet.command}")
        say_written(files)

    return Done(data={"ok": True, "files": files, "sheets": [sheet.as_dict() for sheet in sheets]}, text=text)
