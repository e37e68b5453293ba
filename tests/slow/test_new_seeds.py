"""Random robots with new seeds in each slow run. `ASRSIM_SEED=N` repeats a run."""

from __future__ import annotations

import os
import secrets
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from support.convergence import speed_and_errors
from support.random_runs import random_run
from validation.models import INSTALLED

pytestmark = pytest.mark.slow
ROBOTS = 8


@pytest.mark.parametrize("engine", INSTALLED)
@pytest.mark.parametrize(
    "keys", [{}, {"moving": 6, "passive": 1.0, "jumps": False}, {"moving": 3, "extras": True}],
    ids=["actuators", "passive trees", "electric motors and hysteresis"],
)  # fmt: skip
def test_new_robots_converge_at_second_order(engine: str, keys: dict[str, Any], tmp_path: Path) -> None:
    """A quarter of the step gives a sixteenth of the error. The test uses the median, since a torque that reaches its limit
    within a step adds an error that depends on the phase of the step."""
    first = int(os.environ.get("ASRSIM_SEED") or secrets.randbelow(1_000_000))
    print(f"repeat with ASRSIM_SEED={first}")
    left = []
    for seed in range(first, first + ROBOTS):
        speed, errors = speed_and_errors(random_run(seed, fixed=seed % 2 == 0, **keys), tmp_path, engine, compiled=True)
        largest = errors.max(axis=1)
        assert largest[0] < 2e-4 * speed, (seed, errors)
        left.append(largest[2] / max(largest[0], largest[1]))
        assert left[-1] < 0.3, (seed, errors)
    assert np.median(left) < 0.08, left
