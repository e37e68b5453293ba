"""Units of claims, which depend on the kind, the actuator and the operation mode of the joint."""

import pytest

from asrsim.metrics.expect import claim_unit
from asrsim.samples import JointInfo
from asrsim.scenario.data import Expectation


@pytest.mark.parametrize(
    ("quantity", "actuator", "mode", "prismatic", "unit"),
    [
        ("reference_2", "qbmove", 4, False, "N m"),
        ("reference_1", "sea", 5, True, "m"),
        ("reference_1", "sea", 7, False, "V"),
        ("reference_2", "awas_ii", 6, False, "m"),
        ("motor_2_velocity", "awas_ii", 6, False, "m/s"),
        ("motor_1_torque", "sea", 5, True, "N"),
    ],
)
def test_a_claim_has_the_unit_of_its_quantity_at_this_joint(quantity, actuator, mode, prismatic, unit):
    claim = Expectation(joint="elbow", quantity=quantity, measure="mean", value=0.0)
    assert claim_unit(claim, JointInfo(name="elbow", actuator=actuator, mode=mode, prismatic=prismatic)) == unit
