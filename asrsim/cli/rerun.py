"""`asrsim rerun`: repeats a run from its log alone and compares all samples bit for bit."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from asrsim.cli.command import Done, command
from asrsim.cli.console import complain, say, say_problems
from asrsim.cli.interrupt import INTERRUPTED, Interruption
from asrsim.cli.options import Files, argument, option

if TYPE_CHECKING:
    from asrsim.runs.rerun import Repetition

SHOWN = 10
"""Largest number of differing series that are printed."""


@command("Print differences only.", plugins=False)
def rerun(
    log: Annotated[Path, argument("LOG", "Log of a run (MCAP), or a folder of runs.")],
    plugins: Annotated[
        Files,
        option("Plugin file that is run instead of its copy in the log; may be repeated.", "--plugin", metavar="FILE"),
    ] = None,
    trust_plugins: Annotated[
        bool, option("Run the plugin files (Python code) that the log contains.", "--trust-plugins")
    ] = False,
    *,
    quiet: bool,
    json: bool,
) -> Done:
    """Repeat a run from its log alone and compare every sample, bit for bit.

    The log of an interrupted or killed run is compared up to its last sample. Exit code: 0 if all samples are the same; 1 if
    some differ; 130 after Ctrl-C.

    Example: asrsim rerun out/step_2dof/soft/log.mcap
    """
    from asrsim.cli.progress import RunBar
    from asrsim.errors import counted
    from asrsim.log import open_log
    from asrsim.runs.folder import find_logs
    from asrsim.runs.rerun import rerun

    (logs, problems), repetitions = find_logs(log), []
    say_problems(problems, "warning")
    with Interruption() as interruption:
        for one in logs:
            with RunBar(one.name, open_log(one).duration, show=not quiet) as progress:
                repetition = rerun(
                    one, plugins=plugins or [], trust_plugins=trust_plugins, progress=progress.update, stop=interruption.stop
                )
            repetitions.append(repetition)
            if not json:
                _print(repetition, quiet=quiet)
            if interruption.requested:
                if len(repetitions) < len(logs) and not json:
                    complain(f"stopped: {counted(len(logs) - len(repetitions), 'log')} not compared")
                break
    different = not all(repetition.identical for repetition in repetitions)
    return Done(
        data=repetitions[0].as_dict() if len(logs) == 1 else {"runs": repetitions},
        code=INTERRUPTED if interruption.requested else int(different),
    )


def _print(repetition: Repetition, *, quiet: bool) -> None:
    for difference in repetition.differences[:SHOWN]:
        complain(f"differs: {difference}", "red")
    if len(repetition.differences) > SHOWN:
        complain(f"differs: {len(repetition.differences) - SHOWN} more series")
    if repetition.missing:
        complain(f"the repeated run ended ({repetition.status}) {repetition.missing} samples before the log", "red")
    for name in repetition.changed:
        complain(f"the mesh {name} has changed since the run", "yellow")
    if not repetition.identical and not repetition.partial:
        for name, (there, here) in repetition.versions.items():
            complain(f"the log was written with {name} {there}, the run was repeated with {here}", "yellow")
    part = "" if repetition.logged_status == "complete" else f" (the log is {repetition.logged_status})"
    line = f"{repetition.path}: {repetition.samples} samples compared{part}: {_verdict(repetition)}"
    if not quiet:
        say(line, "" if repetition.identical else "bold")
    elif not repetition.identical:
        # Exit code 1 needs a reason, even with --quiet.
        complain(line)


def _verdict(repetition: Repetition) -> str:
    if not repetition.samples:
        return "nothing to compare"
    if repetition.differences or repetition.missing:
        return "different"
    return "identical so far; stopped before the end of the log" if repetition.partial else "identical, bit for bit"
