"""Versions of the libraries that determine the numbers of a simulation."""

from __future__ import annotations

import sys

from asrsim.engines.mujoco_library import library_version
from asrsim.versions import version


def numeric_versions() -> dict[str, str]:
    """Versions of Python, asrsim and the numerical libraries. With other versions, a repeated run may give other numbers."""
    found = {"python": ".".join(map(str, sys.version_info[:2])), "asrsim": version("asrsim"), "mujoco": library_version()}
    return found | {name: version(name) for name in ("numpy", "pybullet", "numba", "scipy")}
