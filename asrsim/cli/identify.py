"""`asrsim identify`: parameters from recordings, with intervals, verdicts, and the robot written back."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from asrsim.cli import complete
from asrsim.cli.command import Done, command
from asrsim.cli.console import say, say_table, say_written
from asrsim.cli.interrupt import INTERRUPTED, Interruption
from asrsim.cli.options import ColumnMap, Files, Overrides, Plot, Rate, Texts, Variant, argument, into_folder, option
from asrsim.errors import InputError, counted

if TYPE_CHECKING:
    from asrsim.identification import FitResult, Task
    from asrsim.identification.resume import Resumed


@command()
def identify(
    scenario: Annotated[
        Path,
        argument("SCENARIO", "Scenario of the robot, or a fit file (with `experiments:`)."),
    ],
    experiment: Annotated[Files, option("A recording to fit; may be repeated.", "--experiment", "-e", metavar="FILE")] = None,
    validate: Annotated[
        Files,
        option("A recording that is predicted but not fitted. Default: the last part of each recording.", metavar="FILE"),
    ] = None,
    free: Annotated[
        Texts,
        option(
            "A parameter, or a pattern: 'joint_1.spring_*', link_1.izz, "
            "joint_1.damping=0.1, KEY=LOW:HIGH, KEY=LOW:START:HIGH. May be repeated.",
            "--free",
            metavar="KEY[=START]",
            autocompletion=complete.robot_keys,
        ),
    ] = None,
    tie: Annotated[
        Texts,
        option(
            "A parameter that is a multiple of another parameter; * matches the same text on both sides.",
            "--tie",
            metavar="KEY=[FACTOR*]KEY",
        ),
    ] = None,
    own: Annotated[
        Texts,
        option("A free parameter with a separate value for each recording.", "--own", metavar="KEY"),
    ] = None,
    mapping: ColumnMap = None,
    rate: Rate = None,
    variant: Variant = None,
    overrides: Overrides = None,
    hold_out: Annotated[
        float | None,
        option("Fraction at the end of each recording that is predicted but not fitted.", min=0.0, max=0.9, default="0.25"),
    ] = None,
    check: Annotated[
        bool,
        option("Do not fit: show which parameters the recordings can identify, and which motions to add.", "--check"),
    ] = False,
    everything: Annotated[
        bool, option("Write all parameters to the robot file, not only the identified parameters.", "--all")
    ] = False,
    accept: Annotated[
        bool,
        option(
            "Write the robot although the model does not fit, if it explains 90 % of the variance of each channel; without "
            "this option, 95 % are needed.",
            "--accept",
        ),
    ] = False,
    adopt: Annotated[
        bool, option("If effects are missing in the model, add the suspected effects, and fit again.", "--adopt")
    ] = False,
    resume: Annotated[
        bool,
        option(
            "Write the robot from the numbers of the finished fit in the folder of the results, without a new fit.", "--resume"
        ),
    ] = False,
    out: Annotated[Path | None, into_folder("Folder for the results.", "out/<name>/fit")] = None,
    duration: Annotated[
        float | None,
        option(
            "Longest time of the search. If this time ends the search, the best fit so far is reported as unfinished.",
            "--duration",
            metavar="SECONDS",
            min=0.0,
            default="no limit",
        ),
    ] = None,
    sheet: Annotated[
        bool,
        option("Also write the data sheet of each identified actuator, with its recorded torque over deflection.", "--sheet"),
    ] = False,
    plot: Plot = True,
    *,
    plugin: list[Path],
    quiet: bool,
) -> Done:
    """Fit parameters of a robot to recordings, with intervals and a verdict on each parameter.

    Verdicts: identified (95 % interval within 5 %), weak, only as ratio, no effect, at bound. The fit is tested on data that
    were held out, and the robot is written with the identified numbers. --duration and Ctrl-C keep the best fit so far. Exit
    code: 0; 1 if nothing could be fitted, the model does not fit, or --duration ended the search; 130 after Ctrl-C.

    `asrsim init ROBOT --experiment FILE --out lab.yaml` writes a fit file. Options beside a fit file add to its `free` and
    `ties` and to the `map` of each recording; they replace the other values of the file.

    Example: asrsim identify lab.yaml --experiment examples/recordings/two_joints.csv --free 'joint_1.spring_*' --check
    """
    from asrsim.identification.task import task_of
    from asrsim.identification.write import fit_data

    options: dict[str, Any] = {
        "validate": validate,
        "free": free,
        "ties": tie,
        "own": own,
        "mapping": mapping,
        "rate": rate,
        "variant": variant,
        "overrides": overrides,
        "hold_out": hold_out,
        "plugins": plugin,
    }
    task = task_of(
        scenario, experiment or [], **{name: value for name, value in options.items() if value not in (None, [], ())}
    )
    folder = out or Path("out") / task.name / "fit"
    if resume and (check or adopt or duration is not None):
        message = "--resume makes no fit: leave out --check, --adopt and --duration"
        raise InputError(message, code="resume")
    if resume:
        return _resume(task, folder, everything=everything, accept=accept)
    result, code = _run(task, check=check, quiet=quiet, accept=accept, adopt=adopt, duration=duration)
    files, said = ([], []) if check else _write(result, folder, everything=everything, plot=plot, sheet=sheet)
    data = {"ok": code == 0, **fit_data(result), "files": files}
    return Done(data=data, text=lambda: _say(result, files, said), code=code)


def _run(task: Task, *, check: bool, quiet: bool, accept: bool, adopt: bool, duration: float | None) -> tuple[FitResult, int]:
    from asrsim.cli.progress import FitBar
    from asrsim.identification import identify

    with (
        Interruption("asrsim: stopping; the best fit so far is judged and kept (Ctrl-C again to abort)") as interruption,
        FitBar(task.name, show=not quiet) as progress,
    ):
        result = identify(
            task, progress=progress.update, stop=interruption.stop, check=check, accept=accept, adopt=adopt, duration=duration
        )
    if result.status == "interrupted":
        return result, INTERRUPTED
    return result, 0 if result.fits or result.status == "checked" else 1


def _resume(task: Task, folder: Path, *, everything: bool, accept: bool) -> Done:
    """Write the robot with the numbers of an earlier fit, and state in the fit's fit.json whether the fit is accepted."""
    import json

    from asrsim.identification.folder import FIT, read_fit
    from asrsim.identification.resume import resumed
    from asrsim.identification.show import estimate_columns
    from asrsim.outfile import write_json
    from asrsim.runs.lock import owned

    found = resumed(read_fit(folder), task, accept=accept)
    with owned(folder):
        files, said = _robot(found, folder, everything=everything)
        data = json.loads((folder / FIT).read_text(encoding="utf-8")) | {"accepted": found.accepted}
        write_json(folder / FIT, data)
    files, code = [folder / FIT, *files], 0 if found.fits else 1

    def text() -> None:
        say_table(estimate_columns(found))
        for line in (*found.misfit, *said):
            say(line)
        say_written(files)

    return Done(data={"ok": code == 0, **data, "files": files}, text=text, code=code)


def _robot(found: FitResult | Resumed, folder: Path, *, everything: bool) -> tuple[list[Path], list[str]]:
    """Write the robot of a complete fit, unless it is not accepted; return paths and remarks."""
    from asrsim.identification.judge import ACCEPTABLE
    from asrsim.identification.write import write_robot

    if found.fits or found.accepted or everything:
        return write_robot(found, folder, everything=everything)
    ways = "--accept or --all" if found.explained >= ACCEPTABLE else "--all"
    return [], [
        f"no robot is written, since the model does not fit; the same command with --resume and {ways} writes it anyway"
    ]


def _write(result: FitResult, folder: Path, *, everything: bool, plot: bool, sheet: bool) -> tuple[list[Path], list[str]]:
    from asrsim.designs.advice import advice, design_line
    from asrsim.identification.folder import FIT
    from asrsim.identification.write import fit_data, write_curves_of
    from asrsim.outfile import write_json
    from asrsim.runs.lock import owned

    with owned(folder):
        files, said = [folder / FIT], list[str]()
        advices = list(advice(result))
        write_json(folder / FIT, {**fit_data(result), "next": advices})
        if result.status == "complete":
            written, said = _robot(result, folder, everything=everything)
            files += written
            found, line = design_line(result, folder)
            files += [*found, write_curves_of(result, folder)]
            said += [f"next experiment: {line}"] if line else []
            write_json(folder / FIT, {**fit_data(result), "next": [*advices, *([line] if line else [])]})
        if plot and result.status == "complete":
            from asrsim.identification.write import draw_recordings

            files += draw_recordings(result, folder)
        if sheet and result.status == "complete":
            from asrsim.datasheet import fitted_sheets, write_sheets

            files += write_sheets(fitted_sheets(result), folder / "datasheet")
    return files, said


def _say(result: FitResult, files: list[Path], said: list[str]) -> None:
    from asrsim.designs.advice import advice
    from asrsim.identification.show import errors, estimate_columns, judgement

    say_table(estimate_columns(result))
    say()
    say_table(errors(result))
    say()
    for text, style in judgement(result):
        say(text, style)
    advices = list(advice(result))
    if advices:
        say("to identify more parameters:", "bold")
    for text in (*(f"  {text}" for text in advices), *said):
        say(text)
    say(f"{counted(result.evaluations, 'evaluation')}, {result.seconds:.1f} s", "dim")
    say_written(files)
