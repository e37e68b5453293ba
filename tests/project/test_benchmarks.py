"""The benchmarks run and print their results."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from support.paths import ROOT

SCRIPT = ROOT / "benchmarks" / "run.py"
NAMES = ("loop_v2", "record_1", "worlds_5", "bullet_v3", "reset", "joints_bullet", "check", "help")


def benchmark(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, str(SCRIPT), *arguments], capture_output=True, text=True, check=False)


def test_json_has_medians_goals_and_machine() -> None:
    result = benchmark("--json", "--only", "reset", "--repeats", "1")
    assert result.returncode == 0, result.stderr
    document = json.loads(result.stdout)
    assert set(document) == {"machine", "rows"}
    assert document["machine"]["CPU"]
    assert list(document["rows"]) == ["reset"]
    row = document["rows"]["reset"]
    assert 0.0 < min(row["values"]) <= row["median"] <= max(row["values"])
    assert row["goal"] == 0.1


def test_a_row_that_does_not_exist_is_refused_with_those_that_do() -> None:
    result = benchmark("--only", "nothing")
    assert result.returncode == 2
    assert all(name in result.stderr for name in NAMES)


def test_table_marks_what_misses_its_goal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(SCRIPT.parent))
    import run  # type: ignore[import-not-found]

    assert set(run.ROWS) >= set(NAMES)
    rows = {
        "help": run.Row(what="a / b", goal=2.0, values=(1.0, 1.5, 9.0)),
        "start": run.Row(what="c / d", goal=2.0, values=(2.5,)),
    }
    first, second = run.table(rows).splitlines()[1:]
    assert "1.50" in first
    assert "!" not in first
    assert "2.50" in second
    assert "!" in second
