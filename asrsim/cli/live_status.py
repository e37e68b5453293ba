"""Status line and final summary of `asrsim live`."""

from __future__ import annotations

import sys
import time as clock
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from asrsim.cli.console import complain, is_terminal, say
from asrsim.cli.report import print_run

if TYPE_CHECKING:
    from asrsim.live.session import Session
    from asrsim.summary import RunSummary


INTERVAL = 0.25
"""Time between two updates of the status line, s."""


class StatusLine:
    """Status line on stderr, rewritten in place on a terminal; messages are printed above the status line."""

    def __init__(self, *, show: bool) -> None:
        self._talks = show
        self._shows = show and is_terminal(sys.stderr)
        self._before = (clock.perf_counter(), 0.0)
        """Wall-clock time and simulated time at the last update, s."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._wipe()

    def tell(self, text: str) -> None:
        """Print a message above the status line."""
        self._wipe()
        if self._talks:
            complain(text)

    def show(self, session: Session) -> None:
        """Rewrite the status line with the current numbers of the session, at most once per `INTERVAL`."""
        now, simulated = clock.perf_counter(), session.simulation.time
        if not self._shows or now - self._before[0] < INTERVAL:
            return
        figures = session.figures()
        speed = (simulated - self._before[1]) / (now - self._before[0])
        self._before = (now, simulated)
        late = f"late {1e3 * figures['late_p99']:.2f} ms (p99)"
        text = f"{simulated:9.2f} s  {speed:.2f} x real time  {late}  {commands(figures)}"
        sys.stderr.write(f"\r\x1b[K{text}")
        sys.stderr.flush()

    def _wipe(self) -> None:
        if self._shows:
            sys.stderr.write("\r\x1b[K")
            sys.stderr.flush()


def commands(figures: Mapping[str, Any]) -> str:
    """Text with the numbers of commands that were received, clamped and dropped."""
    parts = [f"{figures['commands']} commands"]
    for name in ("clamped", "dropped"):
        count = sum(figures[name].values())
        parts += [f"{count} {name}"] if count else []
    return ", ".join(parts)


def print_live(session: Session, summary: RunSummary, plugins: Sequence[Path], *, quiet: bool) -> None:
    """Print the summary of a live run, its delay behind real time, and its numbers of commands."""
    print_run(summary, quiet=quiet)
    if quiet:
        return
    from asrsim.plugins import command_line

    figures = session.figures()
    wall = max(summary.wall_time, 1e-9)
    if figures["ticks"]:
        say(
            f"ticks late by {1e3 * figures['late_p50']:.2f} ms (median), {1e3 * figures['late_p99']:.2f} ms (p99), "
            f"{1e3 * figures['late_worst']:.1f} ms (worst); busy {100 * figures['busy'] / wall:.0f} % of the time"
        )
    if figures["slips"]:
        say(
            f"fell behind real time {figures['slips']} times, {figures['slipped']:.2f} s in total: this machine was too slow",
            "yellow",
        )
    say(commands(figures) + f"; {figures['applied']} changed a reference")
    for reason, count in (*figures["dropped"].items(), *((f"{key}: clamped", n) for key, n in figures["clamped"].items())):
        say(f"  {count} x {reason}", "dim")
    say(f"repeat it: {command_line('rerun', str(summary.files['log']), plugins)}")
