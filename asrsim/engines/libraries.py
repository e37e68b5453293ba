"""Versions of the libraries on which the numbers of a simulation depend."""

from __future__ import annotations

import sys

from asrsim.engines.mujoco_library import library_version
from asrsim.versions import version


def numeric_versions() -> dict[str, str]:
    """Versions of Python, asrsim and the numerical libraries: with other versions, numbers may differ."""
    found = {"python": ".".join(map(str, sys.version_info[:2])), "asrsim": version("asrsim"), "mujoco": library_version()}
    return found | {name: version(name) for name in ("numpy", "pybullet", "numba", "scipy")}
