"""`.ci/run` can fail: a fault that is planted for one of its checks fails this check, and no fault fails none."""

import shutil
import subprocess
import sys

import pytest

from support.paths import ROOT

FAULTS = {
    "main job": ("README.md", "true # main", "false # main"),
    "tests": ("tests/cli/test_planted.py", None, "def test_planted():\n    raise ValueError\n"),
    "lint": ("asrsim/planted_lint.py", None, "import math\n"),
    "format": ("asrsim/planted_format.py", None, "ONE = (1,  2)\n"),
    "types": ("asrsim/planted_types.py", None, 'ONE: int = "one"\n'),
}
"""A fault for each check: file, text that the fault replaces (None: a file of its own), and the fault."""


@pytest.mark.slow
@pytest.mark.parametrize("planted", [(), tuple(FAULTS)], ids=["no fault", "a fault for each check"])
def test_each_check_fails_by_its_own_fault_and_only_by_faults(tmp_path, planted):
    """The two commands of README stand for themselves here, since a fresh environment would take minutes."""
    files = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True).stdout.decode()
    for name in filter(None, files.split("\0")):
        if (ROOT / name).is_file():
            (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, tmp_path / name)
    readme = tmp_path / "README.md"
    tests = f'ln -s "{sys.prefix}" .venv\nPYTHONPATH=. .venv/bin/python -m pytest -q tests/cli/test_[op]*.py'
    text = readme.read_text(encoding="utf-8")
    for mark, command in (("main", "true # main"), ("tests", tests)):
        before, after = text.split(f"<!-- ci: {mark} -->\n```sh\n")
        text = f"{before}<!-- ci: {mark} -->\n```sh\n{command}\n```{after.split('```', 1)[1]}"
    readme.write_text(text, encoding="utf-8")
    for check in planted:
        name, old, new = FAULTS[check]
        target = tmp_path / name
        before = target.read_text(encoding="utf-8") if old else ""
        target.write_text(before.replace(old, new, 1) if old else new, encoding="utf-8")
    done = subprocess.run([tmp_path / ".ci" / "run"], cwd=tmp_path, capture_output=True, text=True, check=False)
    failed = {line.removeprefix("ci: failed: ").split(",")[0] for line in done.stderr.splitlines() if "ci: failed" in line}
    assert failed == set(planted), done.stdout[-4000:] + done.stderr
    assert (done.returncode == 0) == (not planted)
