"""Derived quantities against the laws they come from."""

import numpy as np
import pytest

from asrsim.actuators import ACTUATORS, Actuator
from asrsim.log.derived import DERIVED_FUNCTIONS
from asrsim.samples import JointInfo, Samples

deflection, equilibrium_position, position_error = DERIVED_FUNCTIONS.values()
RNG = np.random.default_rng(0)
N = 20


def make(joint, **values):
    table = {name: column[:, None] for name, column in values.items()}
    return Samples(time=np.arange(N) * 0.1, joints=(joint.name,), values=table), [joint]


Q, THETA_1, THETA_2, R_1, R_2 = RNG.normal(size=(5, N))


@pytest.mark.parametrize("actuator", ["sea", "qbmove", "bavs", "awas_ii"])
def test_equilibrium_and_deflection_of_the_motors(actuator):
    joint = JointInfo(name="j", actuator=actuator, mode=6)
    law = ACTUATORS.get(actuator).equilibrium_position
    samples, joints = make(joint, link_position=Q, motor_1_position=THETA_1, motor_2_position=THETA_2)
    expected = np.array([law(a, b) for a, b in zip(THETA_1.tolist(), THETA_2.tolist(), strict=True)])
    np.testing.assert_allclose(equilibrium_position(samples, joints)[:, 0], expected, rtol=1e-15)
    np.testing.assert_allclose(deflection(samples, joints)[:, 0], expected - Q, rtol=1e-12)


@pytest.mark.parametrize(
    ("mode", "expected"),
    [(0, None), (1, R_1), (2, (R_1 + R_2) / 2), (3, R_1), (4, None), (5, (R_1 + R_2) / 2), (6, R_1), (None, None)],
)
def test_position_error_by_mode(mode, expected):
    samples, joints = make(JointInfo(name="j", actuator="qbmove", mode=mode), link_position=Q, reference_1=R_1, reference_2=R_2)
    error = position_error(samples, joints)[:, 0]
    if expected is None:
        assert np.isnan(error).all()
    else:
        np.testing.assert_allclose(error, expected - Q, rtol=1e-12)


@pytest.mark.parametrize(("mode", "expected"), [(2, (R_1 + R_2) / 2), (3, R_1)])
def test_ideal_motors_stand_at_the_references(mode, expected):
    samples, joints = make(JointInfo(name="j", actuator="bavs", mode=mode), link_position=Q, reference_1=R_1, reference_2=R_2)
    np.testing.assert_allclose(equilibrium_position(samples, joints)[:, 0], expected, rtol=1e-15)


def test_a_joint_among_others_has_the_values_of_one_alone():
    """Kinds stand in any order; of two alike one may be recorded and the other not."""
    kinds = [("qbmove", 6), ("sea", 5), ("bavs", 2), ("qbmove", 6), ("rigid", None), ("bavs", 2), ("awas_ii", 5), ("qbmove", 1)]
    joints = [JointInfo(name=f"j{i}", actuator=actuator, mode=mode) for i, (actuator, mode) in enumerate(kinds)]
    names = ("link_position", "motor_1_position", "motor_2_position", "reference_1", "reference_2")
    values = dict(zip(names, np.random.default_rng(1).normal(size=(len(names), N, len(joints))), strict=True))
    values["motor_1_position"][:, [1, 5]] = values["motor_2_position"][:, [4, 5]] = np.nan
    together = Samples(time=np.arange(N) * 0.1, joints=tuple(joint.name for joint in joints), values=values)
    for name, derived in DERIVED_FUNCTIONS.items():
        found = derived(together, joints[::-1])
        for i, joint in enumerate(joints):
            alone, own = make(joint, **{quantity: table[:, i] for quantity, table in values.items()})
            np.testing.assert_array_equal(found[:, i], derived(alone, own)[:, 0], err_msg=f"{name} of {joint}")


def test_a_users_law_with_plain_mathematics_works():
    import math

    class Curved(Actuator):
        name = "curved_for_test"
        title = "test"
        source = "test"

        @staticmethod
        def equilibrium_position(theta_1, theta_2):
            return math.sin(theta_1) if theta_1 > 0 else theta_2

    ACTUATORS.add(Curved.name, Curved, replace=True)
    samples, joints = make(
        JointInfo(name="j", actuator="curved_for_test", mode=4), motor_1_position=THETA_1, motor_2_position=THETA_2
    )
    expected = np.where(THETA_1 > 0, np.sin(THETA_1), THETA_2)
    np.testing.assert_allclose(equilibrium_position(samples, joints)[:, 0], expected, rtol=1e-15)


def test_an_actuator_that_is_not_here_gives_nan():
    samples, joints = make(JointInfo(name="j", actuator="elsewhere", mode=6), link_position=Q, motor_1_position=THETA_1)
    assert np.isnan(equilibrium_position(samples, joints)).all()
