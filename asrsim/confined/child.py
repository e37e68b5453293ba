"""Script of `asrsim.confined.run`: limits its own process, then runs another script. Arguments: seconds, bytes, script."""

from __future__ import annotations

import runpy
import sys


def limit(seconds: float, memory: int) -> None:
    """Limit processor time, memory and file size, if the system supports it."""
    try:
        import resource
    except ImportError:
        return
    for kind, bound in (
        (resource.RLIMIT_CPU, int(seconds) + 1),
        (resource.RLIMIT_AS, memory),
        (resource.RLIMIT_FSIZE, 0),
        (resource.RLIMIT_CORE, 0),
    ):
        hard = resource.getrlimit(kind)[1]
        resource.setrlimit(kind, (bound if hard == resource.RLIM_INFINITY else min(bound, hard), hard))


if __name__ == "__main__":
    limit(float(sys.argv[1]), int(sys.argv[2]))
    runpy.run_path(sys.argv[3], run_name="__main__")
