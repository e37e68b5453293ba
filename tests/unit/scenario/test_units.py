"""Numbers with a unit in a scenario: the message says how to write them."""

import pytest

import asrsim
from asrsim.errors import ScenarioError
from support.paths import EXAMPLES

ARM = EXAMPLES / "urdf" / "dof1_sea.urdf"


@pytest.mark.parametrize(
    ("keys", "hinted"),
    [
        ({"duration": "1 s"}, True),
        ({"step": "1ms"}, True),
        ({"references": {"joint_1": {"equilibrium_position": "45 deg"}}}, True),
        ({"references": {"joint_1": {"equilibrium_position": "-4.5e1°"}}}, True),
        ({"duration": "long"}, False),
        ({"duration": "1.5.3"}, False),
    ],
)
def test_a_number_with_a_unit_gets_advice(keys, hinted):
    with pytest.raises(ScenarioError) as caught:
        asrsim.make_scenario(ARM, **{"duration": 1.0, **keys})
    (problem,) = caught.value.problems
    assert ("in SI units" in (problem.hint or "")) == hinted


def test_a_constant_reference_beyond_the_limits_is_one_number():
    keys = {"references": {"joint_1": {"equilibrium_position": 45}}}
    scenario = asrsim.make_scenario(EXAMPLES / "urdf" / "dof2_horizontal.urdf", duration=0.1, **keys)
    (warning,) = [one for one in asrsim.prepare(scenario).warnings if one.code == "reference-limits"]
    assert warning.value == "45"
