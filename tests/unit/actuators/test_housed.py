"""A motor on the housing: the springs act on it, and its reaction does not act on the link."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from asrsim.actuators import ACTUATORS
from asrsim.actuators.checker import check_actuator
from asrsim.actuators.drive import Drive
from asrsim.actuators.modes import MODES
from asrsim.datasheet.statics import Statics
from asrsim.errors import ActuatorError, ScenarioError
from asrsim.plugins import load_plugin_file
from asrsim.scenario import make_scenario
from asrsim.simulation.examine import examine
from asrsim.simulation.run import simulate
from asrsim.statics.holding import holdings
from asrsim.sweeps.keys import plan_keys
from support.three_motors import PRELOAD
from support.tiny import PENDULUM
from validation.models import Body, chain, column, run

INERTIA = 0.05
"""Inertia of the link, kg m^2."""
MOTORS = {
    "inertia": (0.02, 0.03, 0.015),
    "damping": (0.1, 0.2, 0.15),
    "proportional": (60.0, 80.0, 50.0),
    "derivative": (2, 3, 1),
}
GOALS = {"reference_1": 0.4, "reference_2": 0.1, "reference_3": 0.25}
FREE = {"friction_torque": 0.0, "max_torque": 1e3, "max_velocity": 1e3}


@pytest.fixture(autouse=True)
def preload(tmp_path):
    """The plugin, loaded; its path."""
    path = write(tmp_path / "preload.py", PRELOAD)
    load_plugin_file(path)
    return path


def write(path, text):
    path.write_text(text)
    return path


def parameters():
    own = {f"{'controller' if name in ('proportional', 'derivative') else 'motor'}_{i + 1}_{name}": value[i]
           for name, value in MOTORS.items() for i in range(3)}  # fmt: skip
    return own | {f"motor_{i}_{name}": value for name, value in FREE.items() for i in (1, 2, 3)}


def slopes(time, state):
    """Derivatives of link and motor positions and velocities: the equations of motion of the two springs."""
    q, v, theta, omega = state[0], state[1], state[2:5], state[5:]
    first, second = theta[0] - q + theta[2], theta[1] - q - theta[2]
    torques = 6.0 * np.array([first, second]) + 20.0 * np.array([first, second]) ** 3
    loads = np.array([*torques, torques[0] - torques[1]])
    inertia, damping, gain, drag = map(np.array, MOTORS.values())
    commanded = gain * (np.array([*GOALS.values()]) - theta) - (drag + damping) * omega
    return [v, torques.sum() / INERTIA, *omega, *(commanded - loads) / inertia]


@pytest.mark.parametrize("compiled", [False, True])
def test_a_motor_on_the_housing_preloads_springs_as_an_ode_solver_says(compiled):
    arm = chain(Body(actuator="preload", mass=1e-9, reach=0.0, inertia=INERTIA))
    result = run(
        arm,
        mode=5,
        gravity=0.0,
        duration=0.6,
        initial=[0.3],
        references=GOALS,
        parameters=parameters(),
        compiled=compiled,
        substeps=1,
    )
    # The motors on the side of the link start with the link, the motor on the housing at 0.
    start = [0.3, 0.0, 0.3, 0.3, 0.0, 0.0, 0.0, 0.0]
    expected = solve_ivp(slopes, (0, 0.6), start, t_eval=result.samples.time, rtol=1e-10, atol=1e-12).y
    found = [column(result, name) for name in ("link_position", *(f"motor_{i}_position" for i in (1, 2, 3)))]
    np.testing.assert_allclose(found, expected[[0, 2, 3, 4]], atol=2e-5)
    assert np.abs(column(result, "energy_residual")).max() < 1e-3


def test_a_damper_does_not_act_between_link_and_housing():
    """A link swings between standing motors: the dampers of the two springs slow it down, and none acts on the third motor."""
    arm = chain(Body(actuator="preload", mass=1e-9, reach=0.0, inertia=INERTIA))
    still, damping = {"reference_1": 0.0, "reference_2": 0.0, "reference_3": 0.2}, 0.1
    result = run(
        arm, mode=2, gravity=0.0, duration=0.3, initial=[0.3], references=still, parameters={"spring_damping": damping}
    )

    def pulls(q):
        return [6.0 * one + 20.0 * one**3 for one in (0.2 - q, -0.2 - q)]

    q = column(result, "link_position")
    first, second = pulls(q)
    np.testing.assert_allclose(column(result, "elastic_torque_3"), first - second, atol=1e-9)
    swing = solve_ivp(
        lambda _, x: [x[1], (sum(pulls(x[0])) - 2.0 * damping * x[1]) / INERTIA],
        (0, 0.3), [0.3, 0.0], t_eval=result.samples.time, rtol=1e-10, atol=1e-12,
    )  # fmt: skip
    np.testing.assert_allclose(q, swing.y[0], atol=2e-5)


def test_an_arm_sags_as_far_as_the_run_says(tmp_path):
    (tmp_path / "arm.urdf").write_text(PENDULUM.replace("libsea", "libpreload"))
    wanted = {"elbow": {"equilibrium_position": 1.0, "stiffness_preset": 0.1}}
    plan = examine(make_scenario(tmp_path / "arm.urdf", duration=4.0, modes=3, references=wanted, initial="equilibrium"))
    assert plan.model is not None
    (holding,) = holdings(plan.scenario, plan.robot, plan.model)
    final = simulate(plan).samples.values["link_position"][-1, 0]
    assert holding.sag > 0.01
    assert holding.sag == pytest.approx(1.0 - final, abs=2e-3)


def test_the_toolbox_does_not_move_a_third_motor(tmp_path):
    (tmp_path / "arm.urdf").write_text(PENDULUM.replace("libsea", "libpreload"))
    with pytest.raises(ScenarioError, match="'elbow' has 3 motors; the toolbox moves only 2"):
        examine(make_scenario(tmp_path / "arm.urdf", duration=0.1, stepping="toolbox", modes=5))


def test_laws_with_a_motor_on_the_housing_are_checked(preload):
    assert check_actuator(ACTUATORS.get("preload")).passed
    load_plugin_file(
        write(preload.with_name("wrong.py"), PRELOAD.replace("housed = 1", "housed = 0").replace('"preload"', '"wrong"'))
    )
    failed = {check.name for check in check_actuator(ACTUATORS.get("wrong")).checks if not check.passed}
    assert failed == {"stiffness", "passive", "energy", "reference map"}


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("housed = 1", "housed = 3", "housed: must be less than the number of motors, 3"),
        (
            "def elastic_energy",
            "def other_energy",
            "elastic_energy: is missing; an actuator with motors on the housing needs this law",
        ),
    ],
)
def test_a_wrong_declaration_of_motors_on_the_housing_is_named(preload, old, new, message):
    with pytest.raises(ActuatorError, match=message):
        load_plugin_file(write(preload.with_name("wrong.py"), PRELOAD.replace(old, new)))


def test_a_motor_on_the_housing_adds_nothing_to_the_torque_and_the_speed_of_a_data_sheet():
    actuator = ACTUATORS.get("preload")
    values = {one.name: one.default for one in actuator.all_parameters()} | {"motor_3_max_velocity": 0.1}
    statics = Statics(drive=Drive(joint="joint_1", actuator=actuator, mode=MODES[6], values=values))
    speed = 2.0
    one = values["motor_1_max_torque"] - values["motor_1_damping"] * speed - values["motor_1_friction_torque"]
    assert statics.motor_torque(np.array([speed])) == pytest.approx(2.0 * one)
    assert statics.top_speed == values["motor_1_max_velocity"]


def test_a_sweep_varies_the_reference_of_the_third_motor(tmp_path):
    robot = write(
        tmp_path / "arm.urdf", PENDULUM.replace("libsea", "libpreload").replace("<operation_mode>3", "<operation_mode>5")
    )
    plan, key = examine(make_scenario(robot, duration=0.1)), "references.elbow.reference_3"
    assert plan_keys([key], {key: True}, plan.scenario, plan.robot).references == {key: (("elbow", "reference_3"),)}
