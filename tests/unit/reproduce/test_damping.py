"""The law of damping that grows with the stiffness, in every kind of joint: c = c_URDF + 2 ratio sqrt(I k)."""

from __future__ import annotations

import math

import pytest

from asrsim import run
from asrsim.metrics.ringing import fit_ringing
from paper.statics import rest
from support.paths import ROOT

SCENARIOS = ROOT / "examples" / "scenarios"
CASES = (("sea", "soft"), ("awas_ii", "soft"), ("bavs", "soft"), ("qbmove", "stiff"))
RATIO = 0.2


def ringing(name, variant, *overrides):
    result = run(SCENARIOS / f"step_1dof_{name}.yaml", variant=variant, overrides=overrides)
    return rest((name, variant)), fit_ringing(result.time, result["joint_1"].link_velocity, start=0.1)


@pytest.mark.parametrize(("name", "variant"), CASES)
def test_ideal_motors_swing_as_damped_as_the_law_says(name, variant):
    plain, _ = ringing(name, variant)
    law = f"link_damping.joint_1={{ratio: {RATIO}, inertia: {plain.inertia!r}}}"
    _, found = ringing(name, variant, law)
    damping = plain.damping + 2.0 * RATIO * math.sqrt(plain.inertia * plain.spring)
    assert found.decay == pytest.approx(damping / (2.0 * plain.inertia), rel=0.01)


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
