"""Ranges of references that the scenario does not declare: they follow from the limits of joints, springs and motors."""

import pytest

from asrsim.scenario.data import Scenario
from asrsim.simulation.drives import ranges_of
from asrsim.simulation.prepare import prepare
from validation.models import Body, chain

LIMITS = '<limit lower="-0.5" upper="0.8" effort="7" velocity="9"/>'
JOINT = (-0.5, 0.8)
NARROW = {"max_deflection": 0.3, "motor_1_min_position": -0.6}
TORQUES = {"motor_1_max_torque": 2.0, "motor_2_max_torque": 3.0}


@pytest.mark.parametrize(
    ("actuator", "mode", "parameters", "expected"),
    [
        ("sea", 0, {}, {"link_torque": (-7.0, 7.0)}),
        ("sea", 3, NARROW, {"equilibrium_position": JOINT}),
        ("qbmove", 3, NARROW, {"equilibrium_position": JOINT, "stiffness_preset": (-0.3, 0.3)}),
        ("qbmove", 4, TORQUES, {"motor_1_torque": (-2.0, 2.0), "motor_2_torque": (-3.0, 3.0)}),
        ("qbmove", 5, NARROW, {"reference_1": (-0.6, 1.1), "reference_2": (-0.8, 1.1)}),
        ("awas_ii", 3, {"lever_length": 0.06}, {"equilibrium_position": JOINT, "stiffness_preset": (0.0, 0.03)}),
    ],
)
def test_ranges_follow_from_the_limits_of_the_robot(actuator, mode, parameters, expected):
    robot = chain(Body(actuator=actuator, limits=LIMITS))
    scenario = Scenario(name="s", robot=robot.path, engine="mujoco", modes={"*": mode}, parameters={"*": parameters})
    prepared = prepare(scenario, robot)
    found = ranges_of(prepared.scenario, prepared.drives)["joint_1"]
    assert found == {name: pytest.approx(ends) for name, ends in expected.items()}
