"""Each logged quantity belongs to the time of its row, also where an input of any joint jumps within the step."""

import numpy as np
import pytest

from asrsim.actuators import ACTUATORS
from asrsim.scenario.data import LinkDamping
from asrsim.signals import Sinusoid, Step
from validation.models import INSTALLED, Body, chain, column, run

BODIES = chain(
    *[Body(actuator="qbmove", mass=0.5, reach=0.05, inertia=5e-3, damping=0.05, axis=axis) for axis in ("0 1 0", "1 0 0")]
)
MOVING = Sinusoid(amplitude=0.4, frequency=2.0, phase=0.3)
JUMPS = [0.05, 0.0502, 0.0497]
"""Times of a jump of the other joint's reference: at a row, and in the half step after or before it, s."""
FREE = {
    f"motor_{i}_{name}": value
    for i in (1, 2)
    for name, value in (("max_torque", 1e3), ("max_velocity", 1e3), ("friction_torque", 0.0))
}


def moved(engine, mode, jump, names, **keys):
    """Run in which joint 1 follows a moving reference, and the reference of joint 2 jumps."""
    references = {names[0]: MOVING}
    return run(
        BODIES,
        engine=engine,
        mode=mode,
        duration=0.1,
        gravity=0.0,
        compiled=False,
        joints={"joint_1": references, "joint_2": {names[0]: Step(at=jump, after=0.5)}},
        **keys,
    )


@pytest.mark.parametrize("engine", INSTALLED)
@pytest.mark.parametrize("jump", JUMPS)
def test_torques_and_stiffness_of_ideal_motors_are_those_of_the_row(engine, jump):
    result = moved(engine, 2, jump, ["reference_1"])
    law = ACTUATORS.get("qbmove")
    parameters = law.law_values({parameter.name: parameter.default for parameter in law.all_parameters()})
    reference = MOVING.values(result.samples.time)
    for row, (q, goal) in enumerate(zip(column(result, "link_position"), reference, strict=True)):
        torques = law.elastic_torques(q, goal, 0.0, parameters)
        assert column(result, "motor_1_position")[row] == goal
        assert column(result, "link_torque")[row] == pytest.approx(sum(torques), abs=1e-12)
        assert column(result, "elastic_torque_1")[row] == pytest.approx(torques[0], abs=1e-12)
        assert column(result, "stiffness")[row] == pytest.approx(law.stiffness(q, goal, 0.0, parameters), abs=1e-12)
        assert column(result, "spring_energy")[row] == pytest.approx(law.elastic_energy(q, goal, 0.0, parameters), abs=1e-12)


@pytest.mark.parametrize("engine", INSTALLED)
@pytest.mark.parametrize("jump", JUMPS)
def test_motor_torques_are_those_of_the_row(engine, jump):
    gains = {f"controller_{i}_{name}": value for i in (1, 2) for name, value in (("proportional", 10.0), ("derivative", 0.3))}
    result = moved(engine, 5, jump, ["reference_1"], parameters=FREE | gains)
    error = MOVING.values(result.samples.time) - column(result, "motor_1_position")
    torque = 10.0 * error - 0.3 * column(result, "motor_1_velocity")
    assert column(result, "motor_1_torque") == pytest.approx(torque, abs=1e-9)


@pytest.mark.parametrize("engine", INSTALLED)
@pytest.mark.parametrize("jump", JUMPS)
def test_torques_of_a_controlled_link_and_of_damping_are_those_of_the_row(engine, jump):
    gains = {"controller_1_proportional": 4.0, "controller_1_integral": 0.0, "controller_1_derivative": 0.2}
    result = moved(engine, 1, jump, ["link_position"], parameters=gains, link_damping={"*": LinkDamping(constant=0.1)})
    goals = MOVING.values(result.samples.time), Step(at=jump, after=0.5).values(result.samples.time)
    for j, goal in enumerate(goals):
        velocity = column(result, "link_velocity", j)
        torque = 4.0 * (goal - column(result, "link_position", j)) - 0.2 * velocity
        assert column(result, "link_torque", j) == pytest.approx(torque, abs=1e-9)
        assert column(result, "damping_torque", j) == pytest.approx(-0.15 * velocity, abs=1e-9)


@pytest.mark.parametrize("engine", INSTALLED)
@pytest.mark.parametrize("late", [0.0, 0.3, 0.8])
def test_the_velocity_is_that_of_the_row(engine, late):
    """A free link at rest is accelerated from a jump of the torque on."""
    jump, inertia = 0.02 + late * 1e-3, 0.5 * 0.05**2 + 5e-3
    body = Body(mass=0.5, reach=0.05, inertia=5e-3)
    result = run(
        chain(body), engine=engine, gravity=0.0, duration=0.05, compiled=False, external={"joint_1": Step(at=jump, after=0.4)}
    )
    truth = 0.4 / inertia * np.maximum(result.samples.time - jump, 0.0)
    assert column(result, "link_velocity") == pytest.approx(truth, abs=1e-12)
