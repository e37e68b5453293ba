"""Optional models compared with closed forms and independent solutions: electric motors, friction that depends on speed and
load, hysteresis of springs."""

from dataclasses import replace
from math import tanh

import numpy as np
import pytest

from asrsim.actuators import ACTUATORS
from asrsim.engines import ENGINES
from asrsim.errors import RobotError, ScenarioError
from asrsim.robot.doubts import warnings_of
from asrsim.robot.edit import edited_urdf
from asrsim.signals import Ramp, Sinusoid
from asrsim.simulation.prepare import prepare
from asrsim.simulation.simulation import Simulation
from support.event_driven import EventDriven, Mass
from validation.models import Body, chain, column, read, run

ENGINES_HERE = [name for name in ("mujoco", "bullet") if ENGINES.get(name).available]
FREE = {"motor_1_damping": 0.0, "motor_1_friction_torque": 0.0, "motor_1_max_torque": 1e3, "motor_1_max_velocity": 1e3}
"""Parameters of a motor without losses and limits."""
DC = {"motor_1_torque_constant": 0.05, "motor_1_gear_ratio": 20.0, "motor_1_resistance": 2.0, "motor_1_inertia": 0.02}
"""Electric motor with n k_t = 1 N m/A, R = 2 ohm: (n k_t)^2 / R = 0.5 N m s/rad, time constant 40 ms."""
EVERYTHING = {
    "stribeck_friction": 0.03, "stribeck_velocity": 0.2, "load_friction": 0.1, "friction_stiffness": 300.0,
    "torque_constant": 0.05, "gear_ratio": 30.0, "resistance": 3.0, "max_voltage": 12.0, "max_current": 3.0,
}  # fmt: skip


def rubbing(robot, **friction):
    """Copy of the robot with the given friction in its moving joints."""
    changed = dict(friction)
    return replace(robot, joints=tuple(replace(joint, **changed) if joint.moves else joint for joint in robot.joints))


def bench(mode, parameters, *, link=0.0, **how):
    """Result of a test bench that holds or moves the link of an SEA."""
    motion = {} if link == 0.0 else {"motion": {"joint_1": link}}
    robot = chain(Body(actuator="sea", inertia=1e-2))
    return run(robot, mode=mode, engine="bench", parameters=parameters, compiled=False, **motion, **how)


# -- electric motors -----------------------------------------------------------------------------------------------------


def test_voltage_accelerates_a_motor_to_its_no_load_speed():
    """tau = n k_t i, u = R i + n k_t omega: omega = u / (n k_t) (1 - exp(-t / T)), T = J R / (n k_t)^2, to second order."""
    errors = []
    for substeps in (1, 2):
        result = bench(
            7,
            {**FREE, **DC, "spring_stiffness": 1e-12},
            references={"motor_1_voltage": 6.0},
            duration=0.3,
            substeps=substeps,
            motor_substeps=1,
        )
        time = np.asarray(result.samples.time)
        errors.append(np.abs(column(result, "motor_1_velocity") - 6.0 * (1.0 - np.exp(-time / 0.04)))[1:].max())
    assert errors[0] < 6e-4
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.1)
    assert column(result, "motor_1_voltage")[50:] == pytest.approx(6.0, abs=1e-12)
    current = column(result, "motor_1_current")
    assert current[-1] == pytest.approx(3.0 * np.exp(-0.3 / 0.04), rel=1e-3)
    # Heat: R int i^2 dt = u^2 / R T / 2 (1 - exp(-2 t / T)). The work of the motor is its kinetic energy.
    assert column(result, "winding_loss")[-1] == pytest.approx(18.0 * 0.02, rel=2e-3)
    assert column(result, "motor_work")[-1] == pytest.approx(0.5 * 0.02 * 36.0, rel=3e-3)
    assert np.abs(column(result, "energy_residual")).max() < 2e-5


@pytest.mark.parametrize(
    ("mode", "reference", "limits", "torque"),
    [
        (7, {"motor_1_voltage": 6.0}, {}, 3.0),
        (7, {"motor_1_voltage": -6.0}, {"motor_1_max_voltage": 4.0}, -2.0),
        (7, {"motor_1_voltage": 6.0}, {"motor_1_max_current": 1.5}, 1.5),
        (7, {"motor_1_voltage": 6.0}, {"motor_1_max_torque": 1.0}, 1.0),
        (8, {"motor_1_current": 2.5}, {}, 2.5),
        (8, {"motor_1_current": 2.5}, {"motor_1_max_voltage": 4.0}, 2.0),
        (8, {"motor_1_current": -2.5}, {"motor_1_max_current": 0.5}, -0.5),
        (4, {"motor_1_torque": 2.5}, {"motor_1_max_voltage": 4.0}, 2.0),
        (4, {"motor_1_torque": 2.5}, {}, 2.5),
        (5, {"reference_1": 1.0}, {"controller_1_proportional": 1e4, "motor_1_max_voltage": 4.0}, 2.0),
    ],
)
def test_stall_torque_and_limits(mode, reference, limits, torque):
    """With a locked link, the motor stops where the spring torque equals n k_t u / R, clipped by the limits."""
    parameters = {**FREE, **DC, "motor_1_damping": 5.0, "spring_stiffness": 50.0, "max_deflection": 3.0, **limits}
    result = bench(mode, parameters, references=reference, duration=2.0)
    assert column(result, "elastic_torque_1")[-1] == pytest.approx(torque, rel=1e-6)
    assert column(result, "motor_1_current")[-1] == pytest.approx(torque, rel=1e-6)
    assert column(result, "motor_1_voltage")[-1] == pytest.approx(2.0 * torque, rel=1e-6)


@pytest.mark.parametrize("stepping", ["leapfrog", "euler"])
@pytest.mark.parametrize(
    ("mode", "reference", "limits", "reached"),
    [
        (7, {"motor_1_voltage": -6.0}, {"motor_1_max_voltage": 4.0}, True),
        (7, {"motor_1_voltage": 3.9}, {"motor_1_max_voltage": 4.0}, False),
        (8, {"motor_1_current": 3.0}, {"motor_1_max_current": 2.5}, True),
        (8, {"motor_1_current": 2.4}, {"motor_1_max_current": 2.5}, False),
        (4, {"motor_1_torque": 3.0}, {"motor_1_max_torque": 2.5}, True),
    ],
)
def test_substeps_at_the_voltage_or_current_limit_are_counted(mode, reference, limits, reached, stepping):
    """The motor is accelerated by a constant input, without a spring that holds it."""
    parameters = {**FREE, **DC, "spring_stiffness": 1e-12, **limits}
    result = bench(mode, parameters, references=reference, duration=0.05, stepping=stepping)
    assert np.abs(column(result, "motor_1_velocity")).max() > 0.5
    assert result.counts.saturation[0] == (result.counts.substeps if reached else 0)


def test_a_servo_of_voltage_droops_by_its_gain_in_volts():
    """With u = P (r - theta) and tau = n k_t u / R, the steady error is tau R / (n k_t P), also at an equilibrium start."""
    values = {**FREE, **DC, "spring_stiffness": 20.0, "max_deflection": 3.0, "controller_1_proportional": 40.0}
    robot = chain(Body(actuator="sea", mass=0.3, reach=0.2, inertia=1e-3, damping=0.05))
    how = {"parameters": values, "references": {"reference_1": 0.6}, "compiled": False}
    result = run(robot, mode=5, duration=0.2, initial_equilibrium=True, **how)
    torque = column(result, "elastic_torque_1")[-1]
    assert abs(torque) > 0.1
    assert 0.6 - column(result, "motor_1_position")[-1] == pytest.approx(torque * 2.0 / (1.0 * 40.0), rel=1e-9)
    assert np.ptp(column(result, "link_position")) < 1e-10


# -- friction ------------------------------------------------------------------------------------------------------------

INERTIA, SPRING, SPEED = 0.01, 4.0, 0.1
COULOMB, EXCESS, FADE = 0.2, 0.15, 0.05


@pytest.fixture(scope="module")
def limit_cycle():
    """Time and position of a mass that a spring pulls at constant speed: stick-slip motion."""
    time = np.arange(0.0, 3.0005, 1e-3)
    joint = EventDriven(Mass(INERTIA), lambda v: COULOMB + EXCESS * np.exp(-((v / FADE) ** 2)))
    place, speed = joint.move(np.zeros(1), np.zeros(1), lambda t, x: SPRING * (SPEED * t - x), time)[0].T
    assert np.sum(np.diff((speed > 0.0).astype(int)) == 1) >= 2
    return time, place


def test_a_joint_sticks_and_slips(limit_cycle):
    """The error of the limit cycle is of second order, including the events."""
    robot = rubbing(
        chain(Body(actuator="sea", reach=0.0, inertia=INERTIA, friction=COULOMB)),
        stribeck_friction=EXCESS,
        stribeck_velocity=FADE,
    )
    pull = Ramp(duration=10.0, final=10.0 * SPEED)
    for engine in ENGINES_HERE:
        errors = []
        for substeps in (1, 4):
            result = run(
                robot, mode=2, engine=engine, references={"reference_1": pull}, duration=3.0, substeps=substeps,
                parameters={"spring_stiffness": SPRING, "max_deflection": 3.0}, gravity=0.0, compiled=False,
            )  # fmt: skip
            errors.append(np.abs(column(result, "link_position") - limit_cycle[1]).max())
        assert errors[0] < 1.5e-3
        assert errors[1] < errors[0] / 10.0


def test_a_motor_sticks_and_slips(limit_cycle):
    """The motor winds up its spring with stick-slip motion; its bristles deflect by 0.35 mrad before it slips."""
    parameters = {
        **FREE,
        "motor_1_inertia": INERTIA,
        "motor_1_friction_torque": COULOMB,
        "motor_1_stribeck_friction": EXCESS,
        "motor_1_stribeck_velocity": FADE,
        "spring_stiffness": SPRING,
        "max_deflection": 3.0,
    }
    pull = Ramp(duration=10.0, final=10.0 * SPRING * SPEED)
    result = bench(4, parameters, references={"motor_1_torque": pull}, duration=3.0)
    error = np.abs(column(result, "motor_1_position") - limit_cycle[1])
    assert error.max() < 3e-3
    assert error.mean() < 7e-4
    # Bristles return only their stored energy.
    lost = column(result, "friction_loss")
    assert (np.maximum.accumulate(lost) - lost).max() < 1.01 * 0.5 * (COULOMB + EXCESS) ** 2 / 1000.0
    assert np.abs(column(result, "energy_residual")).max() < 2e-6


@pytest.mark.parametrize("engine", ENGINES_HERE)
def test_the_friction_of_a_joint_follows_its_torque_up_to_the_effort_limit(engine):
    """A reference of 10 N m is limited to 1 N m: 0.1 + 0.2 * 1 N m of friction are left to slow the link."""
    limits = '<limit lower="-90" upper="90" effort="1" velocity="1000"/>'
    body = Body(actuator="sea", reach=0.0, inertia=INERTIA, friction=0.1, limits=limits)
    result = run(
        rubbing(chain(body), load_friction=0.2),
        mode=0,
        engine=engine,
        gravity=0.0,
        duration=0.1,
        references={"link_torque": 10.0},
        compiled=False,
    )
    speed = column(result, "link_velocity")[-1]
    assert speed == pytest.approx((1.0 - 0.1 - 0.2) / INERTIA * 0.1, rel=1e-9)


@pytest.mark.parametrize("engine", ENGINES_HERE)
def test_joint_friction_grows_with_the_load(engine):
    """A moving joint obeys I a = tau (1 - c) - tau_c; a joint at rest sticks up to tau_c / (1 - c)."""
    robot = rubbing(chain(Body(actuator="sea", reach=0.0, inertia=INERTIA, friction=0.1)), load_friction=0.2)
    for torque in (0.124, 0.5):
        result = run(
            robot, mode=0, engine=engine, references={"link_torque": torque}, duration=0.5, gravity=0.0, compiled=False
        )
        moved = 0.5 * max(torque * 0.8 - 0.1, 0.0) / INERTIA * 0.25
        assert column(result, "link_position")[-1] == pytest.approx(moved, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("stiffness", [200.0, 1000.0, 5000.0])
def test_sticking_motor_deflects_its_bristles(stiffness):
    numbers = {"motor_1_friction_torque": 0.5, "motor_1_friction_stiffness": stiffness, "motor_1_damping": 2.0}
    result = bench(4, {**FREE, **numbers, "spring_stiffness": 1e-12}, references={"motor_1_torque": 0.2}, duration=0.5)
    assert column(result, "motor_1_position")[-1] == pytest.approx(0.2 / stiffness, rel=1e-6)


def test_motor_friction_grows_with_the_load():
    """The motor torque is k theta (1 + c) + tau_c while the spring is wound slowly, and k theta (1 - c) - tau_c on release."""
    parameters = {
        **FREE,
        "motor_1_friction_torque": 0.1,
        "motor_1_load_friction": 0.2,
        "motor_1_damping": 1.0,
        "spring_stiffness": 5.0,
        "max_deflection": 3.0,
    }
    slow = Sinusoid(amplitude=1.0, frequency=0.02)
    result = bench(4, parameters, references={"motor_1_torque": slow}, duration=23.0)
    time, spring = result.samples.time, column(result, "elastic_torque_1")
    torque = column(result, "motor_1_torque")
    up, down = np.searchsorted(time, (8.0, 22.5))
    assert spring[up] * 1.2 + 0.1 == pytest.approx(torque[up], abs=0.03)
    assert spring[down] * 0.8 - 0.1 == pytest.approx(torque[down], abs=0.03)


# -- hysteresis ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("length", [0.005, 0.05, 0.5])
def test_hysteresis_loss_of_a_loop_follows_the_law(length):
    level, amplitude = 0.3, 0.1
    result = bench(
        2,
        {"hysteresis_torque": level, "hysteresis_deflection": length, "max_deflection": 3.0},
        link=Sinusoid(amplitude=amplitude, frequency=1.0),
        references={"reference_1": 0.0},
        duration=20.0,
        substeps=1,
    )
    lost = column(result, "hysteresis_loss")
    assert lost[20_000] - lost[19_000] == pytest.approx(4.0 * level * (amplitude - length * tanh(amplitude / length)), rel=1e-6)
    assert np.diff(lost).min() >= -1e-15
    assert np.abs(column(result, "energy_residual")).max() < 2e-4 * lost[-1]
    # Far from the reversals, the hysteresis torque is +tau or -tau.
    q = column(result, "link_position")[19_000:]
    extra = column(result, "elastic_torque_1")[19_000:] + 10.0 * q
    if length < 0.01:
        assert extra.max() == pytest.approx(level, rel=1e-3)
        assert extra.min() == pytest.approx(-level, rel=1e-3)


@pytest.mark.parametrize("substeps", [3, 5])
@pytest.mark.parametrize(("actuator", "near"), [("sea", 2e-4), ("qbmove", 5e-5)])
def test_hysteresis_loss_does_not_depend_on_motor_substeps(actuator, near, substeps):
    """A link swings while its motors stand still."""
    references = {"equilibrium_position": 0.0, "stiffness_preset": 0.3}
    values = {"hysteresis_torque": 0.05, "hysteresis_deflection": 0.02}
    motors = (1, 2) if actuator == "qbmove" else (1,)
    values |= {f"controller_{i}_proportional": 400.0 for i in motors}
    found = []
    for motor_substeps in (1, substeps):
        result = run(
            chain(Body(actuator=actuator, mass=0.3, reach=0.1, inertia=2e-3)), mode=6, parameters=values, initial=[0.3],
            references={name: references[name] for name in list(references)[: len(motors)]}, duration=1.0, gravity=0.0,
            compiled=False, substeps=1, motor_substeps=motor_substeps,
        )  # fmt: skip
        found.append([column(result, name) for name in ("link_position", "hysteresis_loss")])
    (q, lost), (same, as_much) = found
    np.testing.assert_allclose(same, q, rtol=0.0, atol=near)
    assert as_much[-1] == pytest.approx(lost[-1], rel=2e-3)
    # Hysteresis dissipates most of the energy of the swing.
    assert np.ptp(q[-200:]) < 0.5 * np.ptp(q)


@pytest.mark.parametrize(("actuator", "springs"), [("sea", 1), ("qbmove", 2)])
def test_predicted_stiffness_includes_hysteresis_at_reversals(actuator, springs):
    robot, found = chain(Body(actuator=actuator, mass=0.3, reach=0.1, inertia=2e-3)), []
    for values in ({}, {"hysteresis_torque": 0.05, "hysteresis_deflection": 0.02}):
        result = run(
            robot,
            mode=3,
            parameters=values,
            references={"equilibrium_position": 0.2, **({"stiffness_preset": 0.2} if springs == 2 else {})},
            duration=0.01,
            compiled=False,
        )
        found.append(result.resolution.stiffness[0])
    assert found[1] - found[0] == pytest.approx(springs * 2.0 * 0.05 / 0.02)


# -- all of it, everywhere -----------------------------------------------------------------------------------------------


def all_on(name):
    """Values that enable every optional model of an actuator."""
    motors = range(1, ACTUATORS.get(name).motors + 1)
    values = {f"motor_{i}_{key}": value for i in motors for key, value in EVERYTHING.items()}
    return {**values, "hysteresis_torque": 0.02, "hysteresis_deflection": 0.05}


def full_run(name, mode, **how):
    """Run of a link that swings under gravity, with all optional models."""
    law = ACTUATORS.get(name)
    first, second = law.motor_references(0.3, law.typical_preset)
    second = law.typical_preset if law.adjuster else second
    references = {
        3: {"equilibrium_position": 0.3, "stiffness_preset": law.typical_preset},
        5: {"reference_1": first, "reference_2": second},
        7: {"motor_1_voltage": 3.0, "motor_2_voltage": second if law.adjuster else 3.0},
    }[mode]
    robot = rubbing(
        chain(Body(actuator=name, mass=0.3, reach=0.05, inertia=1e-3, damping=0.02, friction=0.01)),
        stribeck_friction=0.01,
        load_friction=0.05,
    )
    how = {"duration": 0.2, "compiled": False, **how}
    return run(robot, mode=mode, references=references, parameters=all_on(name), **how)


@pytest.mark.parametrize("mode", [3, 5, 7])
@pytest.mark.parametrize("name", ACTUATORS.names())
def test_all_optional_models_run_on_every_actuator(name, mode):
    runs = [full_run(name, mode, engine=engine) for engine in ENGINES_HERE]
    for result in runs:
        assert all(np.isfinite(values).all() for values in result.samples.values.values())
        assert np.diff(column(result, "hysteresis_loss")).min() >= -1e-15
        assert np.abs(column(result, "energy_residual")).max() < 1e-3
        assert ("motor_1_current" in result.samples.values) == (mode != 3)
    for quantity, values in runs[0].samples.values.items():
        assert values == pytest.approx(runs[-1].samples.values[quantity], rel=1e-7, abs=1e-9), quantity


def state_of(simulation):
    """State of a simulation: positions and velocities of links and motors."""
    seen = simulation.observe()
    names = ("link_position", "link_velocity", "motor_position", "motor_velocity")
    return [np.nan_to_num(getattr(seen, name)).tolist() for name in names]


def test_optional_models_may_be_enabled_between_runs():
    """The simulation loop was compiled without the models. A fit may increase a parameter from zero."""
    result = run(
        chain(Body(actuator="sea", inertia=1e-2)), mode=5, references={"reference_1": 0.3}, duration=0.1, compiled=False
    )
    for values in ({"hysteresis_torque": 0.1}, {"motor_1_stribeck_friction": 0.1}, {"stribeck_friction": 0.1}):
        ends = []
        for start in ({}, values):
            with Simulation(prepare(result.scenario, result.robot).vary({"joint_1": start}), compiled=False) as simulation:
                simulation.reset(parameters={"joint_1": values})
                simulation.advance_to(100)
                ends.append(state_of(simulation))
        assert ends[0] == ends[1]


# -- files ---------------------------------------------------------------------------------------------------------------

TAGS = "<stribeckFriction>0.1</stribeckFriction><stribeckVelocity>0.2</stribeckVelocity><loadFriction>0.05</loadFriction>"


def robot_with(joint="", block=""):
    """Robot with one joint. joint, block: XML tags of the joint and of its actuator."""
    text = chain(Body(actuator="qbmove")).text.replace("</robot>", f"{joint}</robot>").replace("</plugin>", f"{block}</plugin>")
    return read(text)


def test_optional_model_tags_are_read_and_written():
    robot = robot_with(f'<gazebo reference="joint_1">{TAGS}</gazebo>', "<mot_1_kt>0.05</mot_1_kt><hyst_tau>0.3</hyst_tau>")
    joint, values = robot.joint("joint_1"), robot.actuators[0].values()
    assert (joint.stribeck_friction, joint.stribeck_velocity, joint.load_friction) == (0.1, 0.2, 0.05)
    assert (values["motor_1_torque_constant"], values["motor_2_torque_constant"], values["hysteresis_torque"]) == (
        0.05,
        0.0,
        0.3,
    )
    changes = {
        "joint_1": {"stribeck_friction": 0.7, "load_friction": 0.2, "hysteresis_deflection": 0.03, "motor_2_resistance": 2.0}
    }
    for source in (robot, chain(Body(actuator="qbmove"))):
        again = read(edited_urdf(source.text.encode(), source, changes).decode())
        joint, values = again.joint("joint_1"), again.actuators[0].values()
        assert (joint.stribeck_friction, joint.load_friction) == (0.7, 0.2)
        assert (values["hysteresis_deflection"], values["motor_2_resistance"]) == (0.03, 2.0)


@pytest.mark.parametrize(
    ("joint", "block", "said"),
    [
        ('<gazebo reference="joint_1"><stribeckVelocity>0</stribeckVelocity></gazebo>', "", "must be larger than 0"),
        ('<gazebo reference="joint_1"><loadFriction>much</loadFriction></gazebo>', "", "loadFriction"),
        ("", "<mot_1_velStribeck>0</mot_1_velStribeck>", "must be larger than 0 rad/s"),
        ("", "<mot_2_R>-3</mot_2_R>", "must be at least 0 ohm"),
    ],
)
def test_invalid_model_parameters_are_refused(joint, block, said):
    with pytest.raises(RobotError, match=said):
        robot_with(joint, block)


@pytest.mark.parametrize(
    ("joint", "block", "said"),
    [
        ('<gazebo reference="joint_9"><loadFriction>0.1</loadFriction></gazebo>', "", "no such joint"),
        ("", "<mot_1_velStribeck>0.3</mot_1_velStribeck>", "no effect without motor_1_stribeck_friction"),
        ("", "<mot_2_R>3</mot_2_R><mot_2_gear>50</mot_2_gear>", "no effect without motor_2_torque_constant"),
        ("", "<mot_1_kt>0.1</mot_1_kt><mot_1_voltMax>12</mot_1_voltMax>", "no effect without motor_1_resistance"),
        ("", "<hyst_def>0.1</hyst_def>", "no effect without hysteresis_torque"),
    ],
)
def test_implausible_model_parameters_give_a_warning(joint, block, said):
    assert any(said in str(warning) for warning in warnings_of(robot_with(joint, block)))


def test_toolbox_stepping_warns_of_models_that_it_lacks():
    with pytest.raises(ScenarioError, match=r"cannot drive its motors: .*torque_constant.* must be larger than 0$"):
        run(chain(Body(actuator="sea")), mode=7, references={"motor_1_voltage": 1.0}, duration=0.1)
    result = run(
        chain(Body(actuator="sea")),
        mode=5,
        references={"reference_1": 0.1},
        duration=0.1,
        stepping="toolbox",
        parameters={"hysteresis_torque": 0.1, "motor_1_load_friction": 0.1},
    )
    said = " ".join(str(warning) for warning in result.warnings)
    assert "hysteresis_torque" in said
    assert "motor_1_load_friction" in said
    assert "hysteresis_loss" not in result.samples.values


@pytest.mark.parametrize("motor_substeps", [1, 3, 9])
def test_hysteresis_state_persists_while_motor_and_link_move_together(motor_substeps):
    """Motor and link move 3 rad together, a hundred times the hysteresis deflection, and the deflection stays constant."""
    parameters = {
        **FREE,
        "motor_1_inertia": 1e-3,
        "motor_1_damping": 0.5,
        "spring_stiffness": 30.0,
        "max_deflection": 3.0,
        "hysteresis_torque": 0.5,
        "hysteresis_deflection": 0.02,
    }
    moving = {"initial_velocities": {"joint_1": 3.0}, "initial_motor_velocities": {"joint_1": (3.0,)}}
    result = run(
        chain(Body(actuator="sea", mass=1e-3, reach=1e-3, inertia=1e3)), mode=4, gravity=0.0, duration=1.0, compiled=False,
        references={"motor_1_torque": 0.6 + 0.5 * 3.0}, parameters=parameters, substeps=1, motor_substeps=motor_substeps,
        **moving,
    )  # fmt: skip
    deflection = column(result, "motor_1_position") - column(result, "link_position")
    remembered = column(result, "elastic_torque_1") - 30.0 * deflection
    assert np.ptp(column(result, "link_position")[300:]) > 2.0
    assert remembered[300] > 0.2
    np.testing.assert_allclose(remembered[300:], remembered[300], atol=1e-3)
