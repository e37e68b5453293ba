"""`asrsim ilc`: iterative learning control of a scenario, with a live table, resumption and transfer."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from rich.table import Table

    from asrsim.learning.iterate import Trial
    from asrsim.learning.plant import Prepared
    from asrsim.learning.session import Session
    from asrsim.learning.transfer import TransferReport
    from asrsim.scenario import Scenario


class KeepLogs(StrEnum):
    """Whose logs are kept."""

    none = "none"
    last = "last"
    all = "all"


def ilc(
    scenario: Annotated[Path, typer.Argument(help="Scenario with a block `ilc`.", show_default=False)],
    variant: Annotated[str | None, typer.Option(help="The variant to learn.", show_default="the only one")] = None,
    set_: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Replace a key of the scenario; may be repeated.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder of the results.", show_default="<scenario>_ilc")
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on after an interruption, exactly.")] = False,
    transfer: Annotated[
        bool, typer.Option("--transfer", help="Play what was learned to plants that differ, as `ilc.transfer` says.")
    ] = False,
    draws: Annotated[int | None, typer.Option(min=1, help="Plants of the transfer.", show_default="the scenario's")] = None,
    keep_logs: Annotated[KeepLogs | None, typer.Option(help="Logs to keep.", show_default="the scenario's")] = None,
    processes: Annotated[int, typer.Option(min=1, help="Processes for transfer and sets of plants.")] = 2,
    picture: Annotated[bool, typer.Option("--picture/--no-picture", help="Draw error and trajectories.")] = True,
    json: Annotated[bool, typer.Option("--json", help="Print JSON for machines.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print the outcome only.")] = False,
) -> None:
    """Learn inputs that make the joints follow `ilc.trajectory`, trial by trial; exit code 1 if that does not converge.

    Example: asrsim ilc examples/scenarios/ilc_2dof.yaml

    Example: asrsim ilc examples/scenarios/ilc_2dof.yaml --set ilc.gain=model --transfer
    """
    from asrsim.errors import InputError, Problem
    from asrsim.learning.plant import make_plant
    from asrsim.learning.session import run_session

    chosen = _choose(scenario, variant, set_ or [])
    if transfer and not chosen.learning.get("transfer"):
        raise InputError(Problem(message="--transfer needs the block `ilc.transfer`: what differs, by how much", file=scenario))
    folder = out or Path(f"{scenario.stem}_ilc")
    show = _Progress(silent=json or quiet)
    try:
        with show:
            session = run_session(
                make_plant(chosen),
                folder,
                on_start=show.start,
                on_trial=show.add,
                resume=resume,
                keep_logs=keep_logs.value if keep_logs else None,
                with_transfer=transfer,
                draws=draws,
                processes=processes,
                picture=picture,
            )
    except KeyboardInterrupt:
        typer.echo(f"asrsim: interrupted; the trials so far are in {folder / 'state.npz'}: go on with --resume", err=True)
        raise typer.Exit(130) from None
    _report(session, folder, json=json)
    if not session.result.converged:
        raise typer.Exit(1)


def _choose(path: Path, variant: str | None, overrides: list[str]) -> Scenario:
    from asrsim.errors import Problem, ScenarioError
    from asrsim.scenario import load_scenario

    scenarios = load_scenario(path, variant=variant, overrides=overrides)
    if len(scenarios) > 1:
        raise ScenarioError(
            Problem(
                message="has several variants: choose one with --variant",
                file=path,
                choices=tuple(scenario.variant for scenario in scenarios),
            )
        )
    return scenarios[0]


class _Progress:
    """The live table: a row a trial."""

    def __init__(self, *, silent: bool) -> None:
        self.silent = silent
        self._live: Any = None
        self._table: Table | None = None

    def __enter__(self) -> _Progress:
        if not self.silent:
            from rich.live import Live

            self._live = Live(auto_refresh=False)
            self._live.__enter__()
        return self

    def __exit__(self, *exception: Any) -> None:
        if self._live is not None:
            self._live.__exit__(*exception)

    def start(self, prepared: Prepared) -> None:
        """Headings, and what the model says beforehand."""
        if self.silent:
            return
        from rich.table import Table

        gains = ", ".join(f"{gain:.3g}" for gain in prepared.settings.gains)
        advice = ", ".join(f"{gain:.3g}" for gain in prepared.gain_advice())
        table = Table(
            title=f"gains {gains} (the model would choose {advice}); errors shrink below {prepared.learnable():.2g} Hz",
            title_justify="left",
            title_style="",
        )
        for heading in (
            "iteration",
            *(f"{joint} [rad]" for joint in prepared.plant.joints),
            "2-norm [rad]",
            "ratio",
            "predicted",
            "s",
        ):
            table.add_column(heading, justify="right")
        self._table = table
        self._live.update(table, refresh=True)

    def add(self, trial: Trial) -> None:
        """A row."""
        if self._table is None:
            return
        ratio, predicted = ("" if value is None else f"{value:.3f}" for value in (trial.ratio, trial.predicted))
        largest = [f"{value:.4f}" for value in trial.largest]
        self._table.add_row(str(trial.number), *largest, f"{trial.norm:.4f}", ratio, predicted, f"{trial.seconds:.2f}")
        self._live.update(self._table, refresh=True)


def _report(session: Session, folder: Path, *, json: bool) -> None:
    if json:
        typer.echo((folder / "ilc.json").read_text(encoding="utf-8"), nl=False)
        return
    typer.echo(session.result.reason)
    if session.transfer is not None:
        _report_transfer(session.transfer, "transfer")
    if session.nominal_transfer is not None:
        _report_transfer(session.nominal_transfer, "the same, learned on one plant")
    typer.echo(f"in {folder}: learned.csv, and learned.yaml for asrsim run")


def _report_transfer(report: TransferReport, title: str) -> None:
    quantiles = report.quantiles((0.05, 0.5, 0.95))
    low, middle, high = (f"{value:.3g}" for value in quantiles.values())
    typer.echo(
        f"{title}: {100 * report.within:.0f} % of {len(report.draws)} plants stay within {report.tolerance:g} rad; "
        f"largest error {low} / {middle} / {high} rad (5 / 50 / 95 %)"
    )
    if report.influences:
        strongest = ", ".join(f"{item.factor} ({item.rank_correlation:+.2f})" for item in report.influences[:3])
        typer.echo(f"  what matters most (rank correlation): {strongest}")
