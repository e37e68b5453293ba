"""What `asrsim ilc` prints: what the model says beforehand, a line a trial, the outcome."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from asrsim.learning.prepared import Prepared
    from asrsim.learning.session import Session
    from asrsim.learning.transfer import TransferReport
    from asrsim.learning.trial import Trial

MOST_DEMANDS = 5
"""Demands out of reach that are printed."""


def before_trials(prepared: Prepared) -> list[str]:
    """What the model says before the first trial, a line each."""
    settings = prepared.settings
    if settings.law == "auto":
        lines = ["law auto: norm-optimal over three models, from inverse dynamics"]
    else:
        gains, advice = (
            ", ".join(f"{gain:.3g}" for gain in values) for values in (settings.joint_gains.values(), prepared.gain_advice())
        )
        cutoff = "no filter" if settings.filter is None else f"filter {settings.filter.cutoff:.3g} Hz"
        lines = [
            f"law {settings.law}: gains {gains} (the model's {advice}), {cutoff}; errors shrink below {prepared.reach:.2g} Hz"
        ]
    return [*lines, *prepared.notes, *reach_of(prepared)]


def reach_of(prepared: Prepared) -> list[str]:
    """What the motion asks of the joints, a line each."""
    beyond = [str(demand) for demand in prepared.exceeding[:MOST_DEMANDS]]
    if beyond:
        error = f"{prepared.followed:.2g} {prepared.problem.unit}"
        if prepared.out_of_reach:
            return [f"out of reach: simulated trials stay {error} off", *(f"out of reach: {demand}" for demand in beyond)]
        return [f"within reach: simulated trials come within {error}, although limits are exceeded: {'; '.join(beyond)}"]
    worst = prepared.demands[:1]
    return [f"within reach; the most that is asked is {100 * demand.score:.0f} %: {demand}" for demand in worst]


class TrialTable:
    """The live table: a line a trial, as it ends."""

    def __init__(self) -> None:
        self._widths: list[int] = []

    def start(self, prepared: Prepared) -> None:
        """What the model says beforehand, and the headings."""
        from asrsim.cli.console import say

        for line in before_trials(prepared):
            say(line, "yellow" if line.startswith("out of reach") else "")
        self.headings(prepared)

    def headings(self, prepared: Prepared) -> None:
        """Above the trials."""
        from asrsim.cli.console import say

        unit = prepared.problem.unit
        say(f"largest error of each joint and largest 2-norm in {unit}; its ratio to the trial before")
        headings = ("trial", *prepared.plant.joints, "2-norm", "ratio", "s")
        self._widths = [max(len(heading), 7) for heading in headings]
        self._say(headings, "bold")

    def row(self, trial: Trial) -> None:
        """A trial."""
        ratio = "" if trial.ratio is None else f"{trial.ratio:.3f}"
        largest = [f"{value:.4f}" for value in trial.largest]
        self._say((str(trial.number), *largest, f"{trial.norm:.4f}", ratio, f"{trial.seconds:.2f}"))

    def _say(self, cells: tuple[str, ...], style: str = "") -> None:
        import sys

        from asrsim.cli.console import say

        say("  ".join(cell.rjust(width) for cell, width in zip(cells, self._widths, strict=True)), style)
        sys.stdout.flush()


def report(session: Session, folder: Path, plugins: Sequence[Path], *, silent: bool) -> dict[str, Any]:
    """Print what came out, unless `silent`; the same as plain values. plugins: that were named."""
    from asrsim.actuators.user import command_line
    from asrsim.cli.console import say
    from asrsim.learning.session import session_data

    data = {"ok": session.result.converged, "folder": str(folder), **session_data(session)}
    if silent:
        return data
    say(session.result.reason, "green" if session.result.converged else "red")
    if session.transfer is not None:
        _say_transfer(session.transfer)
    if session.replaced is not None:
        say(str(session.replaced))
    say(f"wrote {folder}{os.sep}: {', '.join(sorted(path.name for path in folder.iterdir()))}")
    say(f"play what was learned: {command_line('run', folder / 'learned.yaml', plugins)}")
    return data


def _say_transfer(report: TransferReport) -> None:
    from asrsim.cli.console import say

    low, middle, high = (f"{value:.3g}" for value in report.quantiles((0.05, 0.5, 0.95)).values())
    least, most = (f"{100 * value:.0f}" for value in report.within_interval)
    say(
        f"transfer: {100 * report.within:.0f} % of {len(report.draws)} plants stay within {report.tolerance:g} {report.unit} "
        f"(95 %: {least} to {most} %); largest error {low}, {middle}, {high} {report.unit} (5, 50, 95 %)"
    )
