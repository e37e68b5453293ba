"""Expands a xacro file in a process of its own that may compute and read allowed files, and nothing else.

xacro evaluates Python expressions. The child (`xacro_child.py`) evaluates a checked subset of them, reads only inside
the allowed folders, sees no environment variables, and is bounded in time and memory.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

from asrsim.errors import Problem, RobotError
from asrsim.robot.packages import Packages
from asrsim.robot.xmlfile import MAX_BYTES

TIME_LIMIT = 30.0
"""s of wall clock for one file."""
_KEPT_VARIABLES = ("PATH", "PYTHONPATH", "PYTHONHOME", "LANG", "LC_ALL", "SYSTEMROOT", "LD_LIBRARY_PATH", "VIRTUAL_ENV")


def expand_xacro(
    path: Path, arguments: Mapping[str, str], packages: Packages, *, time_limit: float = TIME_LIMIT
) -> tuple[bytes, tuple[Problem, ...]]:
    """The expanded URDF and xacro's own warnings. Raises RobotError where xacro fails or a limit is reached."""
    request = {
        "path": str(path.resolve()),
        "arguments": {str(key): str(value) for key, value in arguments.items()},
        "packages": {name: str(folder.resolve()) for name, folder in packages.named.items()},
        "searched": [str(folder) for folder in packages.searched],
        "roots": [str(root) for root in packages.roots],
        "max_bytes": MAX_BYTES,
        "cpu_seconds": max(1, int(time_limit)),
    }
    child = Path(__file__).with_name("xacro_child.py")
    try:
        # -P: modules are never taken from the child's own folder.
        done = subprocess.run(
            [sys.executable, "-P", str(child)],
            input=json.dumps(request).encode(),
            capture_output=True,
            timeout=time_limit,
            check=False,
            env={name: os.environ[name] for name in _KEPT_VARIABLES if name in os.environ},
        )
    except subprocess.TimeoutExpired:
        raise RobotError(f"xacro did not finish within {time_limit:g} s", file=path, code="xacro-timeout") from None
    try:
        answer = json.loads(done.stdout)
    except ValueError:
        raise RobotError("xacro ended without a result (too much memory or time)", file=path, code="xacro-failed") from None
    if "error" in answer:
        place = Path(answer["file"]) if answer.get("file") else path
        raise RobotError(
            f"xacro: {answer['error']}",
            file=place,
            line=answer.get("line"),
            code=answer.get("code", "xacro-failed"),
            hint=answer.get("hint"),
        )
    warnings = tuple(Problem(f"xacro: {text}", file=path, code="xacro-warning") for text in answer["warnings"])
    return answer["text"].encode(), warnings
