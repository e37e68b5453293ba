"""`asrsim identify`: parameters from recordings, with intervals, verdicts, and the robot written back."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from asrsim.cli import complete
from asrsim.cli.command import Done, command
from asrsim.cli.console import say, say_table, say_written
from asrsim.cli.interrupt import INTERRUPTED, Interruption
from asrsim.cli.options import ColumnMap, Files, Overrides, Plot, Rate, Texts, Variant, argument, into_folder, option

if TYPE_CHECKING:
    from asrsim.identification import Result, Task


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
            "A parameter that is a multiple of another; * matches the same text on both sides.",
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
        bool, option("Write all parameters to the robot file, not only the identified ones.", "--all")
    ] = False,
    accept: Annotated[
        bool,
        option(
            "Write the robot although the model does not fit, if it explains 90 % of the variance; without this option, 95 %.",
            "--accept",
        ),
    ] = False,
    out: Annotated[Path | None, into_folder("Folder for the results.", "out/<name>/fit")] = None,
    seconds: Annotated[
        float | None,
        option(
            "Time limit of the search. The best fit so far is then reported as unfinished.",
            "--time",
            metavar="SECONDS",
            min=0.0,
            default="no end",
        ),
    ] = None,
    plot: Plot = True,
    *,
    plugin: list[Path],
    quiet: bool,
) -> Done:
    """Fit parameters of a robot to recordings, with intervals and a verdict on each parameter.

    Verdicts: identified (95 % interval within 5 %), weak, only as ratio, no effect, at bound. The fit is tested on data that
    were held out, and the robot is written with the identified numbers. Exit code: 0, 1 if nothing could be fitted, the model
    does not fit, or --time ended the search, 130 after Ctrl-C. The best fit so far is kept.

    Example: asrsim identify lab.yaml --experiment examples/recordings/two_joints.csv --free 'joint_1.spring_*' --check

    Write a fit file for a recording: asrsim init robot.urdf --experiment a.csv --out lab.yaml
    Options beside a fit file add to `free` and `ties`, and replace its other values.
    """
    from asrsim.identification.task import task_of
    from asrsim.identification.write import as_dict

    options: dict[str, Any] = {
        "validate": validate, "free": free, "ties": tie, "own": own, "mapping": mapping,
        "rate": rate, "variant": variant, "overrides": overrides, "hold_out": hold_out, "plugins": plugin,
    }  # fmt: skip
    task = task_of(
        scenario, experiment or [], **{name: value for name, value in options.items() if value not in (None, [], ())}
    )
    folder = out or Path("out") / task.name / "fit"
    result, code = _run(task, check=check, quiet=quiet, accept=accept, seconds=seconds)
    files, said = ([], []) if check else _write(result, folder, everything=everything, plot=plot)
    data = {"ok": code == 0, **as_dict(result), "files": files}
    return Done(data=data, text=lambda: _say(result, files, said), code=code)


def _run(task: Task, *, check: bool, quiet: bool, accept: bool, seconds: float | None) -> tuple[Result, int]:
    from asrsim.cli.progress import FitBar
    from asrsim.identification import identify

    with (
        Interruption("asrsim: stopping; the best fit so far is judged and kept (Ctrl-C again to abort)") as interruption,
        FitBar(task.name, show=not quiet) as progress,
    ):
        result = identify(
            task, progress=progress.update, stop=interruption.stop, check=check,
            accept=accept, seconds=seconds,
        )  # fmt: skip
    if result.status == "interrupted":
        return result, INTERRUPTED
    return result, 0 if result.fits or result.status == "checked" else 1


def _write(result: Result, folder: Path, *, everything: bool, plot: bool) -> tuple[list[Path], list[str]]:
    from asrsim.design.advice import advice, design_line
    from asrsim.identification.folder import FIT
    from asrsim.identification.result import ACCEPTABLE
    from asrsim.identification.write import as_dict, write_curves_of, write_robot
    from asrsim.outfile import write_json
    from asrsim.runs.lock import owned

    with owned(folder):
        files, said = [folder / FIT], list[str]()
        advices = list(advice(result))
        write_json(folder / FIT, {**as_dict(result), "next": advices})
        if result.status == "complete" and (result.fits or result.accepted or everything):
            written, said = write_robot(result, folder, everything=everything)
            files += written
        elif result.status == "complete":
            ways = "--accept or --all writes" if result.explained >= ACCEPTABLE else "--all writes"
            said.append(f"no robot is written, since the model does not fit; {ways} it nevertheless")
        if result.status == "complete":
            found, line = design_line(result, folder)
            files += [*found, write_curves_of(result, folder)]
            said += [f"next experiment: {line}"] if line else []
            write_json(folder / FIT, {**as_dict(result), "next": [*advices, *([line] if line else [])]})
        if plot and result.status == "complete":
            from asrsim.identification.write import draw

            files += draw(result, folder)
    return files, said


def _say(result: Result, files: list[Path], said: list[str]) -> None:
    from asrsim.design.advice import advice
    from asrsim.identification.show import columns, errors, judgement

    say_table(columns(result))
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
    say(f"{result.evaluations} evaluations, {result.seconds:.1f} s", "dim")
    say_written(files)
