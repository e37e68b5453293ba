"""What columns are by their names alone: certain ones are taken, doubtful ones are asked about, whatever stands beside them."""

import random
import re

import numpy as np
import pytest

from asrsim.actuators import MODES
from asrsim.errors import RecordingError
from asrsim.recordings import read_recording
from asrsim.recordings.matching import wrong_unit
from asrsim.recordings.units import split_header
from asrsim.robot import load_robot, with_overrides
from asrsim.scenario.recording_plan import make_plan

TIME = np.arange(40) * 0.01


def read(folder, names, joints=None):
    table = np.column_stack([TIME, *(np.sin(3 * TIME + i) for i in range(len(names)))])
    path = folder / "lab.csv"
    np.savetxt(path, table, delimiter=";", header=";".join(["time", *names]), comments="", fmt="%.9g")
    return read_recording(path, joints=joints)


CERTAIN = {
    "q1": "link_position", "dq1": "link_velocity", "tau1": "link_torque", "Joint 1 position (rad)": "link_position",
    "velocity": "link_velocity", "effort": "link_torque", "q_meas_1": "link_position", "qdes1": "reference_1",
    "q_ref [deg]": "reference_1", "position_command_rad": "reference_1", "tau_ref [N m]": "reference_1",
    "motor_position": "motor_1_position", "Hubangle (rad)": "motor_1_position",
    "hub1_rad": "motor_1_position", "tip_deflection1_rad": "deflection", "stiffness": "stiffness",
    "theta_eq": "equilibrium_position", "tau_ext": "external_torque", "elastic_torque": "elastic_torque_1",
    "position_error_rad": "position_error", "force [N]": "link_torque", "Axis 1 [deg]": "link_position",
    "joint_1.motor_2_velocity": "motor_2_velocity", "dQ1": "link_velocity", "error.positions[0]": "position_error",
}  # fmt: skip


@pytest.mark.parametrize("name", CERTAIN)
def test_a_plain_name_is_taken_alone_and_beside_any_other(tmp_path, name):
    for others in ([], ["theta1", "sampling_rate", "q9"]):
        assert read(tmp_path, [name, *others]).channels[name].quantity == CERTAIN[name]


@pytest.mark.parametrize(
    "name",
    ["sampling_rate", "eff", "torque_enable", "ankle_moment", "pos_m", "pos_l", "theta1", "qd1", "q_d", "q1_sim", "force",
     "motor_2_velocity", "reference_1", "encoder_1", "pose.position.x", "joint2", "rpm", "left_q1", "hip_pos", "tau_m1",
     "q\u0307_1", "q1'", "q*",
     "covariance.position[0]", "output.effort[0]", "/arm/limits/position", "predicted.joint_1.position",
     "Winkel [deg]", "q1 [counts]", "q1 [furlong]"],
)  # fmt: skip
def test_a_doubtful_name_is_asked_about_and_not_used(tmp_path, name):
    recording = read(tmp_path, ["q2", name])
    assert recording.channels[name].quantity is None
    assert name in [column.source for column in recording.asked]
    (problem,) = [one for one in recording.findings if one.code == "asked"]
    assert name in str(problem.key)
    assert f"--map '{name}=" in str(problem.hint)


@pytest.mark.parametrize("name", ["current", "temperature", "pwm", "voltage_V", "status", "command_valid"])
def test_what_no_joint_has_is_not_asked_about(tmp_path, name):
    recording = read(tmp_path, ["q1", name])
    assert recording.channels[name].quantity is None
    assert recording.asked == ()


@pytest.mark.parametrize("name", ["tool.position[1]", "/imu/angular_velocity[1]", "ee_pos_1", "tcp.velocity1"])
def test_the_components_of_a_vector_of_a_body_are_no_joints(tmp_path, name):
    recording = read(tmp_path, [name, "q1"], None)
    assert recording.channels[name].quantity is None
    assert recording.channels["q1"].joint == "joint_1"


@pytest.mark.parametrize("name", ["cartesian_controller.joint_position[1]", "/world/arm/joint_state.position[1]"])
def test_numbers_of_joints_count_joints_beside_the_word_for_a_body(tmp_path, name):
    channel = read(tmp_path, [name, "dq1"], None).channels[name]
    assert (channel.joint, channel.quantity) == ("joint_1", "link_position")


def test_a_name_that_states_the_joint_precedes_one_that_numbers_it(tmp_path):
    recording = read(tmp_path, ["position[1]", "joint_1.position"], None)
    assert recording.channels["joint_1.position"].quantity == "link_position"
    assert recording.channels["position[1]"].quantity is None
    assert [problem.code for problem in recording.findings] == ["second-column"]


@pytest.mark.parametrize(
    ("names", "joints", "expected"),
    [
        (["q1", "q2"], ["shoulder", "elbow"], ["shoulder", "elbow"]),
        (["q1", "q2"], ["j2", "j1"], ["j1", "j2"]),
        (["q[0]", "q[1]"], ["shoulder", "elbow"], ["shoulder", "elbow"]),
        (["elbow_pos", "shoulder.pos"], ["shoulder", "elbow"], ["elbow", "shoulder"]),
        (["Elbow pos [deg]", "shoulder_vel"], ["shoulder", "elbow"], ["elbow", "shoulder"]),
        (["/joint_states/elbow/position"], ["shoulder", "elbow"], ["elbow"]),
        (["position"], ["elbow"], ["elbow"]),
        (["joint_1.reference_1", "a1.motor_2_position"], ["a1", "a2"], ["joint_1", "a1"]),
        (["run.q1"], None, ["joint_1"]),
        (["elbow/position"], None, ["elbow"]),
    ],
)
def test_names_and_numbers_say_which_joint_it_is(tmp_path, names, joints, expected):
    recording = read(tmp_path, names, joints)
    assert [recording.channels[name].joint for name in names] == expected
    assert recording.asked == ()


@pytest.mark.parametrize(
    ("names", "joints"),
    [
        (["position"], ["shoulder", "elbow"]),
        (["q0", "q1"], ["shoulder", "elbow"]),
        (["q1"], ["joint_0", "joint_1"]),
        (["q3"], ["a", "b"]),
    ],
)
def test_a_number_that_may_count_otherwise_is_asked_about(tmp_path, names, joints):
    assert [column.source for column in read(tmp_path, names, joints).asked] == names


def test_columns_of_one_name_are_all_asked_about(tmp_path):
    recording = read(tmp_path, ["Position#2", "Position", "Position", "dq1"])
    assert [column.source for column in recording.asked] == ["Position#2", "Position", "Position#2#2"]
    assert recording.channels["dq1"].quantity == "link_velocity"


@pytest.mark.parametrize(
    ("header", "name", "si", "factor"),
    [
        ("q1 [deg]", "q1", "rad", np.pi / 180), ("q1_deg", "q1", "rad", np.pi / 180), ("q_deg_1", "q_1", "rad", np.pi / 180),
        ("q_deg[0]", "q[0]", "rad", np.pi / 180),
        ("t / ms", "t", "s", 1e-3), ("tau1/mNm", "tau1", "N m", 1e-3), ("dq rad/s", "dq", "rad/s", 1.0),
        ("velocity_rad_s", "velocity", "rad/s", 1.0), ("vel_deg_per_s", "vel", "rad/s", np.pi / 180),
        ("w (RPM)", "w", "rad/s", np.pi / 30), ("torque [N-m]", "torque", "N m", 1.0), ("tau (N\u00b7m)", "tau", "N m", 1.0),
        ("torque [lbf-ft]", "torque", "N m", 1.3558179483), ("position_m", "position", "m", 1.0), ("t_min", "t", "s", 60.0),
        ("time [h]", "time", "s", 3600.0), ("pos [deg] left", "pos left", "rad", np.pi / 180),
        ("n [1/min]", "n", "rad/s", np.pi / 30), ("[deg] q1", "q1", "rad", np.pi / 180),
        ("q1 in deg", "q1", "rad", np.pi / 180), ("time in s", "time", "s", 1.0),
        ("theta_m rad", "theta_m", "rad", 1.0), ("tau_m_Nm", "tau_m", "N m", 1.0),
        ("angle \u00b0", "angle", "rad", np.pi / 180), ("q1 [gon]", "q1", "rad", np.pi / 200), ("TAU [NM]", "TAU", "N m", 1.0),
        ("rate (1/s)", "rate", "Hz", 1.0), ("dq_rad/s", "dq", "rad/s", 1.0), ("t_1/s", "t_1", "s", 1.0),
    ],
)  # fmt: skip
def test_a_unit_is_found_where_headers_state_it(header, name, si, factor):
    found, unit = split_header(header)
    assert unit is not None
    assert (found, unit.si) == (name, si)
    assert unit.factor == pytest.approx(factor, rel=1e-9)


@pytest.mark.parametrize(
    "header",
    [
        "position [1]",
        "pos_m",
        "theta_m",
        "tau_s",
        "q_min",
        "q[1]",
        "torque_S",
        "sampling_rate",
        "a/b",
        "q1 (left)",
        "/arm/state/h",
        "tau [MNm]",
        "q1 [Mdeg]",
        "v [km/h]",
        "v_km/h",
        "v ft/s",
        "q1 [grad]",
    ],
)
def test_a_letter_of_a_name_is_not_a_unit(header):
    assert split_header(header) == (header, None)


@pytest.mark.parametrize("name", ["q1 [grad]", "q1_grad"])
def test_a_unit_that_may_be_two_is_asked_about(tmp_path, name):
    (column,) = read(tmp_path, [name]).asked
    assert column.question == "its unit may be deg or gon"
    with pytest.raises(RecordingError, match=r"its unit may mean several units; choose from deg, gon"):
        read_recording(tmp_path / "lab.csv", mapping=[f"{name}=joint_1.link_position"])
    with pytest.raises(RecordingError, match=r"may mean several units.*choose from deg, gon"):
        read_recording(tmp_path / "lab.csv", mapping=[f"{name}=joint_1.link_position [grad]"])


def test_a_velocity_in_degrees_is_one_in_degrees_a_second(tmp_path):
    column = read(tmp_path, ["dq1 [deg]"]).channels["dq1 [deg]"]
    assert column.unit == "rad/s"
    assert column.values[0] == pytest.approx(0.0)
    assert column.conversion.startswith("deg/s -> rad/s")


def test_whole_numbers_beyond_what_a_joint_turns_are_asked_about(tmp_path):
    path = tmp_path / "lab.csv"
    path.write_text("time,q1\n" + "".join(f"{0.01 * i:.2f},{i * 40}\n" for i in range(40)))
    (column,) = read_recording(path).asked
    assert "counts or degrees" in column.origin


COMMANDS = {
    "N m": ["knee_tau_des", "knee_effort_command", "torque_cmd_knee", "desiredTorque_knee", "knee.torque_setpoint", "tau_ref",
            "moment_ref", "knee_motor_torque_cmd", "knee.command.effort", "/knee_effort_controller/command",
            "/knee/effort_controller/cmd/data"],
    "A": ["knee_current_cmd", "target_current_knee", "cur_des", "knee_motor_current_setpoint", "i_des", "knee_cmd_A"],
    "V": ["knee_voltage_command", "volts_cmd", "cmdVoltage", "motor_voltage_ref"],
    "N": ["force_command_knee"],
    "": ["knee_cmd"],
    "rad": ["q_des_knee", "/knee/desired/positions", "position_setpoint", "/knee/effort_interface/position_command"],
}  # fmt: skip
"""Names of commands by the unit of the kind that they state."""


@pytest.mark.parametrize(("unit", "name"), [(unit, name) for unit, names in COMMANDS.items() for name in names])
def test_a_command_keeps_the_kind_that_its_name_states(tmp_path, unit, name):
    column = read(tmp_path, [name, "knee_pos"], ["knee"]).channels[name]
    assert (column.quantity, column.unit) == ("reference_1", unit)


@pytest.mark.parametrize(("unit", "name"), [(unit, names[0]) for unit, names in COMMANDS.items()])
def test_a_command_of_another_kind_than_the_mode_takes_is_not_compared(tmp_path, unit, name):
    recording = read(tmp_path, [name, "knee_pos"], ["knee"])
    for mode, fitting in {0: "N m", 1: "", 4: "N m", 6: "", 7: "V", 8: "A"}.items():
        refused = wrong_unit(recording.channels[name], "knee", prismatic=unit == "N", mode=mode)
        fits = {"N": "N m", "rad": ""}.get(unit, unit)
        assert (refused is None) == (unit == "" or fitting == fits)


@pytest.mark.parametrize(
    "name",
    ["cmd_eff", "theta_des", "u_cmd", "knee_des_vel", "knee_dq_des", "knee_pwm_cmd", "tau_d_knee",
     "cmd [%]", "v_ref", "cmd [rad/s]", "q_ref [rpm]", "tau_des [rad]",
     "current_ref [V]"],
)  # fmt: skip
def test_a_command_of_a_doubtful_kind_is_asked_about(tmp_path, name):
    recording = read(tmp_path, [name, "knee_pos"], ["knee"])
    assert recording.channels[name].quantity is None
    assert [column.source for column in recording.asked] == [name]


@pytest.mark.parametrize(
    ("name", "mode", "reference"),
    [
        ("knee_tau_des", 4, "motor_1_torque"),
        ("knee_current_cmd", 8, "motor_1_current"),
        ("knee_voltage_command", 7, "motor_1_voltage"),
        ("knee_cmd", 3, "equilibrium_position"),
    ],
)
def test_a_command_is_played_in_a_mode_that_takes_its_kind(tmp_path, tiny, name, mode, reference):
    recording = read(tmp_path, [name.replace("knee", "elbow"), "elbow_pos"], ["elbow"])
    plan = make_plan(load_robot(tiny.robot), recording, step=0.001)
    assert [block.mode for block in plan.robot.actuators] == [mode]
    assert [MODES[mode].references[one.slot] for one in plan.played] == [reference]


def test_a_mapped_command_keeps_the_kind_of_its_name(tmp_path):
    table = np.column_stack([TIME, np.sin(3 * TIME)])
    np.savetxt(tmp_path / "lab.csv", table, delimiter=",", header="time,knee_tau_des", comments="")
    mapped = read_recording(tmp_path / "lab.csv", mapping=["knee_tau_des=knee.reference_1"], joints=["knee"])
    assert mapped.channels["knee_tau_des"].unit == "N m"
    stated = read_recording(tmp_path / "lab.csv", mapping=["knee_tau_des=knee.reference_1 [deg]"], joints=["knee"])
    assert stated.channels["knee_tau_des"].unit == "rad"


SPOKEN = {
    "rad": ["pos", "position", "angle", "q"],
    "N m": ["tau", "torque", "effort", "moment"],
    "A": ["current", "cur", "i", "iq"],
    "V": ["voltage", "volts"],
    "velocity": ["vel", "velocity", "dq", "speed", "qd"],
    "PWM": ["pwm", "duty"],
    "acceleration": ["acc", "ddq"],
    "one of": ["u", "v", "theta", "eff"],
}
"""Words of this test by the unit of the command that they mean; the last four rows can be played by no mode, or are unclear."""
OWNERS = ["knee", "left_knee", "LeftElbow", "hip2", "j", "joint_1", "torque_arm", "current_joint", "ankle_pitch"]


def composed(draw: random.Random, word: str, joint: str, extra: str) -> str:
    """Name of a command: joint, kind, a word for a command and perhaps another word, in any order and any style."""
    order = draw.choice(["cmd", "ref", "des", "desired", "command", "target", "setpoint", "goal"])
    parts = [word, order] if draw.random() < 0.5 else [order, word]
    style = draw.choice(["_", ".", " ", "/", "camel", "glued"])
    if style == "glued" and len(word) > 1:
        parts = ["".join(parts)]
    parts += [extra] if extra else []
    parts = [joint, *parts] if draw.random() < 0.6 else [*parts, joint]
    if style == "camel":
        humps = [hump for part in parts for hump in part.split("_")]
        return humps[0].lower() + "".join(hump[:1].upper() + hump[1:] for hump in humps[1:])
    name = {"glued": "_"}.get(style, style).join(parts)
    return name.upper() if draw.random() < 0.15 else name


@pytest.mark.parametrize("seed", range(4))
def test_the_kind_of_a_composed_command_is_kept_or_asked_about(tmp_path, seed):
    draw = random.Random(seed)
    joints = draw.sample(OWNERS, 3)
    wanted: dict[str, tuple[str, str, bool]] = {}
    for _ in range(120):
        unit = draw.choice([*SPOKEN])
        joint, extra = draw.choice(joints), draw.choice(["", "", "", "filtered", "motor", "link", "out"])
        wanted[composed(draw, draw.choice(SPOKEN[unit]), joint, extra)] = unit, joint, extra in ("filtered", "out")
    kept = []
    for name, (unit, joint, strange) in wanted.items():
        column = read(tmp_path, [name], joints).channels[name]
        if column.quantity is None:
            assert column.question, f"{name}: {column.origin}"
            kept.append(strange or unit not in ("rad", "N m", "A", "V"))
        else:
            assert (column.quantity, column.unit, column.joint) == ("reference_1", unit, joint), name
            kept.append(True)
    assert np.mean(kept) > 0.9  # asking is always true, but most names are plain


def test_a_question_about_a_command_states_kind_and_map(tmp_path):
    recording = read(tmp_path, ["knee_pos", "knee_des_vel", "knee_pwm_cmd"], ["knee"])
    (problem,) = [one for one in recording.findings if one.code == "asked"]
    assert str(problem.key) == "knee_des_vel, knee_pwm_cmd"
    assert "a velocity" in problem.message
    assert "a PWM duty" in problem.message
    assert "--map 'knee_des_vel=knee.reference_1 [unit]'" in str(problem.hint)


@pytest.mark.parametrize(
    ("name", "mapping"),
    [
        ("elbow_force_cmd", []),
        ("elbow_cmd_N", []),
        ("elbow_des_vel", ["elbow_des_vel=elbow.reference_1"]),
        ("elbow_pwm_cmd", ["elbow_pwm_cmd=elbow.reference_1"]),
        ("elbow_x", ["elbow_x=elbow.reference_1 [%]"]),
    ],
)
def test_a_command_that_no_mode_takes_is_not_played(tmp_path, tiny, name, mapping):
    read(tmp_path, [name, "elbow_pos"])
    recording = read_recording(tmp_path / "lab.csv", mapping=mapping or None, joints=["elbow"])
    with pytest.raises(RecordingError, match=re.escape(f"--map '{name}=elbow.reference_1 [unit]'")):
        make_plan(load_robot(tiny.robot), recording, step=0.001)


def test_a_position_that_is_mapped_as_a_command_stays_a_position(tmp_path, tiny):
    read(tmp_path, ["elbow_pos_des", "elbow_pos"])
    recording = read_recording(tmp_path / "lab.csv", mapping=["elbow_pos_des=elbow.reference_1"], joints=["elbow"])
    plan = make_plan(with_overrides(load_robot(tiny.robot), modes={"*": 4}), recording, step=0.001)
    assert [block.mode for block in plan.robot.actuators] == [6]


def test_a_joint_starts_at_the_first_position_of_its_link_or_else_of_springs_motor_or_command(tmp_path, tiny):
    names = [f"elbow.{name}" for name in ("link_position", "equilibrium_position", "motor_1_position", "reference_1")]
    for missing in range(len(names)):
        places = 0.1 * np.arange(1, 5)[missing:]
        table = np.column_stack([TIME, places + np.sin(3 * TIME)[:, None]])
        header = ",".join(["time", *(f"{name} [rad]" for name in names[missing:])])
        np.savetxt(tmp_path / "lab.csv", table, delimiter=",", header=header, comments="")
        plan = make_plan(load_robot(tiny.robot), read_recording(tmp_path / "lab.csv", joints=["elbow"]), step=0.001)
        assert plan.initial == {"elbow": pytest.approx(places[0])}


def test_of_two_commands_of_a_joint_the_position_is_played(tmp_path):
    recording = read(tmp_path, ["knee_i_cmd", "knee_q_cmd"], ["knee"])
    assert recording.column("knee", "reference_1").source == "knee_q_cmd"
    assert [one.key for one in recording.findings if one.code == "second-column"] == ["knee_i_cmd"]


def test_a_joint_of_one_letter_is_found(tmp_path):
    recording = read(tmp_path, ["j_reference_1", "j_pos", "kPos"], ["j", "k"])
    assert [column.meaning for column in recording.channels.values()] == ["j.reference_1", "j.link_position", "k.link_position"]
