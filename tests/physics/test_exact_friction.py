"""Coulomb friction of many joints: a joint sticks with less than its friction torque, or slides with all of it."""

import numpy as np
import pytest

from asrsim.engines import ENGINES
from asrsim.engines.base import FRICTION, TORQUE, VELOCITY
from asrsim.robot.dynamics import robot_model
from asrsim.scenario import Scenario
from validation.models import Body, chain

STEP = 1e-5
JOINTS = 7


def arm(random):
    """Chain of seven links with random axes and random friction."""
    bodies = [
        Body(
            mass=random.uniform(0.1, 1.0),
            reach=-random.uniform(0.05, 0.2),
            inertia=3e-3,
            length=-0.2,
            axis=" ".join(map(str, random.normal(size=3).tolist())),
            friction=random.uniform(0.0, 3.0),
            limits='<limit lower="-9" upper="9" effort="99" velocity="99"/>',
        )
        for _ in range(JOINTS)
    ]
    return chain(*bodies)


def step(engine, place, before, torque, friction):
    """Exchange array (joints, 6) after a step from the given state."""
    engine.start(place.tolist(), before.tolist(), step=STEP, staggered=False, implicitness=0.0)
    exchange = np.zeros((1, JOINTS, 6))
    exchange[0, :, TORQUE], exchange[0, :, FRICTION] = torque, friction
    engine.step(exchange, np.zeros((1, 0, 6)), np.ones(1))
    return exchange[0]


@pytest.mark.parametrize("resting", [0, 3, 6, 7])
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", ["mujoco", "bullet"])
def test_every_joint_sticks_or_slides(name, seed, resting):
    random = np.random.default_rng([seed, resting])
    robot = arm(random)
    scenario = Scenario(name="chain", robot=robot.path)
    engine, model = ENGINES.get(name).make(scenario, robot)[0], robot_model(scenario, robot)
    try:
        friction = np.array([joint.friction for joint in robot.moving_joints])
        kinds = set()
        for _ in range(20):
            place = random.uniform(-1.5, 1.5, JOINTS)
            before = random.uniform(-2.0, 2.0, JOINTS)
            before[random.permutation(JOINTS)[:resting]] = 0.0
            torque = random.uniform(-6.0, 6.0, JOINTS)
            after = step(engine, place, before, torque, friction)[:, VELOCITY]
            held = model.inverse_dynamics(place, before, (after - before) / STEP) - torque
            assert np.all(np.abs(held) <= friction + 1e-6)
            sticks = np.abs(after) < 1e-9
            if np.all((before == 0.0) | (before * after > 0.0)):
                # No velocity reaches 0 within the step.
                assert np.abs(held + np.sign(after) * friction)[~sticks] == pytest.approx(0.0, abs=1e-6)
                kinds |= {int(sticks.sum())}
        assert len(kinds) > 1 or resting == 0
    finally:
        engine.close()
