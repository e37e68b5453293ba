"""What `asrsim run` says of a run."""

from __future__ import annotations

import os
from pathlib import Path

from asrsim.cli.console import complain, say, say_problems, say_table, styled
from asrsim.summary.data import RunSummary
from asrsim.summary.table import headline, joint_columns, limit_note

WARNINGS = 12
"""Kinds of warnings printed without -v."""


def print_run(summary: RunSummary, *, quiet: bool, silent: bool = False, verbose: bool = False) -> None:
    """Summary, claims, warnings and files of one run; quiet: failed claims and a divergence only; silent: nothing."""
    if silent:
        return
    title = f"{summary.scenario} / {summary.variant}"
    if not quiet:
        say(f"{styled(title, 'bold cyan')}  {headline(summary)}")
        say_table([(column.heading, column.cells, column.right) for column in joint_columns(summary)])
        say(f"  {limit_note(summary)}", "dim")
    if summary.status == "diverged":
        complain(f"asrsim: {title}: {summary.message}", "bold red")
    for claim in summary.claims:
        if not claim.holds:
            where = f"{summary.scenario_path}:{claim.expectation.line}: " if claim.expectation.line else ""
            complain(f"FAIL {where}{title if quiet else ''}{': ' if quiet else ''}{claim.text}", "red")
        elif not quiet:
            say(f"{styled('pass', 'green')} {claim.text}")
    if quiet:
        return
    _print_warnings(summary, verbose=verbose)
    if summary.replaced:
        say(f"replaced {len(summary.replaced)} file{'s' * (len(summary.replaced) != 1)} of an earlier run of this scenario")
    _print_files(summary)
    say()


def _print_warnings(summary: RunSummary, *, verbose: bool) -> None:
    if verbose:
        for warning in summary.warnings:
            say_problems([warning], "warning", "yellow")
        return
    say_problems(summary.warnings[:], "warning", "yellow")


def _print_files(summary: RunSummary) -> None:
    paths: list[Path] = []
    for entry in summary.files.values():
        paths += entry if isinstance(entry, tuple) else [entry]
    if not paths:
        return
    folder = Path(os.path.commonpath([path.parent for path in paths]))
    names = [str(path.relative_to(folder)) for path in paths]
    say(f"wrote {folder}{os.sep}: {', '.join(names)}")
