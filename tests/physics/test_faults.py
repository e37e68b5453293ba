"""Former faults that gave wrong results without an error: axes, link controllers, energies, delays, damping."""

from dataclasses import replace

import numpy as np
import pytest

from asrsim.signals import Sinusoid
from support.hanging_chain import INERTIA, MASS, NEVER, REACH, joint, plan, samples, truth
from support.random_runs import Wave
from validation.models import INSTALLED, Body, chain, column, run

# -- axes --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("engine", INSTALLED)
@pytest.mark.parametrize("axis", ["0 2 0", "0 1.0005 0", "0.3 0.3 -0.1", "1e-3 0 0"])
def test_length_of_a_joint_axis_has_no_effect(tmp_path, engine, axis):
    unit = np.array([float(part) for part in axis.split()])
    unit /= np.linalg.norm(unit)
    joints = joint(start=0.4), joint(start=-0.3)
    given, exact = (plan(joints, 0.3, axes=(first, "0 1 0")) for first in (axis, " ".join(map(repr, unit.tolist()))))
    found = samples(given, tmp_path, engine=engine)
    np.testing.assert_allclose(found.values["link_position"], truth(exact, found.time), atol=5e-5)


# -- the link's controller (mode 1) ------------------------------------------------------------------------------------

GAINS = {"controller_1_proportional": 12.0, "controller_1_integral": 60.0, "controller_1_derivative": 0.5}
JUMP = Wave(offset=0.3, amplitude=0.2, frequency=2.0, at=0.1, jump=0.4)


def controlled(effort=np.inf):
    """Run of a joint in mode 1 next to a joint with a motor. The motor's substeps must not affect the link controller."""
    first = joint(effort=effort, actuator="sea", mode=1, parameters=GAINS, references=(JUMP,))
    parameters = {
        "spring_stiffness": 20.0, "max_deflection": 1.5, "motor_1_inertia": 0.02, "motor_1_damping": 0.1,
        "motor_1_max_torque": 8.0, "motor_1_friction_torque": 0.0, "motor_1_max_velocity": 1e3,
        "controller_1_proportional": 40.0, "controller_1_integral": 20.0, "controller_1_derivative": 1.0,
    }  # fmt: skip
    second = joint(effort=effort, actuator="sea", mode=6, parameters=parameters, references=(NEVER,))
    return plan((first, second), 0.4, jumps=(0.1,))


@pytest.mark.parametrize("engine", INSTALLED)
@pytest.mark.parametrize("motor_substeps", [1, 3, 11])
def test_link_integrator_does_not_depend_on_motor_substeps(tmp_path, engine, motor_substeps):
    given = controlled()
    found = samples(given, tmp_path, engine=engine, substeps=2, motor_substeps=motor_substeps)
    np.testing.assert_allclose(found.values["link_position"], truth(given, found.time), atol=1e-4)


@pytest.mark.parametrize("engine", INSTALLED)
@pytest.mark.parametrize("effort", [1.5, 3.0])
def test_effort_limit_clips_the_whole_controller_output(tmp_path, engine, effort):
    """The torque is sat(PI - D v), not sat(PI) - D v."""
    given = controlled(effort)
    found = samples(given, tmp_path, engine=engine)
    torque = found.values["link_torque"]
    assert np.abs(torque[:, 0]).max() == effort, "the limit is met"
    np.testing.assert_allclose(found.values["link_position"], truth(given, found.time), atol=3e-4)


@pytest.mark.parametrize("engine", INSTALLED)
@pytest.mark.parametrize("effort", [1.5, 1e6])
@pytest.mark.parametrize("mode", [1, 3, 6])
def test_logged_torque_explains_the_change_of_momentum(engine, effort, mode):
    """Without gravity, I (v_n - v_0) = h times the sum of the logged torques, up to rounding."""
    limits = f'<limit lower="-30" upper="30" effort="{effort}" velocity="1000"/>'
    name = "link_position" if mode == 1 else "equilibrium_position"
    result = run(
        chain(Body(actuator="sea", mass=MASS, reach=REACH, inertia=INERTIA, damping=0.02, limits=limits)),
        mode=mode,
        gravity=0.0,
        duration=0.3,
        engine=engine,
        references={name: Sinusoid(amplitude=0.5, frequency=3.0)},
        substeps=1,
        motor_substeps=1,
        parameters={"controller_1_proportional": 20.0, "controller_1_derivative": 0.3},
    )
    pushed = column(result, "link_torque") + column(result, "damping_torque")
    q = column(result, "link_position")
    # Velocities at half steps are differences of positions.
    momentum = (INERTIA + MASS * REACH**2) * np.diff(q) / 1e-3
    assert np.abs(momentum).max() > 1e-3
    np.testing.assert_allclose(momentum[1:] - momentum[:-1], 1e-3 * pushed[1:-1], atol=1e-12)


# -- sensors -----------------------------------------------------------------------------------------------------------


def delayed_pendulum(delay, duration, fine=1e-5):
    """Positions of a pendulum under a PD controller with a sensor delay of `delay` s, every 1 ms, by Heun's method."""
    p, d, inertia = 12.0, 0.25, INERTIA + MASS * REACH**2
    late, count = round(delay / fine), round(duration / fine)
    q, v = np.zeros(count + 1), np.zeros(count + 1)

    def rate(x, seen):
        past = max(seen, 0)
        torque = p * (0.5 - q[past]) - d * v[past]
        return (torque - MASS * 9.81 * REACH * np.sin(x)) / inertia

    for k in range(count):
        first = rate(q[k], k - late)
        ahead = q[k] + fine * v[k]
        q[k + 1], v[k + 1] = ahead, v[k] + fine * first
        second = rate(ahead, k + 1 - late)
        q[k + 1] = q[k] + 0.5 * fine * (2.0 * v[k] + fine * first)
        v[k + 1] = v[k] + 0.5 * fine * (first + second)
    return np.asarray(q[:: round(1e-3 / fine)])


@pytest.mark.parametrize("engine", INSTALLED)
@pytest.mark.parametrize("delay", [0.004, 0.012])
def test_sensor_delay_applies_to_position_and_velocity(tmp_path, engine, delay):
    gains = {"controller_1_proportional": 12.0, "controller_1_integral": 0.0, "controller_1_derivative": 0.25}
    goal = replace(NEVER, offset=0.5)
    given = plan([joint(actuator="sea", mode=1, parameters=gains, references=(goal,))], 0.4)
    expected = delayed_pendulum(delay, 0.4)
    found = []
    for substeps in (1, 4):
        result = samples(given, tmp_path, engine=engine, imperfections={"sensors": {"*": {"delay": delay}}}, substeps=substeps)
        found.append(float(np.abs(result.values["link_position"][:, 0] - expected).max()))
    assert np.abs(expected - delayed_pendulum(1e-5, 0.4)).max() > 0.02, "the delay matters"
    assert found[0] < 2e-3
    assert found[1] < 0.3 * found[0] or found[1] < 1e-6


# -- strong damping ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("engine", INSTALLED)
@pytest.mark.parametrize("damping", [0.5, *(pytest.param(damping, marks=pytest.mark.slow) for damping in (3.0, 20.0)), 300.0])
def test_strong_damping_is_simulated_accurately(tmp_path, engine, damping):
    """The damping number c h / I of the last joint is 0.25 to 150."""
    given = plan([joint(start=0.5, damping=damping)] * 3, 0.3, axes=("0 1 0", "0 1 0", "1 0 0"))
    found = samples(given, tmp_path, engine=engine)
    true = truth(given, found.time[::10])
    np.testing.assert_allclose(found.values["link_position"][::10], true, atol=1e-3)
    for stepping in ("euler", "toolbox"):
        explicit = samples(given, tmp_path, engine=engine, stepping=stepping)
        np.testing.assert_allclose(explicit.values["link_position"][::10], true, atol=2e-2)
