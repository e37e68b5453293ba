"""Small wrong changes of the code, each tried in a copy of the tree: do the fast tests notice? A tool, not a test.

    PYTHONPATH=$PWD python tests/mutants.py                      # each against the test files that are likeliest to notice
    PYTHONPATH=$PWD python tests/mutants.py --whole energy join  # those of some files; survivors against all fast tests

A change of the list that no longer fits its file is told and counts as an error. Exit code: 1 where a change survives.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from mutant_list import MUTANTS, Mutant

ROOT = Path(__file__).parents[1]
LONGEST = 900.0
"""s: tests that take longer have noticed."""


def copied(folder: Path) -> Path:
    """A copy of what git knows of the tree."""
    names = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, check=True, capture_output=True, text=True).stdout
    for name in names.split("\0"):
        if name and (ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, folder / name)
    # Tests read examples of other robots beside the tree, where there are any.
    if (ROOT.parent / "shared").exists():
        (folder.parent / "shared").symlink_to(ROOT.parent / "shared")
    return folder


def noticed(tree: Path, tests: tuple[str, ...]) -> str:
    """What noticed a change in the tree: the first test that fails; empty where none does. tests: of which files; none: all."""
    files = [f"tests/test_{name}.py" for name in tests] or ["tests"]
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", "--tb=no", *files]
    try:
        done = subprocess.run(
            command, cwd=tree, capture_output=True, text=True, timeout=LONGEST, env={**os.environ, "PYTHONPATH": str(tree)}
        )
    except subprocess.TimeoutExpired:
        return "too slow"
    failed = [line.split(" - ")[0] for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
    # 5: of these files every test is a slow one.
    return "" if done.returncode in (0, 5) else (failed or ["pytest failed"])[0]


def try_mutant(tree: Path, mutant: Mutant, sound: dict[str, str], *, whole: bool) -> str:
    """What noticed it, the test; `survived`; `does not fit`; or what fails without it. sound: files of tests -> that."""
    path = tree / "asrsim" / mutant.file
    text = path.read_text(encoding="utf-8")
    if text.count(mutant.old) != 1:
        return "does not fit"
    for name in mutant.tests:
        if name not in sound:
            sound[name] = noticed(tree, (name,))
        if sound[name]:
            return f"fails unchanged: {sound[name]}"
    path.write_text(text.replace(mutant.old, mutant.new), encoding="utf-8")
    try:
        found = noticed(tree, mutant.tests)
        if not found and whole:
            found = noticed(tree, ())
    finally:
        path.write_text(text, encoding="utf-8")
    return found or "survived"


def main() -> int:
    """All of the list, or those whose file, or number, is named."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", help="parts of file names, or numbers of the list")
    parser.add_argument("--whole", action="store_true", help="survivors against all fast tests")
    asked = parser.parse_args()
    lived, sound = 0, dict[str, str]()
    with tempfile.TemporaryDirectory() as folder:
        tree = copied(Path(folder) / "tree")
        for number, mutant in enumerate(MUTANTS, start=1):
            if asked.names and not any(name == str(number) or name in mutant.file for name in asked.names):
                continue
            began = time.perf_counter()
            found = try_mutant(tree, mutant, sound, whole=asked.whole)
            lived += found.startswith(("survived", "does not fit", "fails unchanged"))
            print(f"{number:3} {mutant.file:32} {time.perf_counter() - began:5.0f} s  {found:60} {mutant.new}", flush=True)
    print(f"{lived} survived")
    return int(lived > 0)


if __name__ == "__main__":
    sys.exit(main())
