"""Names from files that a terminal or a browser would take as commands."""

import io
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from asrsim.cli.console import SHOWN, problem_lines, styled
from asrsim.cli.progress import FractionBar, RunBar
from asrsim.errors import Problem
from asrsim.progress import Progress
from support.pages import Page
from support.paths import ROOT


@pytest.mark.parametrize("options", [[], ["--json"]])
def test_ascii_terminals_get_replaced_characters(tiny, options):
    """Tables and names may contain characters that ASCII lacks; JSON keeps all of them."""
    tiny.robot.write_text(tiny.robot.read_text().replace("elbow", "coudé"), encoding="utf-8")
    old = os.environ | {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "asrsim", "check", str(tiny.robot), *options]
    done = subprocess.run(command, env=old, capture_output=True, text=True, check=True, encoding="ascii")
    assert "coudé" in json.dumps(json.loads(done.stdout), ensure_ascii=False) if options else "coud?" in done.stdout


@pytest.mark.parametrize("name", ["</script><script>alert(1)</script>", "<!--<script>a&amp;<b>]]>-->"])
def test_names_cannot_break_the_scripts_of_a_report(tiny, name):
    from xml.sax.saxutils import quoteattr

    import asrsim
    from asrsim.report import write_report

    quoted = quoteattr(name)
    text = tiny.robot.read_text().replace('"elbow"', quoted).replace(">elbow<", f">{quoted[1:-1]}<")
    tiny.robot.write_text(text)
    tiny.scenario.write_text("robot: pendulum.urdf\nduration: 0.1\nreferences: {'*': {equilibrium_position: 0.1}}\n")
    result = asrsim.run(tiny.scenario, out=tiny.folder / "out")
    assert result.joints == (name,)
    page = Page(write_report(tiny.folder / "out", film=False))
    assert len(page.scripts) == 5
    assert json.loads(page.scripts[1])["groups"]
    assert "<!--" not in page.source
    assert page.source.count("<script") == 5


@pytest.mark.parametrize(
    ("environment", "is_styled"),
    [({"TERM": "xterm"}, True), ({"TERM": "dumb"}, False), ({"TERM": "xterm", "NO_COLOR": "1"}, False)],
)
def test_only_terminals_with_colours_get_styles(environment, is_styled, monkeypatch):
    monkeypatch.setattr(os, "environ", environment)
    assert (styled("text", "bold", SimpleNamespace(isatty=lambda: True)) != "text") is is_styled


@pytest.mark.parametrize("count", [1, SHOWN - 1, SHOWN, SHOWN + 1, SHOWN + 7])
def test_shared_messages_list_places_and_count_the_rest(count):
    problems = [Problem(message="odd", key=f"joint_{i}", code="odd") for i in range(count)]
    (line,) = problem_lines(problems)
    assert "None" not in line
    assert [f"joint_{i}" in line for i in range(count)] == [i < SHOWN for i in range(count)]
    assert re.findall(r"and (\d+) more", line) == ([str(count - SHOWN)] if count > SHOWN else [])


def test_a_key_that_is_missing_in_several_places_has_their_lines():
    problems = [Problem(message="the key 'seed' is missing", file=Path("a.yaml"), line=line, code="odd") for line in (3, 7)]
    assert problem_lines(problems) == ["a.yaml: line 3, line 7: the key 'seed' is missing"]


def test_progress_shows_the_speed_since_the_start_of_the_loop(monkeypatch):
    moments, shown = iter([0.0, 10.0, 14.0]), []
    monkeypatch.setattr("asrsim.cli.progress.clock.perf_counter", lambda: next(moments))
    bar = RunBar("arm", 8.0, show=False)
    monkeypatch.setattr(bar, "draw", lambda *drawn: shown.append(drawn[:2]))
    bar.start()
    bar.update(Progress(time=2.0))
    assert shown == [(0.25, "2.00 of 8 s, 0.5 x real time")]


def test_progress_of_further_runs_counts_from_their_first_report(monkeypatch):
    """These runs began before their first report, at an unknown time."""
    moments, shown = iter([0.0, 10.0, 14.0]), []
    monkeypatch.setattr("asrsim.cli.progress.clock.perf_counter", lambda: next(moments))
    bar = RunBar("arm", 8.0, show=False)
    monkeypatch.setattr(bar, "draw", lambda *drawn: shown.append(drawn[1]))
    bar.update(Progress(task="finer steps", time=0.5))
    bar.update(Progress(task="finer steps", time=2.5))
    assert shown == ["0.50 of 8 s", "2.50 of 8 s, 0.5 x real time"]


def test_a_pipe_gets_a_line_of_progress_every_ten_seconds(monkeypatch, capsys):
    now = [0.0]
    monkeypatch.setattr("asrsim.cli.progress.clock.perf_counter", lambda: now[0])
    with FractionBar(show=True) as bar, FractionBar(show=False) as quiet:
        for second in range(36):
            now[0] = float(second)
            bar.update(Progress(task="reading", fraction=second / 40))
            quiet.update(Progress(task="reading", fraction=second / 40))
    out, err = capsys.readouterr()
    assert out == ""
    assert err.splitlines() == [f"reading:  {share} %" for share in (25, 50, 75)]


class Screen(io.StringIO):
    """Text that is shown, on what says that it is a terminal."""

    def isatty(self):
        return True


@pytest.mark.parametrize(("task", "title"), [("reading", "reading"), (None, "log")])
def test_a_terminal_gets_a_bar_named_after_the_task_or_the_work(monkeypatch, task, title):
    """Short work, up to `PATIENCE`, gets no bar."""
    screen, now = Screen(), [0.0]
    monkeypatch.setattr("sys.stderr", screen)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.setattr("asrsim.cli.progress.clock.perf_counter", lambda: now[0])
    with FractionBar("log", show=True) as bar:
        bar.draw(0.25, "a quarter", task)
        assert screen.getvalue() == ""
        now[0] = 1.0
        bar.draw(0.5, "half", task)
    lines = re.findall(r"(\w+) \S.* half", re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", screen.getvalue()))
    assert set(lines) == {title}
