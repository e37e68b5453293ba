"""The versions that are measured beside each other: this one, and 0.1 in an environment of its own that is made here."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
OLD = "38e9a5f"
"""Commit of 0.1."""


class Version:
    """A worker process that measures one version."""

    def __init__(self, python: Path | str, source: Path) -> None:
        environment = {**os.environ, "PYTHONPATH": str(source)}
        environment.pop("PYTHONDONTWRITEBYTECODE", None)
        self._process = subprocess.Popen(
            [str(python), str(Path(__file__).with_name("worker.py"))],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment,
        )  # fmt: skip

    def ask(self, what: str, **request: Any) -> float:
        """A measure of :mod:`worker`."""
        process = self._process
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write(json.dumps({"what": what, **request}) + "\n")
        process.stdin.flush()
        line = process.stdout.readline()
        if not line:
            raise RuntimeError(f"the worker ended at {what} {request}")
        return float(json.loads(line))

    def close(self) -> None:
        """End it."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()


def new() -> Version:
    """The version beside this file."""
    return Version(sys.executable, ROOT)


def old() -> Version | None:
    """0.1, in an environment made once in the cache; None, said on stderr, where it cannot be had."""
    folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "asrsim" / "benchmark" / OLD
    source, python, done = folder / "source", folder / "bin" / "python", folder / "done"
    if not done.exists():
        try:
            if sys.version_info[:2] != (3, 11):
                raise OSError("asrsim 0.1 needs CPython 3.11")
            source.mkdir(parents=True, exist_ok=True)
            archive = subprocess.run(["git", "archive", OLD], cwd=ROOT, capture_output=True, check=True).stdout
            subprocess.run(["tar", "xf", "-", "-C", str(source)], input=archive, check=True)
            subprocess.run([sys.executable, "-m", "venv", str(folder)], check=True)
            install = ["-m", "pip", "install", "-q", "-c", f"{source}/requirements.lock", "-e", f"{source}[fast]"]
            subprocess.run([str(python), *install], check=True)
            done.touch()
        except (OSError, subprocess.CalledProcessError) as error:
            sys.stderr.write(f"asrsim 0.1 (commit {OLD}) cannot be measured, its rows are left out: {error}\n")
            return None
    return Version(python, source)
