"""`.ci/run` runs each check, and each check fails it. Interpreters and tools stand in; tests/slow/test_ci.py has real ones."""

import os
import shutil
import subprocess

import pytest

from support.paths import ROOT

CHECKS = (
    "main job, CPython 3.11", "main job, CPython 3.14", "tests, CPython 3.11", "tests, CPython 3.14", "lint", "format", "types",
    "tests beside ../shared", "slow tests, ASRSIM_SEED=5", "tests in a browser",
)  # fmt: skip
README = "<!-- ci: main -->\n```sh\npython3 main\n```\n<!-- ci: tests -->\n```sh\npython3 tests\n```\n"
CHECK = 'check() { case "$FAULTS" in *"|$1|"*) exit 1;; esac; }\n'
"""Shell function that fails if the check is among those that are to fail."""
PYTHON = f"""#!/bin/sh
{CHECK}case "$1" in
  -) echo "VERSION $0" ;;
  main) check "main job, CPython VERSION" ;;
  tests)
    mkdir -p .venv/bin
    for tool in ruff mypy pytest; do ln -s "$(dirname "$0")/tool" .venv/bin/$tool; done
    echo "1 passed"
    check "tests, CPython VERSION" ;;
esac
"""
TOOL = f"""#!/bin/sh
{CHECK}case "$(basename "$0") $*" in
  "ruff check .") check lint ;;
  "ruff format --check .") check format ;;
  mypy*) check types ;;
  "pytest -m shared and not slow") [ -d ../shared ] && check "tests beside ../shared" ;;
  "pytest -n auto -m slow") check "slow tests, ASRSIM_SEED=$ASRSIM_SEED" ;;
  "pytest -m browser and not slow") check "tests in a browser" ;;
  *) exit 1 ;;
esac
"""


@pytest.fixture
def failed(tmp_path):
    """Function that runs `.ci/run --slow` with checks that are to fail, and returns exit code and names of failed checks."""
    project, programs = tmp_path / "project", tmp_path / "programs"
    (project / ".ci").mkdir(parents=True)
    programs.mkdir()
    (tmp_path / "shared").mkdir()
    shutil.copy2(ROOT / ".ci" / "run", project / ".ci" / "run")
    (project / "README.md").write_text(README)
    found = {"python3": PYTHON.replace("VERSION", "3.11"), "python3.14": PYTHON.replace("VERSION", "3.14"), "tool": TOOL}
    for name in (*found, "python3.11", "python3.12", "python3.13"):
        (programs / name).write_text(found.get(name, "#!/bin/sh\nexit 1\n"))
        (programs / name).chmod(0o755)

    def run(*faults):
        path = f"{programs}{os.pathsep}{os.environ['PATH']}"
        given = {"PATH": path, "PYENV_ROOT": str(tmp_path / "none"), "FAULTS": f"|{'|'.join(faults)}|", "ASRSIM_SEED": "5"}
        command = [project / ".ci" / "run", "--slow"]
        done = subprocess.run(command, env={**os.environ, **given}, capture_output=True, text=True, check=False)
        lines = [line for line in done.stderr.splitlines() if line.startswith("ci: failed: ")]
        return done.returncode, {line.removeprefix("ci: failed: ") for line in lines}

    return run


def test_every_check_runs_and_counts(failed):
    assert failed() == (0, set())
    assert failed(*CHECKS) == (1, set(CHECKS))


@pytest.mark.slow
@pytest.mark.parametrize("check", CHECKS)
def test_a_check_fails_alone(failed, check):
    assert failed(check) == (1, {check})
