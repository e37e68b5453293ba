"""Absurd values are refused with a message or accepted unchanged; they never cause an internal error."""

import pytest

import asrsim
from asrsim.errors import InputError
from support.paths import ROOT

SCENARIO = ROOT / "examples" / "scenarios" / "step_2dof.yaml"


def test_studies_with_too_many_draws_are_refused():
    with pytest.raises(InputError, match="must be 1 to"):
        asrsim.sweep(SCENARIO, {"link_1.mass": "uniform(0.3, 0.5)"}, variants=["soft"], samples=10**23)


@pytest.mark.parametrize("side", ["commands", "sensors"])
def test_rates_of_commands_and_sensors_have_an_upper_bound(side):
    with pytest.raises(InputError, match=r"rate.*1e\+06"):
        asrsim.load_scenario(SCENARIO, variant="soft", overrides={"imperfections": {side: {"joint_1": {"rate": 2.5e11}}}})
