"""Controllers that read late, held, noisy and quantised measurements move as in an independent solution, at second order."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.linalg import expm

from asrsim.errors import ScenarioError
from asrsim.scenario.data import Imperfections
from asrsim.signals import Sinusoid
from asrsim.simulation.imperfections import Noise
from support.late_sensors import Plant, Sensor, solve
from validation.models import INSTALLED, Body, chain, column, run

GAINS = {"proportional": 5.0, "integral": 10.0, "derivative": 0.1}
LINK = Body(actuator="sea", mass=1.0, reach=0.1, inertia=0.01)
MOTOR = {
    "spring_stiffness": 8.0,
    "motor_1_inertia": 0.01,
    "motor_1_damping": 0.05,
    "motor_1_friction_torque": 0.0,
    "motor_1_max_torque": 1e3,
    "motor_1_max_velocity": 1e3,
    "max_deflection": 10.0,
}
EFFECTS = {
    "a delay of 2.37 steps": {"delay": 2.37e-3},
    "a delay below a step": {"delay": 0.4e-3},
    "ticks between steps": {"rate": 333.0, "delay": 1.1e-3},
    "several ticks in a step": {"rate": 1730.0},
    "noise drawn in each step": {"noise": 0.02},
    "everything at ticks": {"rate": 147.0, "noise": 0.02, "quantum": 0.01, "delay": 0.7e-3},
    "a quantum": {"quantum": 0.02, "delay": 0.4e-3},
    "a quantum under noise": {"quantum": 0.02, "delay": 2.4e-3, "noise": 0.01},
}
END = 0.2


# Engines do not know of sensors, so one case shows that each of them is called in the same way.
@pytest.mark.parametrize(
    ("effect", "engine"),
    [*((effect, INSTALLED[0]) for effect in EFFECTS), *(("everything at ticks", engine) for engine in INSTALLED[1:])],
)
@pytest.mark.parametrize("on_link", [True, False], ids=["link", "motor"])
def test_imperfect_sensors_are_of_second_order(effect, engine, on_link):
    """The draws of the noise do not depend on the number of substeps."""
    imperfections = EFFECTS[effect]
    draws = Noise((0, 0, 8), imperfections.get("noise", 0.0)).draw(np.arange(2000.0))
    sensor = Sensor(**{**imperfections, "noise": lambda number: float(draws[number]), "period": 1e-3})
    given = {} if on_link else {"motor": 0.01, "damping": 0.05, "spring": 8.0}
    truth = solve(Plant(link=0.02, goal=0.5, **GAINS, **given), sensor, [0.3, 1.0, 0.3, 0.0], END)
    errors = []
    for substeps in (1, 2, 3, 8):
        result = run(
            chain(LINK), engine=engine, mode=1 if on_link else 6, gravity=0.0, duration=END, substeps=substeps,
            motor_substeps=1, references={"link_position" if on_link else "equilibrium_position": 0.5},
            parameters={f"controller_1_{name}": gain for name, gain in GAINS.items()} | ({} if on_link else MOTOR),
            initial=[0.3], initial_velocities={"joint_1": 1.0}, compiled=False,
            sensor_imperfections={"*": Imperfections(**imperfections)},
        )  # fmt: skip
        errors.append(abs(column(result, "link_position")[-1] - truth[0]))
    # Without imperfections, the first error is 5e-6 rad (link) and 3e-6 rad (motor).
    assert max(errors[0], 4.0 * errors[1], 9.0 * errors[2], 50.0 * errors[3]) < 2e-5


@pytest.mark.parametrize("frequency", [2.0, 3.1])
@pytest.mark.parametrize("late", [0.0, 2.37e-3])
def test_a_quantised_command_jumps_between_steps(frequency, late):
    """Own solution: the command is constant between the times at which arcsin puts the sine half a quantum from a level."""
    quantum, amplitude, inertia = 0.013, 0.3, 0.02
    w, levels = 2.0 * np.pi * frequency, np.arange(-40, 40) + 0.5
    phases = np.arcsin(np.clip(levels[np.abs(quantum * levels) < amplitude] * quantum / amplitude, -1.0, 1.0))
    turns = np.concatenate([phases, np.pi - phases, 2.0 * np.pi + phases]) / w + late
    edges = np.concatenate([[0.0], np.sort(turns[(turns > late) & (turns < END)]), [END]])
    state = np.array([0.3, 1.0])
    for begin, end in pairwise(edges):
        middle = max(0.5 * (begin + end) - late, 0.0)
        goal = quantum * np.round(amplitude * np.sin(w * middle) / quantum)
        change = np.array([[0.0, 1.0], [-GAINS["proportional"] / inertia, -GAINS["derivative"] / inertia]])
        state = expm(change * (end - begin)) @ (state - [goal, 0.0]) + [goal, 0.0]
    errors = []
    for substeps in (1, 4):
        result = run(
            chain(LINK), mode=1, gravity=0.0, duration=END, substeps=substeps, initial=[0.3], compiled=False,
            references={"link_position": Sinusoid(amplitude=amplitude, frequency=frequency)},
            parameters={f"controller_1_{name}": gain * (name != "integral") for name, gain in GAINS.items()},
            initial_velocities={"joint_1": 1.0}, command_imperfections={"*": Imperfections(quantum=quantum, delay=late)},
        )  # fmt: skip
        errors.append(abs(column(result, "link_position")[-1] - state[0]))
    assert max(errors[0], 16.0 * errors[1]) < 2e-5


def test_noise_of_commands_does_not_depend_on_the_substeps():
    """A draw of a command without rate acts from its step to the next, with any number of substeps."""
    found = []
    for substeps in (1, 4, 16):
        result = run(
            chain(LINK),
            mode=1,
            gravity=0.0,
            duration=END,
            substeps=substeps,
            references={"link_position": 0.5},
            parameters={f"controller_1_{name}": gain for name, gain in GAINS.items()},
            command_imperfections={"*": Imperfections(noise=0.1)},
            compiled=False,
        )
        found.append(column(result, "link_position"))
    coarse, fine = (abs(positions - found[2]).max() for positions in found[:2])
    assert coarse < 2e-5
    assert fine < coarse / 10.0


def test_the_derivative_action_of_a_late_link_sensor_uses_the_velocity_of_the_past():
    """Only the derivative gain acts: the torque is -D times the velocity at the time that the sensor shows."""
    result = run(
        chain(LINK),
        mode=1,
        gravity=0.0,
        duration=0.1,
        references={"link_position": 0.0},
        compiled=False,
        parameters={"controller_1_proportional": 0.0, "controller_1_integral": 0.0, "controller_1_derivative": 0.2},
        initial_velocities={"joint_1": 1.0},
        sensor_imperfections={"*": Imperfections(delay=12e-3)},
    )
    torque, velocity = column(result, "link_torque"), column(result, "link_velocity")
    assert torque[3:12] == pytest.approx(-0.2, abs=1e-6)
    assert torque[14:] == pytest.approx(-0.2 * velocity[2:-12], abs=2e-5)


def test_a_quantised_motor_position_changes_the_torque_in_steps():
    """A motor held at a stop by a torque of P times the goal: its sensor shows the nearest multiple of the quantum."""
    result = run(
        chain(LINK),
        mode=6,
        gravity=0.0,
        duration=0.02,
        references={"equilibrium_position": 1.0},
        compiled=False,
        parameters=MOTOR | {"motor_1_max_position": 0.337, "controller_1_proportional": 2.0, "controller_1_derivative": 0.0},
        initial=[0.337],
        sensor_imperfections={"*": Imperfections(quantum=0.05)},
    )
    assert column(result, "motor_1_torque") == pytest.approx(2.0 * (1.0 - 0.35), abs=1e-12)


def test_a_rate_that_a_step_cannot_hold_is_refused():
    with pytest.raises(ScenarioError, match="ticks in a step") as caught:
        run(chain(LINK), mode=6, duration=0.1, sensor_imperfections={"*": Imperfections(rate=200e3)})
    assert caught.value.problems[0].code == "fast-rate"
