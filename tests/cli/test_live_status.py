"""What `asrsim live` says while it runs and at its end."""

import io
import re
from pathlib import Path
from types import SimpleNamespace

import pytest

from asrsim.cli.live_status import INTERVAL, StatusLine, print_live

FIGURES = {
    "commands": 7, "clamped": {"elbow.equilibrium_position": 2}, "dropped": {"/elbow/x: not a number": 3}, "applied": 5,
    "ticks": 100, "late_p50": 1e-4, "late_p99": 2.5e-3, "late_worst": 0.0123, "busy": 0.5, "slips": 4, "slipped": 0.75,
}  # fmt: skip


class Screen(io.StringIO):
    """Text that is shown, on what says whether it is a terminal."""

    def __init__(self, terminal):
        super().__init__()
        self.isatty = lambda: terminal


@pytest.mark.parametrize(("terminal", "show"), [(True, True), (True, False), (False, True)])
def test_a_terminal_has_one_status_line_with_the_speed_since_the_last_one(terminal, show, monkeypatch):
    """Messages stand above it, and it is wiped out at the end. A pipe gets the messages only, and --quiet nothing."""
    screen, now = Screen(terminal), [10.0]
    monkeypatch.setattr("sys.stderr", screen)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr("asrsim.cli.live_status.clock.perf_counter", lambda: now[0])
    session = SimpleNamespace(simulation=SimpleNamespace(time=0.0), figures=lambda: FIGURES)
    with StatusLine(show=show) as line:
        for passed, simulated in ((0.5 * INTERVAL, 0.1), (2.0 * INTERVAL, 0.8), (4.0 * INTERVAL, 1.8)):
            now[0], session.simulation.time = 10.0 + passed, simulated
            line.show(session)
        line.tell("a client has come")
    parts = [re.sub(r"\x1b\[K", "", part).strip() for part in screen.getvalue().split("\r")]
    said = [part for part in parts if part]
    late = "late 2.50 ms (p99)  7 commands, 2 clamped, 3 dropped"
    lines = [f"0.80 s  {0.8 / 0.5:.2f} x real time  {late}", f"1.80 s  {1.0 / 0.5:.2f} x real time  {late}"]
    assert said == [*lines * (terminal and show), *["a client has come"] * show]
    if terminal and show:
        assert screen.getvalue().endswith("\r\x1b[K")


@pytest.mark.parametrize("quiet", [False, True])
def test_the_end_of_a_live_run_states_lateness_commands_and_how_to_repeat_it(quiet, monkeypatch, capsys):
    monkeypatch.setattr("asrsim.cli.live_status.print_run", lambda summary, quiet: None)
    summary = SimpleNamespace(wall_time=2.0, files={"log": Path("out/log.mcap")})
    print_live(SimpleNamespace(figures=lambda: FIGURES), summary, [Path("mine.py")], quiet=quiet)
    said = " ".join(capsys.readouterr().out.split())
    for words in (
        "ticks late by 0.10 ms (median), 2.50 ms (p99), 12.3 ms (worst); busy 25 % of the time",
        "fell behind real time 4 times, 0.75 s in total: this machine was too slow",
        "7 commands, 2 clamped, 3 dropped; 5 changed a reference",
        "3 x /elbow/x: not a number", "2 x elbow.equilibrium_position: clamped",
        "repeat it: asrsim rerun out/log.mcap --plugin mine.py",
    ):  # fmt: skip
        assert (words in said) == (not quiet), words
