"""Runs a script on an untrusted file in a separate process with limited time and memory and no environment variables.

A damaged file that crashes a C library, or a file that exhausts the memory, ends this separate process, and not the user's
process.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

MEMORY = 2 * 2**30
"""Largest address space of the process, bytes."""
_KEPT_VARIABLES = ("PATH", "PYTHONPATH", "PYTHONHOME", "LANG", "LC_ALL", "SYSTEMROOT", "LD_LIBRARY_PATH", "VIRTUAL_ENV")


class ConfinedError(Exception):
    """The script gave no result. The message states the reason; `code` is its short form: `timeout` or `failed`."""

    def __init__(self, message: str, code: str) -> None:
        super().__init__(message)
        self.code = code


def run_confined(script: Path, request: Mapping[str, Any], *, seconds: float, memory: int = MEMORY) -> bytes:
    """Output (stdout) of the script for a request, which the script reads as JSON from stdin. Scripts should not import asrsim.

    Raises ConfinedError if a limit is exceeded or the script ends with an error.
    """
    environment = {name: os.environ[name] for name in _KEPT_VARIABLES if name in os.environ}
    # Use the option -P, so that the script does not import modules from its own folder.
    command = [sys.executable, "-P", str(Path(__file__).with_name("child.py")), str(seconds), str(memory), str(script)]
    try:
        done = subprocess.run(
            command, input=json.dumps(request).encode(), capture_output=True, timeout=seconds, check=False,
            env={**environment, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        raise ConfinedError(f"did not finish within {seconds:g} s", "timeout") from None
    if done.returncode or not done.stdout:
        message = f"ended without a result: it crashed, or needed more than {memory / 2**30:g} GiB of memory"
        raise ConfinedError(message, "failed")
    return done.stdout
