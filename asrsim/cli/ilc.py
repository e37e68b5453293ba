"""`asrsim ilc`: iterative learning control of a scenario, with a live table, resumption and transfer."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from asrsim.cli.completion import variants
from asrsim.cli.ilc_table import TrialTable, reach_of, report
from asrsim.cli.options import Align, ColumnMap, Json, Overrides, Plugins, into_folder, lag_of, load_plugins, mapping_of

if TYPE_CHECKING:
    from asrsim.learning.session import Session
    from asrsim.recordings.align import LagChoice
    from asrsim.scenario.data import Scenario


class KeepLogs(StrEnum):
    """Whose logs are kept."""

    NONE = "none"
    LAST = "last"
    ALL = "all"


def ilc(
    scenario: Annotated[
        Path, typer.Argument(metavar="SCENARIO", help="Scenario file (YAML) with a block `ilc`.", show_default=False)
    ],
    variant: Annotated[
        str | None, typer.Option(help="Learn this variant.", show_default="the only one", autocompletion=variants)
    ] = None,
    overrides: Overrides = None,
    out: Annotated[Path | None, into_folder("Folder for the results.", "out/<scenario>/ilc")] = None,
    trajectory: Annotated[
        str | None, typer.Option(help="Learn this one of `ilc.trajectories`.", show_default="all, one after the other")
    ] = None,
    guess_only: Annotated[
        bool, typer.Option("--guess-only", help="Write the input of inverse dynamics (guess.csv, guess.yaml); learn nothing.")
    ] = False,
    recording: Annotated[
        Path | None,
        typer.Option(
            "--next", metavar="RECORDING", help="Learn on the robot: from this trial on it to its next input (next.csv)."
        ),
    ] = None,
    mapping: ColumnMap = None,
    align: Align = "off",
    resume: Annotated[bool, typer.Option("--resume", help="Go on after an interruption, exactly where it was.")] = False,
    transfer: Annotated[
        bool, typer.Option("--transfer", help="Play what was learned to plants that differ, as `ilc.transfer` says.")
    ] = False,
    draws: Annotated[int | None, typer.Option(min=1, help="Plants of the transfer.", show_default="the scenario's")] = None,
    keep_logs: Annotated[
        KeepLogs | None, typer.Option(help="Trials whose logs are kept.", show_default="the scenario's")
    ] = None,
    processes: Annotated[int, typer.Option(min=1, help="Processes for the transfer.")] = 2,
    plugin: Plugins = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace what another scenario learned there too.")] = False,
    plot: Annotated[bool, typer.Option("--plot/--no-plot", help="Draw errors and trajectories.")] = True,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print the outcome only.")] = False,
    json: Json = False,
) -> None:
    """Learn the inputs that make the joints follow `ilc.trajectory`, trial by trial (paper section 4.3).

    Writes the learned inputs (learned.csv), a scenario that plays them (learned.yaml), the numbers (ilc.json), pictures
    (ilc.png, transfer.png), and the state to resume from. What an earlier run of the same scenario left there is replaced,
    and the command says so; that of another one is kept unless --overwrite is given. Exit code: 0, 1 if learning did not
    converge or a run failed, 130 after Ctrl-C.

    Example: asrsim ilc examples/scenarios/ilc_2dof.yaml

    Example: asrsim ilc examples/scenarios/ilc_2dof.yaml --set ilc.law=auto --transfer

    Example: asrsim ilc examples/scenarios/ilc_2dof.yaml --next trial_7.mcap
    """
    from asrsim.cli.console import complain, json_errors, say, say_json
    from asrsim.cli.interrupt import INTERRUPTED

    folder: Path | None = None
    converged = True
    try:
        with json_errors(json):
            chosen = _choose(scenario, variant, overrides or [], plugin or [])
            found = []
            for name, one in _trajectories(chosen, trajectory).items():
                folder = (out or Path("out") / chosen.name / "ilc") / name
                if name and not json:
                    say(f"trajectory {name}", "bold")
                if guess_only:
                    found.append(_guess(one, folder, plugin or [], overwrite=overwrite, silent=json))
                    continue
                if recording is not None:
                    step = _next(one, folder, recording, mapping_of(mapping), lag_of(align), silent=json)
                    found.append(step)
                    converged = converged and bool(step["converged"] or not step["outcome"])
                    continue
                session = _learn(
                    one, folder, resume=resume, with_transfer=transfer, draws=draws, keep_logs=keep_logs,
                    processes=processes, plugins=plugin or [], overwrite=overwrite, plot=plot, silent=quiet or json,
                )  # fmt: skip
                converged = converged and session.result.converged
                found.append(report(session, folder, plugin or [], silent=json))
    except KeyboardInterrupt:
        where = f"; the trials so far are in {folder / 'state.npz'}: go on with --resume" if folder else ""
        complain(f"\nasrsim: interrupted{where}")
        raise typer.Exit(INTERRUPTED) from None
    if json:
        say_json(found[0] if len(found) == 1 else {"ok": converged, "trajectories": found})
    if not converged:
        raise typer.Exit(1)


def _trajectories(scenario: Scenario, name: str | None) -> dict[str, Scenario]:
    """Those to be learned, by name."""
    from asrsim.errors import ScenarioError
    from asrsim.learning.plant import trajectories

    known = trajectories(scenario)
    if name is None:
        return known
    if name not in known:
        names = tuple(filter(None, known))
        raise ScenarioError(
            f"has no trajectory '{name}'", file=scenario.path, key="ilc.trajectories", choices=names, meant=name
        )
    return {name: known[name]}


def _guess(scenario: Scenario, folder: Path, plugins: list[Path], *, overwrite: bool, silent: bool) -> dict[str, Any]:
    from asrsim.actuators.user import command_line
    from asrsim.cli.console import say
    from asrsim.learning.folder import GUESS, GUESS_PLAYBACK
    from asrsim.learning.plant import make_plant
    from asrsim.learning.report import demand_data
    from asrsim.learning.session import write_guess

    prepared = write_guess(make_plant(scenario), folder, overwrite=overwrite)
    if not silent:
        for line in (*prepared.notes, *reach_of(prepared)):
            say(line, "yellow" if line.startswith("out of reach") else "")
        say(f"wrote {folder / GUESS}, of inverse dynamics; play it: {command_line('run', folder / GUESS_PLAYBACK, plugins)}")
    demands = [demand_data(demand) for demand in prepared.demands]
    return {"ok": True, "folder": str(folder), "demands": demands}


def _next(
    scenario: Scenario, folder: Path, recording: Path, mapping: tuple[str, ...] | Path | None, lag: LagChoice, *, silent: bool
) -> dict[str, Any]:
    from asrsim.cli.console import say, say_problems
    from asrsim.cli.recording_table import say_columns
    from asrsim.learning.hardware import NEXT, next_input
    from asrsim.learning.plant import make_plant
    from asrsim.learning.report import trial_data
    from asrsim.plain import finite_or_none

    step = next_input(make_plant(scenario), folder, recording, mapping=mapping, lag=lag)
    last = step.trials[-1]
    if not silent:
        say_columns(step.recording)
        say_problems(step.findings, "note")
        table = TrialTable()
        table.headings(step.prepared)
        for trial in step.trials:
            table.row(trial)
        if step.twin is not None:
            left = f"{step.twin.residual:.2g} rad, {step.twin.before:.2g} before"
            say(f"masses, stiffnesses, losses and a delay were fitted to the recorded trials, which they explain to {left}")
        if step.warning:
            say(step.warning, "yellow")
        if step.outcome:
            say(step.outcome, "green" if step.converged else "red")
            say(f"wrote {folder / NEXT}, the best input")
        else:
            say(f"play {folder / NEXT} on the robot, record it, and give the recording to --next again")
    return {
        "ok": True, "folder": str(folder), "converged": step.converged, "outcome": step.outcome, "clock": step.clock,
        "findings": [problem.as_dict() for problem in step.findings],
        "foretold_ratio": finite_or_none(step.foretold), "warning": step.warning,
        "trial": trial_data(last, step.prepared.plant.joints),
    }  # fmt: skip


def _choose(path: Path, variant: str | None, overrides: list[str], plugins: list[Path]) -> Scenario:
    from asrsim.scenario import load_scenario, only_variant

    load_plugins(plugins)
    return only_variant(load_scenario(path, variant=variant, overrides=overrides))


def _learn(
    scenario: Scenario, folder: Path, *, resume: bool, with_transfer: bool, draws: int | None, keep_logs: KeepLogs | None,
    processes: int, plugins: list[Path], overwrite: bool, plot: bool, silent: bool,
) -> Session:  # fmt: skip
    from asrsim.errors import ScenarioError
    from asrsim.learning.plant import make_plant
    from asrsim.learning.session import run_session

    if with_transfer and (scenario.learning is None or scenario.learning.transfer is None):
        message = "--transfer needs the block `ilc.transfer`: what differs, and by how much"
        raise ScenarioError(message, file=scenario.path, key="ilc.transfer", code="no-transfer")
    table = TrialTable()
    return run_session(
        make_plant(scenario),
        folder,
        on_start=None if silent else table.start,
        on_trial=None if silent else table.row,
        resume=resume,
        overwrite=overwrite,
        keep_logs=keep_logs.value if keep_logs else None,
        with_transfer=with_transfer,
        draws=draws,
        processes=processes,
        plugins=plugins,
        picture=plot,
    )
