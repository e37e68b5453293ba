"""Run as a script by :mod:`asrsim.confined`: reads a MATLAB file with SciPy, whose reader damaged files crash.

Reads {"path", "most"} (JSON) on stdin. Writes a line of JSON on stdout, {"content": tree} or {"error", "kind"}, and behind it
the bytes of all arrays. It imports nothing of asrsim.
"""

from __future__ import annotations

import json
import sys
from typing import Any

import numpy as np

OBJECTS = ("MatlabOpaque", "MatlabFunction", "MatlabObject")


def tree_of(value: Any, parts: list[bytes]) -> Any:
    """A value as [kind, ...]; numbers of arrays go to `parts`."""
    if type(value).__name__ in OBJECTS:
        return ["object"]
    if isinstance(value, dict):
        return ["struct", [[str(name), tree_of(item, parts)] for name, item in value.items()]]
    if isinstance(value, str):
        return ["text", value]
    if isinstance(value, list | tuple):
        return ["cells", [len(value)], [tree_of(item, parts) for item in value]]
    if isinstance(value, bool | int | float | complex | np.generic | np.ndarray):
        array = np.asarray(value)
        if array.dtype.kind in "fiubc":
            parts.append(array.tobytes())
            return ["numbers", array.dtype.str, list(array.shape)]
        if array.ndim and array.dtype.kind in "OU":
            return ["cells", list(array.shape), [tree_of(item, parts) for item in array.ravel().tolist()]]
    return ["unknown"]


def main() -> None:
    """Answer one request."""
    from scipy.io import loadmat

    request = json.loads(sys.stdin.buffer.read())
    parts: list[bytes] = []
    answer: dict[str, Any]
    try:
        content = loadmat(request["path"], simplify_cells=True)
        answer = {"content": tree_of({name: item for name, item in content.items() if not name.startswith("__")}, parts)}
        if sum(map(len, parts)) > request["most"]:
            answer = {"error": f"its arrays take more than {request['most'] / 2**20:.0f} MiB", "kind": "Large"}
    except Exception as error:  # on damaged files scipy lets errors of many kinds through
        answer = {"error": " ".join(str(error).split())[:300], "kind": type(error).__name__}
    sys.stdout.buffer.write(json.dumps(answer).encode() + b"\n")
    if "content" in answer:
        sys.stdout.buffer.writelines(parts)


if __name__ == "__main__":
    main()
