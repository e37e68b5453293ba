"""Expands a xacro file in a separate process that can only compute and read allowed files.

xacro evaluates Python expressions. The child process (`xacro_child.py`) evaluates a checked subset of them, reads only files in
the allowed folders, sees no environment variables, and has limits on time and memory.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

from asrsim.confined.run import ConfinedError, run_confined
from asrsim.errors import Problem, RobotError
from asrsim.robot.packages import Packages
from asrsim.robot.xmlfile import MAX_BYTES

TIME_LIMIT = 30.0
"""Time limit for one file, s of wall clock."""


def expand_xacro(
    path: Path, arguments: Mapping[str, str], packages: Packages, *, time_limit: float = TIME_LIMIT
) -> tuple[bytes, tuple[Problem, ...]]:
    """Expanded URDF text, and xacro's warnings. Raises RobotError if xacro fails or a limit is reached."""
    request = {
        "path": str(path.resolve()),
        "arguments": {str(key): str(value) for key, value in arguments.items()},
        "packages": {name: str(folder.resolve()) for name, folder in packages.named.items()},
        "searched": [str(folder) for folder in packages.searched],
        "roots": [str(root) for root in packages.roots],
        "max_bytes": MAX_BYTES,
    }
    try:
        answer = json.loads(run_confined(Path(__file__).with_name("xacro_child.py"), request, seconds=time_limit))
    except ConfinedError as error:
        raise RobotError(f"xacro {error}", file=path, code=f"xacro-{error.code}") from None
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
