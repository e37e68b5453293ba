"""Motors at position stops and speed limits: logged torques and losses are those of a motor at rest or at this speed."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from asrsim.signals import Step
from validation.models import INSTALLED, Body, chain, column, run

HEAVY = chain(Body(actuator="sea", mass=1e6, reach=0.0, inertia=1e6))
"""Heavy link that hardly moves, so that the end of the motor's spring is fixed."""
WINDING = {"motor_1_torque_constant": 3.0, "motor_1_resistance": 1.0, "motor_1_max_torque": 100.0}


def drive(**keys):
    return run(HEAVY, gravity=0.0, **keys)


@pytest.mark.parametrize("engine", INSTALLED)
@pytest.mark.parametrize("stepping", ["leapfrog", "euler"])
@pytest.mark.parametrize("stop", [0.3, 0.30037, 0.3009])
def test_motor_on_its_stop_draws_voltage_over_resistance(engine, stepping, stop):
    result = drive(
        engine=engine,
        stepping=stepping,
        mode=7,
        duration=2.0,
        references={"motor_1_voltage": 4.0},
        parameters={**WINDING, "motor_1_max_position": stop, "motor_1_min_position": -stop, "spring_k": 20.0},
    )
    assert column(result, "motor_1_position")[1000:] == pytest.approx(stop, abs=1e-12)
    assert column(result, "motor_1_velocity")[1000:] == pytest.approx(0.0, abs=1e-9)
    assert column(result, "motor_1_current")[1000:] == pytest.approx(4.0, abs=1e-9)
    assert column(result, "motor_1_torque")[1000:] == pytest.approx(12.0, abs=1e-9)
    # The winding dissipates R i^2 = 16 W, and a motor at rest does no work.
    assert np.ptp(column(result, "winding_loss")[1000:2001]) == pytest.approx(16.0, rel=1e-9)
    assert np.ptp(column(result, "motor_work")[1000:]) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("stepping", ["leapfrog", "euler"])
def test_current_at_the_speed_limit_includes_the_back_emf(stepping):
    result = drive(
        stepping=stepping,
        mode=7,
        duration=0.5,
        references={"motor_1_voltage": 4.0},
        parameters={**WINDING, "motor_1_max_velocity": 0.5, "spring_k": 1e-6},
    )
    assert column(result, "motor_1_velocity")[250:] == pytest.approx(0.5, abs=1e-9)
    assert column(result, "motor_1_current")[250:] == pytest.approx(4.0 - 3.0 * 0.5, abs=1e-9)


@pytest.mark.parametrize("stepping", ["leapfrog", "euler"])
def test_controller_torque_on_a_stop_is_gain_times_error(stepping):
    result = drive(
        stepping=stepping, mode=5, duration=1.0, references={"reference_1": 0.55},
        parameters={
            "motor_1_max_position": 0.3, "motor_1_max_torque": 50.0, "controller_1_proportional": 50.0,
            "controller_1_derivative": 2.0, "controller_1_integral": 0.0, "spring_k": 20.0,
        },
    )  # fmt: skip
    assert column(result, "motor_1_torque")[600:] == pytest.approx(50.0 * 0.25, abs=1e-9)


@pytest.mark.parametrize("friction", [0.0, 0.7])
@pytest.mark.parametrize("stop", [0.2, 0.20041])
def test_motor_leaves_its_stop_by_its_equation_of_motion(friction, stop):
    inertia, damping, stiffness, slope, leaves = 0.02, 0.5, 5.0, 1000.0, 0.8
    result = drive(
        mode=4,
        duration=0.85,
        step=2.5e-4,
        references={"motor_1_torque": Step(at=leaves, before=6.0, after=-2.0)},
        parameters={
            "motor_1_inertia": inertia,
            "motor_1_damping": damping,
            "motor_1_friction_torque": friction,
            "motor_1_max_position": stop,
            "spring_k": stiffness,
        },
    )

    def rate(_, state):
        # Dahl's bristles: the way to the stop deflects them, and the way back reverses the deflection.
        rub = max(friction - slope * (stop - state[0]), -friction)
        return [state[1], (-2.0 - damping * state[1] - stiffness * state[0] - rub) / inertia]

    there = solve_ivp(rate, (0.0, 0.05), [stop, 0.0], rtol=1e-10, atol=1e-12, max_step=1e-3).y[0, -1]
    assert column(result, "motor_1_position")[-1] == pytest.approx(there, abs=1e-5)


def test_the_summary_counts_steps_of_a_motor_at_its_stop():
    result = drive(
        mode=7,
        duration=2.0,
        references={"motor_1_voltage": 4.0},
        parameters={**WINDING, "motor_1_max_position": 0.3, "spring_k": 20.0},
    )
    at_stop = column(result, "motor_1_position") >= 0.3 - 1e-9
    assert result.counts.motor_stop[0] == pytest.approx(np.count_nonzero(at_stop), abs=2)
    assert np.count_nonzero(at_stop) > 1000
