"""Terminal output of `asrsim run` about a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from asrsim.cli.console import complain, say, say_problems, say_table, say_written, styled
from asrsim.errors import counted
from asrsim.summary.data import RunSummary
from asrsim.summary.table import difference_columns, headline, limit_columns, limit_note, measure_columns, rest_note
from asrsim.tables import TableColumn


def print_run(summary: RunSummary, *, quiet: bool, printed: set[str] | None = None) -> None:
    """Print summary, claims, warnings and files of a run.

    quiet: whether only failed claims, a divergence and warnings are printed. printed: warnings that earlier runs have already
    printed. This run only counts them, and adds its own warnings to the set.
    """
    title = f"{summary.scenario} / {summary.variant}"
    if not quiet:
        say(f"{styled(title, 'bold cyan')}  {headline(summary)}")
        joints = [joint.as_dict() for joint in summary.joints]
        columns = measure_columns(joints)
        say_table(columns)
        if summary.tip:
            words = {"last": "at the end", "largest": "at most", "rms": "RMS"}
            say(f"  tip off its path by {', '.join(f'{1e3 * summary.tip[key]:.3g} mm {word}' for key, word in words.items())}")
        if moving := rest_note(joints):
            say(f"  {moving}", "dim")
        say(f"  {limit_note(summary)}", "dim")
        if limits := limit_columns(joints, [summary.total_substeps or 1] * len(joints)):
            say_table([columns[0], *limits])
    if summary.status == "diverged":
        complain(f"asrsim: {title}: {summary.message}", "bold red")
    for claim in summary.claims:
        if not claim.holds:
            where = f"{summary.scenario_path}:{claim.expectation.line}: " if claim.expectation.line else ""
            complain(f"FAIL {where}{title if quiet else ''}{': ' if quiet else ''}{claim.text}", "red")
        elif not quiet:
            say(f"{styled('pass', 'green')} {claim.text}")
    _print_certificate(summary, quiet=quiet)
    _print_cross_check(summary, quiet=quiet)
    _print_warnings(summary, printed=set() if printed is None else printed)
    if quiet:
        return
    if summary.replaced:
        say(f"replaced {counted(len(summary.replaced), 'file')} of an earlier run")
    _print_files(summary)
    say()


def _differences(summary: RunSummary, joints: Mapping[str, Mapping[str, float]]) -> Sequence[TableColumn]:
    linear = {joint.name: joint.prismatic for joint in summary.joints}
    return difference_columns([*joints], [*joints.values()], [linear[name] for name in joints])


def _print_cross_check(summary: RunSummary, *, quiet: bool) -> None:
    check = summary.cross_check
    if not check:
        return
    if not quiet:
        say(f"  cross-check: {check['engine']} against {check['other']}, differences", "dim")
        say_table(_differences(summary, check["joints"]))
        if check["note"]:
            say(f"  {check['note']}", "dim")
    if check["finding"]:
        complain(f"FAIL {summary.scenario} / {summary.variant}: {check['finding']}", "red")
    elif not quiet and not check["note"]:
        say(f"{styled('pass', 'green')} the engines agree: nothing differs by more than rounding")


def _print_certificate(summary: RunSummary, *, quiet: bool) -> None:
    if not summary.certificate:
        return
    if not quiet:
        say("  numerical error, estimated from runs at finer steps", "dim")
        say_table(_differences(summary, summary.certificate["joints"]))
        other = (
            "the cross-check compares the model with another engine"
            if summary.cross_check
            else "the run was not compared with another engine: --cross-check does this, or says what it needs"
        )
        say(f"  the estimate covers the error of the time step only, not of the model; {other}", "dim")
    for warning in summary.certificate["warnings"]:
        complain(f"{summary.scenario} / {summary.variant}: {warning}", "yellow")


def _print_warnings(summary: RunSummary, *, printed: set[str]) -> None:
    fresh = [warning for warning in summary.warnings if str(warning) not in printed]
    say_problems(fresh, "warning")
    again = len(summary.warnings) - len(fresh)
    if again:
        complain(f"{counted(again, 'warning')} as above", "yellow")
    printed.update(map(str, fresh))


def _print_files(summary: RunSummary) -> None:
    paths: list[Path] = []
    for entry in summary.files.values():
        paths += entry if isinstance(entry, tuple) else [entry]
    say_written(paths)
