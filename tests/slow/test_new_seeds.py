"""Random robots with new seeds in each slow run. `ASRSIM_SEED=N` repeats a run."""

import os
import secrets

import pytest

from validation.check import on
from validation.models import INSTALLED
from validation.order import KINDS, ROBOTS, random_robots

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("engine", INSTALLED)
@pytest.mark.parametrize("kind", KINDS)
def test_new_robots_converge_at_second_order(engine, kind):
    first = int(os.environ.get("ASRSIM_SEED") or secrets.randbelow(1_000_000))
    print(f"repeat with ASRSIM_SEED={first}")
    with on(engine):
        assert not [str(check) for check in random_robots(kind, range(first, first + ROBOTS)) if not check.passed]
