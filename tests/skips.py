"""Which tests may be skipped where: in CI (`ASRSIM_CI` is set) any other skip is a failure."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path

ALWAYS = (
    "its energy is integrated from its torques",
    "it has no deflection limit",
    "no Chromium here",
    "no small disk can be mounted here",
    "no wheels of",
    "node and npm are not installed",
    "npm cannot install the client",
    "rclpy is not installed here",
    "scipy was installed without its test files",
)
"""Cases that do not exist for an actuator, and what a machine may lack."""
WITHOUT_SHARED = ("not here", "needs ")
"""Recordings and robots that lie beside the project; where they are, they must be used."""
WITHOUT_BULLET = ("PyBullet", "pybullet")
SHARED = Path(__file__).parents[2] / "shared"


def allowed(*, shared: bool, wheels: bool) -> tuple[str, ...]:
    """Words of reasons that are good ones; wheels: whether PyBullet has any for this Python."""
    return (*ALWAYS, *(() if shared else WITHOUT_SHARED), *(() if wheels else WITHOUT_BULLET))


def unexpected(reasons: Iterable[str], *, shared: bool | None = None, wheels: bool | None = None) -> list[str]:
    """Reasons of skips that should not be; by default judged by this machine."""
    words = allowed(
        shared=SHARED.is_dir() if shared is None else shared,
        wheels=sys.version_info < (3, 12) and sys.platform == "linux" if wheels is None else wheels,
    )
    return sorted({reason for reason in reasons if not any(word in reason for word in words)})
