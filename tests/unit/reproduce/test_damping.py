"""The law of damping that grows with the stiffness, in every kind of joint: c = c_URDF + 2 ratio sqrt(I k)."""

import math

import pytest

from asrsim import run
from support.paths import ROOT

SCENARIOS = ROOT / "examples" / "scenarios"


def test_an_adjuster_counts_with_dynamic_motors_too():
    """The stiffness of an AwAS-II comes from its adjuster, which is a reference and no motor."""
    scenario = SCENARIOS / "step_1dof_awas_ii.yaml"
    modes = ["modes.joint_1=6", "references.joint_1.equilibrium_position=0.3", "initial.joint_1=0"]
    law = "link_damping.joint_1={ratio: 0.5, inertia: 3.21e-4}"
    plain = run(scenario, variant="soft", overrides=modes)["joint_1"]
    damped = run(scenario, variant="soft", overrides=[*modes, law])["joint_1"]
    expected = 0.02 + 2 * 0.5 * math.sqrt(3.21e-4 * damped.stiffness[-1])
    fast = abs(damped.link_velocity) > 0.2
    assert -damped.damping_torque[fast][-1] / damped.link_velocity[fast][-1] == pytest.approx(expected, rel=0.05)
    # The loop uses what the log says: the swings are smaller.
    assert abs(damped.link_velocity).max() < 0.9 * abs(plain.link_velocity).max()
