"""A fit names the effect that its model lacks; recordings are from an independent integrator."""

from contextlib import ExitStack

import numpy as np
import pytest

from asrsim.identification import CAUSES, identify, task_of
from asrsim.identification.causes import unexplained_drives, wrong_controllers
from asrsim.identification.flexible import with_elastic_link
from asrsim.identification.problem import set_up
from asrsim.robot import load_robot
from asrsim.robot.dynamics import RobotModel
from support.identify_files import CHIRP, prepared, save, write
from support.identify_files import SEA as LAB
from support.identify_files import record as log_of
from support.odd_arm import drawn, record, true_effect
from support.paths import EXAMPLES
from support.soft_arm import SEA
from support.sticky_drive import LINK
from support.sticky_drive import drawn as sticky
from support.sticky_drive import record as stick

NAMED = {
    "backlash": "backlash of joint_1",
    "cubic spring": "a cubic term in the spring of joint_1",
    "second mode": "a second mode, such as an elastic link_1",
    "hysteresis": "hysteresis of the springs of joint_1",
    "stribeck": "static friction of joint_1",
    "torque limit": "a limit motor_1_max_torque of joint_1",
    "speed limit": "a limit motor_1_max_velocity of joint_1",
    "load": "a different mass of link_1",
    "late sensor": "a delay of joint_1.link_position",
    "spring damper": "a damper parallel to the springs of joint_1",
    "load friction": "friction that grows with the load of joint_1",
}


@pytest.mark.slow
@pytest.mark.parametrize("seed", [20, 21])
@pytest.mark.parametrize("effect", NAMED)
def test_the_effect_that_a_robot_has_is_named_first(tmp_path, effect, seed):
    scenario, recording, truth = record(effect, seed, tmp_path)
    found = identify(scenario, [recording], free=list(truth))
    assert not found.fits
    assert found.causes[0].startswith(NAMED[effect])


@pytest.mark.slow
def test_nothing_is_named_in_right_models(tmp_path):
    for seed in range(20, 26):
        scenario, recording, truth = record("", seed, tmp_path / str(seed))
        found = identify(scenario, [recording], free=list(truth))
        assert (found.fits, found.causes) == (True, ())


@pytest.mark.slow
@pytest.mark.parametrize("seed", [20, 21])
def test_a_derivative_gain_that_is_larger_than_the_robot_s_is_named(tmp_path, seed):
    """The motor's damping acts like the gain, and cannot be negative."""
    scenario, recording, truth = record("", seed, tmp_path)
    given = {"parameters.joint_1.controller_1_derivative": 1.5}
    found = identify(scenario, [recording], free=list(truth), overrides=given)
    assert not found.fits
    assert found.causes[0].startswith("a smaller derivative gain of the controller of joint_1")


@pytest.mark.slow
@pytest.mark.parametrize(("effect", "key"), [("backlash", "backlash"), ("cubic spring", "spring_cubic")])
def test_a_free_effect_is_identified(tmp_path, effect, key):
    """The intervals of the effect and of the spring contain the truth."""
    scenario, recording, truth = record(effect, 22, tmp_path)
    (true,) = drawn(effect, 22)[1].values()
    found = identify(scenario, [recording], free=[*truth, f"joint_1.{key}={0.8 * true}"])
    assert found.fits, found.misfit
    for name, value in ((f"joint_1.{key}", true), ("joint_1.spring_stiffness", truth["joint_1.spring_stiffness"])):
        one = found.find(name)
        assert one.low < value < one.high
        assert one.margin < 0.1


def test_an_elastic_link_has_the_inertia_of_the_rigid_link_and_its_own_frequency(tmp_path):
    """With the spring locked, the mass matrix is that of the rigid robot; the second body has the wanted frequency."""
    SEA.write(tmp_path)
    rigid = load_robot(tmp_path / "arm.urdf")
    elastic = with_elastic_link(rigid, "joint_1", 50.0)
    matrix = RobotModel(elastic).mass_matrix([0.0, 0.0])
    assert matrix[0, 0] == pytest.approx(RobotModel(rigid).mass_matrix([0.0])[0, 0], rel=1e-12)
    assert elastic.joint("joint_1_bend").spring_stiffness == pytest.approx(50.0**2 * matrix[1, 1], rel=1e-12)
    assert sum(link.mass or 0.0 for link in elastic.links) == pytest.approx(0.5)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(400, 405))
def test_adopted_static_friction_is_right_with_the_speed_at_which_it_fades(tmp_path, seed):
    """Both are unknown before: with the default speed, the model would not fit."""
    scenario, recording, truth = record("stribeck", seed, tmp_path)
    truth |= true_effect("stribeck", seed)
    found = identify(scenario, [recording], free=[key for key in truth if "stribeck" not in key], adopt=True)
    assert found.fits, found.misfit
    inside = [found.find(key).low < value < found.find(key).high for key, value in truth.items()]
    assert sum(inside) >= len(inside) - 1


@pytest.mark.slow
def test_a_second_mode_that_no_option_adds_is_explained_in_words(tmp_path):
    """The sentence says what to write in the robot file, and does not offer --adopt."""
    scenario, recording, truth = record("second mode", 23, tmp_path)
    (cause, *_) = identify(scenario, [recording], free=list(truth)).causes
    assert "into two links" in cause
    assert "<springStiffness>" in cause
    assert "--adopt" not in cause


@pytest.mark.parametrize("effect", ["backlash", pytest.param("torque limit", marks=pytest.mark.slow)])
def test_an_adopted_cause_is_identified_and_the_springs_are_right(tmp_path, effect):
    """Without the cause, the stiffness is only weakly known; with it, the model fits and the intervals contain the truth."""
    scenario, recording, truth = record(effect, 23, tmp_path)
    (true,) = drawn(effect, 23)[1].values()
    found = identify(scenario, [recording], free=list(truth), adopt=True)
    assert found.fits, found.misfit
    assert not found.causes
    key = {"backlash": "joint_1.backlash", "torque limit": "joint_1.motor_1_max_torque"}[effect]
    assert any(text.startswith(f"{key}: adopted") for text in found.remarks)
    for name, value in ((key, true), ("joint_1.spring_stiffness", truth["joint_1.spring_stiffness"])):
        one = found.find(name)
        assert one.low < value < one.high
        assert one.verdict == "identified"


def test_a_recorded_torque_is_proposed_if_the_controller_is_another_one(tmp_path):
    """A link of 0.009 kg m^2 under its recorded torque; the goal says little about its motion."""
    time = np.arange(0.0, 2.0, 0.005)
    place = 0.3 * np.sin(9.0 * time) + 0.1 * np.sin(17.0 * time)
    torque = -0.009 * (24.3 * np.sin(9.0 * time) + 28.9 * np.sin(17.0 * time))
    columns = {"time [s]": time, "joint_1.reference_1 [rad]": 0.1 * np.sin(2.0 * time), "joint_1.link_position [rad]": place}
    with ExitStack() as stack:
        problem = prepared(stack, tmp_path, {**columns, "joint_1.link_torque [N m]": torque}, ["joint_1.damping"], mode=1)
        (text,) = wrong_controllers(problem, np.zeros(len(problem.layout)))
    maps = "joint_1.link_torque [N m]=joint_1.reference_1", "joint_1.reference_1 [rad]=ignore"
    assert text.endswith(f"(--mode 0 --map '{maps[0]}' --map '{maps[1]}')")


@pytest.mark.slow
def test_a_spring_that_saturates_and_a_zero_of_a_command_are_named(tmp_path):
    """A simulated spring of 4 N m/rad whose torque stays constant beyond 0.03 rad; a torque that is 0.03 N m too small."""
    chirp = f"{{equilibrium_position: {CHIRP}}}"
    limited = write(tmp_path, "true", {**LAB, "tags": "<spring_k>4.0</spring_k><max_def>0.03</max_def>"}, chirp)
    free = ["joint_1.spring_stiffness", "joint_1.damping"]
    found = identify(write(tmp_path, "lab", LAB), [log_of(limited, tmp_path / "a.csv")], free=free)
    assert found.causes[0].startswith("a limit max_deflection of joint_1 (0.03")
    time = np.arange(0.0, 3.0, 1e-3)
    place = 0.4 * (1.0 - np.cos(5.0 * time)) + 1e-4 * np.random.default_rng(0).normal(size=len(time))
    moved = 0.4 * (0.009 * 25.0 * np.cos(5.0 * time) + 0.05 * 5.0 * np.sin(5.0 * time))
    heading = "time [s],joint_1.reference_1 [N m],joint_1.link_position [rad]"
    table = save(tmp_path / "b.csv", heading, time, moved - 0.03, place)
    found = identify(write(tmp_path, "lab", {**LAB, "mode": 0}), [table], free=["joint_1.damping", "link_1.izz"])
    assert found.causes[0].startswith("a zero offset of joint_1.reference_1 (-30"), found.causes


def test_the_order_of_two_recordings_does_not_change_what_is_proposed(tmp_path):
    """The second recording is three times as large and twice as fast, and only one of them shows the spring's torque. A limit
    begins at what the robot reaches in any recording.
    """
    time, tables = np.arange(0.0, 0.5, 0.005), []
    for name, size, rate, torque in (
        ("small", 0.1, 9.0, "joint_1.elastic_torque_1 [N m]"),
        ("large", 0.3, 18.0, "unused [N m]"),
    ):
        goal = size * np.sin(rate * time) ** 3
        heading = f"time [s],joint_1.reference_1 [rad],joint_1.link_position [rad],{torque}"
        tables.append(save(tmp_path / f"{name}.csv", heading, time, goal, 0.9 * goal, 0.4 * goal))
    numbers = {**LAB, "tags": "<spring_k>4.0</spring_k><max_def>1.0</max_def>"}
    scenario = write(tmp_path, "lab", numbers, duration=0.5)
    scenario.write_text(f"{scenario.read_text()}compiled: false\n")
    proposed = []
    for recordings in ([tables[0]], tables, tables[::-1]):
        with ExitStack() as stack:
            problem = set_up(task_of(scenario, recordings, free=["joint_1.damping"]), stack).problem
            x = np.zeros(len(problem.layout))
            every = [one for name in CAUSES for one in CAUSES.get(name).extensions(problem, x)]
        proposed.append({one.text: [one.elastic, *((o.key, o.start, o.low, o.high) for o in one.parameters)] for one in every})
    alone, one_way, other_way = proposed
    assert one_way == other_way
    _, (_, first, _, _) = alone["a limit max_deflection of joint_1"]
    _, (_, both, _, _) = one_way["a limit max_deflection of joint_1"]
    assert both > 2.0 * first


def test_a_link_that_slides_is_not_elastic_but_the_next_link_can_be(tmp_path):
    scenario = write(tmp_path, "lab", LAB, duration=0.5)
    robot = tmp_path / "lab.urdf"
    text = robot.read_text()
    cart = (
        '<joint name="cart" type="prismatic"><parent link="world"/><child link="base"/><axis xyz="1 0 0"/>'
        '<limit lower="-1" upper="1" effort="9" velocity="9"/></joint><link name="base"><inertial><mass value="2"/>'
        '<inertia ixx="1" iyy="1" izz="1"/></inertial></link>'
    )
    text = text.replace('<parent link="world"/>', '<parent link="base"/>')
    robot.write_text(text.replace('<link name="world"/>', f'<link name="world"/>{cart}'))
    scenario.write_text(f"{scenario.read_text()}compiled: false\n")
    time = np.arange(0.0, 0.5, 0.005)
    heading = "time [s],joint_1.reference_1 [rad],cart.link_position [m],joint_1.link_position [rad]"
    goal = 0.1 * np.sin(20.0 * time) ** 3
    table = save(tmp_path / "a.csv", heading, time, goal, 0.01 * np.sin(13.0 * time), 0.9 * goal)
    with ExitStack() as stack:
        problem = set_up(task_of(scenario, [table], free=["joint_1.damping"]), stack).problem
        x = np.zeros(len(problem.layout))
        texts = [one.text for name in CAUSES for one in CAUSES.get(name).extensions(problem, x)]
    assert [text for text in texts if "elastic" in text] == ["a second mode, such as an elastic link_1,"]


@pytest.mark.slow
def test_an_equally_likely_cause_is_named_beside_the_suspected_one(tmp_path):
    """The torque of a pendulum is 0.8 times the recorded one. A heavier link with more damping and inertia moves equally."""
    lab = write(tmp_path, "lab", {**LAB, "mode": 0}, f"{{link_torque: {CHIRP}}}")
    robot = tmp_path / "lab.urdf"
    text = robot.read_text().replace('xyz="0 0 1"', 'xyz="0 1 0"').replace("<mass", '<origin xyz="0 0 -0.1"/><mass')
    robot.write_text(text)
    table = log_of(lab, tmp_path / "a.csv")
    rows = np.loadtxt(table, delimiter=",", skiprows=1)
    rows[:, 1] *= 1.25
    save(table, "time [s],joint_1.reference_1 [N m],joint_1.link_position [rad]", *rows.T)
    (text, *_) = identify(lab, [table], free=["joint_1.damping", "link_1.iyy"]).causes
    suspected, rivals = text.split("; equally likely instead of ")
    scale = next(part for part in (suspected, rivals) if "a different scale of joint_1.reference_1" in part)
    mass = next(part for part in (suspected, rivals) if "a different mass of link_1" in part)
    assert float(scale.split("joint_1.reference_1.gain=")[1].split(")")[0]) == pytest.approx(0.8, rel=0.02)
    assert float(mass.split("link_1.mass=")[1].split(")")[0]) == pytest.approx(0.625, rel=0.02)


DRIVE = ("joint_1.motor_1_inertia", "joint_1.motor_1_damping", "joint_1.motor_1_friction_torque")
"""Free parameters of a motor under voltage."""


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 7])
def test_short_predictions_do_not_count_if_only_a_free_simulation_explains_the_recording(tmp_path, seed):
    """A motor sticks between steps. Estimates from short predictions would explain 94 and 60 %, with stiff bristles of the
    friction that the motor does not have.
    """
    scenario, recording = stick(tmp_path, seed)
    maps = ["drive=joint_1.reference_1", "hub=joint_1.motor_1_position"]
    found = identify(scenario, [recording], mapping=maps, free=[*DRIVE, "joint_1.reference_1.offset"])
    assert found.explained > 0.99
    assert found.accepted
    assert not any(one.key.endswith("friction_stiffness") for one in found.estimates)
    assert found.causes[0].startswith("a delay of the commands (")


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 7])
def test_a_zero_and_a_late_command_are_found_together(tmp_path, seed):
    """Alone, neither explains the recording, and falling friction imitates both; the motor has all three. A voltage without a
    unit has that of its mode.
    """
    (scenario, recording), (sizes, _) = stick(tmp_path, seed), sticky(seed)
    maps = ["drive=joint_1.reference_1", "hub=joint_1.motor_1_position"]
    found = identify(scenario, [recording], mapping=maps, free=list(DRIVE), adopt=True)
    assert found.explained > 0.99
    for name in ("offset", "delay"):
        key = f"joint_1.reference_1.{name}"
        assert found.find(key).value == pytest.approx(sizes[key], rel=0.3)
    assert found.find("joint_1.reference_1.offset").unit == "V"


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 5])
def test_a_cause_that_shows_after_another_one_is_adopted_too(tmp_path, seed):
    """A zero of the amplifier hides a delay; with the zero alone, the inertia would be three times too large."""
    scenario, recording = stick(tmp_path, seed)
    maps = ["drive=joint_1.reference_1", "hub=joint_1.motor_1_position"]
    found = identify(scenario, [recording], mapping=maps, free=DRIVE, adopt=True)
    assert found.fits, found.misfit
    assert any(text.startswith("joint_1.reference_1.offset, joint_1.reference_1.delay: adopted") for text in found.remarks)
    truth, _ = sticky(seed)
    for key, part in (
        ("joint_1.motor_1_inertia", LINK),
        ("joint_1.reference_1.offset", 0.0),
        ("joint_1.reference_1.delay", 0.0),
    ):
        one = found.find(key)
        assert one.low < truth[key] - part < one.high, key


def test_a_drive_that_does_not_explain_its_motor_is_left_out_on_advice(tmp_path):
    """A motor moves against its recorded torque; its link follows. The command that the advice ignores is the recorded one."""
    time = np.arange(0.0, 2.0, 0.005)
    motor = 0.3 * np.sin(9.0 * time)
    columns = {
        "time [s]": time,
        "joint_1.reference_1 [N m]": 0.05 * np.cos(2.0 * time),
        "joint_1.motor_1_position [rad]": motor,
    }
    with ExitStack() as stack:
        free = ["joint_1.spring_stiffness"]
        alone = prepared(stack, tmp_path, columns, free, mode=4)
        assert not list(unexplained_drives(alone, np.zeros(len(alone.layout))))
        linked = prepared(
            stack, tmp_path, {**columns, "joint_1.link_position [rad]": 0.3 * np.sin(9.0 * time - 0.1)}, free, mode=4
        )
        (text,) = unexplained_drives(linked, np.zeros(len(linked.layout)))
    assert text.endswith("(--map 'joint_1.reference_1 [N m]=ignore')")


def test_a_limit_is_that_of_every_motor_of_its_joint_whatever_the_joint_is_called(tmp_path):
    """The number of the motor may also stand in the name of the joint."""
    robot = (EXAMPLES / "urdf" / "dof1_qbmove.urdf").read_text().replace("joint_1", "motor_1_joint")
    (tmp_path / "arm.urdf").write_text(robot)
    (tmp_path / "s.yaml").write_text("robot: arm.urdf\nduration: 1\nmodes: 5\n")
    time = np.arange(0.0, 1.0, 0.01)
    names = ("link_position", "reference_1", "reference_2")
    header = ",".join(["time", *(f"motor_1_joint.{name} [rad]" for name in names)])
    np.savetxt(
        tmp_path / "a.csv", np.column_stack([time, *[0.3 * np.sin(6.0 * time)] * 3]), delimiter=",", header=header, comments=""
    )
    with ExitStack() as stack:
        problem = set_up(task_of(tmp_path / "s.yaml", [tmp_path / "a.csv"], free=["motor_1_joint.damping"]), stack).problem
        found = [*CAUSES.get("robot").extensions(problem, np.zeros(len(problem.layout)))]
    (limit,) = [one for one in found if one.text.startswith("a limit motor_1_max_torque")]
    assert [(tie.key, tie.to) for tie in limit.ties] == [
        ("motor_1_joint.motor_2_max_torque", "motor_1_joint.motor_1_max_torque")
    ]


@pytest.mark.slow
@pytest.mark.parametrize("effect", ["backlash", "stribeck", "second mode"])
def test_a_model_without_the_effect_of_the_robot_does_not_fit_few_samples(tmp_path, effect):
    """At 50 Hz, the motion of 6 Hz is nearly as rough as noise."""
    scenario, recording, truth = record(effect, 20, tmp_path, rate=50.0)
    assert not identify(scenario, [recording], free=list(truth)).fits


@pytest.mark.slow
@pytest.mark.parametrize("held", [True, False])
@pytest.mark.parametrize("rate", [50.0, 100.0])
def test_held_commands_are_told_from_late_ones(tmp_path, rate, held):
    """A delay of half a sampling interval would imitate a held command, with other numbers of the robot."""
    scenario, recording, truth = record("", 22, tmp_path, rate=rate, held=held)
    found = identify(scenario, [recording], free=[*truth, "joint_1.reference_1.delay"])
    assert found.fits
    assert abs(found.find("joint_1.reference_1.delay").value) < 1e-3
    for key in ("joint_1.spring_stiffness", "joint_1.motor_1_inertia", "link_1.iyy"):
        assert found.find(key).value == pytest.approx(truth[key], rel=0.01)


@pytest.mark.slow
def test_an_unstated_pre_sliding_stiffness_widens_the_intervals(tmp_path):
    """Link only: friction of the motor is known from its effect on the link, which depends on the bristles."""
    scenario, recording, truth = record("", 22, tmp_path, rate=100.0)
    stated = {"parameters.joint_1.motor_1_friction_stiffness": 1000.0}
    options = {"free": list(truth), "mapping": ["joint_1.motor_1_position [rad]=ignore"]}
    wide, narrow = (identify(scenario, [recording], overrides=one, **options) for one in ({}, stated))
    widths = [[one.find(key).margin for key in ("joint_1.motor_1_damping", "joint_1.damping")] for one in (wide, narrow)]
    assert (np.array(widths[0]) > 1.02 * np.array(widths[1])).all(), widths
