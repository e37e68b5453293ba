"""The benchmarks run and print their results."""

import json
import subprocess
import sys

from support.paths import ROOT

SCRIPT = ROOT / "benchmarks" / "run.py"


def benchmark(*arguments):
    return subprocess.run([sys.executable, str(SCRIPT), *arguments], capture_output=True, text=True, check=False)


def test_json_has_medians_goals_and_machine():
    result = benchmark("--json", "--only", "reset", "--repeats", "1")
    assert result.returncode == 0, result.stderr
    document = json.loads(result.stdout)
    assert set(document) == {"machine", "rows"}
    assert document["machine"]["CPU"]
    assert list(document["rows"]) == ["reset"]
    row = document["rows"]["reset"]
    assert 0.0 < min(row["values"]) <= row["median"] <= max(row["values"])
    assert row["goal"] == 0.1


def test_an_unknown_row_is_refused_with_the_known_names():
    result = benchmark("--only", "nothing")
    assert result.returncode == 2
    assert all(name in result.stderr for name in ("loop_v2", "reset", "check"))
