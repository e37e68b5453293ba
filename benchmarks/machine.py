"""What was measured on."""

from __future__ import annotations

import os
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path


def machine() -> dict[str, str]:
    """Processor, its cores, Python and libraries."""
    return {
        "CPU": _processor(),
        "cores": str(os.cpu_count()),
        "Python": platform.python_version(),
        "PyBullet": _version("pybullet"),
        "MuJoCo": _version("mujoco-core"),
        "NumPy": _version("numpy"),
        "Numba": _version("numba"),
    }


def others() -> float:
    """How many other programs want to run, by the load of the last minute."""
    return os.getloadavg()[0] if hasattr(os, "getloadavg") else 0.0


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "-"
