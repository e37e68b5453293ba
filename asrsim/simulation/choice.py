"""Whether the compiled loop can be had, and pays: asked by every run, so nothing heavy is imported for the answer."""

from __future__ import annotations

import sys

SECONDS_SAVED = 6e-6
"""What the compiled loop saves for a joint and motor substep, s: measured 4 to 30, 2 for each further substep of the motors;
what matters is the order of magnitude."""
SECONDS_TO_LOAD = 0.6
"""Import of Numba and a kept kernel, s; a kernel that is not kept yet costs 2 s more once."""
SECONDS_WHEN_LOADED = 0.05
"""The same where Numba is imported already."""


def pays(joints: int, substeps: int) -> bool:
    """The run is long enough for the compiled loop to win back its start; `substeps`: of the motors, in the whole run."""
    start = SECONDS_WHEN_LOADED if "numba" in sys.modules else SECONDS_TO_LOAD
    return joints * substeps * SECONDS_SAVED > start
