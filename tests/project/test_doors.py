"""An engine that users add is one file."""

import runpy

import numpy as np
import pytest

import asrsim
from support.paths import EXAMPLES
from validation.models import INSTALLED


@pytest.mark.parametrize("compiled", [False, True])
def test_the_example_engine_moves_as_the_other_engines_do(compiled):
    """One joint under gravity in all directions, also about its axis."""
    runpy.run_path(str(EXAMPLES / "plugins" / "pendulum_engine.py"))
    ends = []
    for engine in ("pendulum", *INSTALLED):
        scenario = asrsim.make_scenario(
            EXAMPLES / "urdf" / "dof1_sea.urdf", engine=engine, duration=0.4, modes={"*": 6}, gravity=[3.0, 5.0, -7.0],
            references={"*": {"equilibrium_position": 0.7}}, compiled=compiled,
        )  # fmt: skip
        ends.append(asrsim.run(scenario).run.samples.values["link_position"])
    assert np.ptp(ends[0]) > 0.1
    for other in ends[1:]:
        np.testing.assert_allclose(ends[0], other, rtol=0.0, atol=1e-12)
