"""What columns are by their names alone: certain ones are taken, doubtful ones are asked about, whatever stands beside them."""

import numpy as np
import pytest

from asrsim.recordings import read_recording
from asrsim.recordings.units import split_header

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
    "joint_1.motor_2_velocity": "motor_2_velocity", "dQ1": "link_velocity",
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
     "Winkel [deg]", "q1 [counts]", "q1 [furlong]"],
)  # fmt: skip
def test_a_doubtful_name_is_asked_about_and_not_used(tmp_path, name):
    recording = read(tmp_path, ["q2", name])
    assert recording.channels[name].quantity is None
    assert name in [column.source for column in recording.asked]
    (problem,) = [one for one in recording.findings if one.code == "asked"]
    assert name in str(problem.key)
    assert f"--map '{name}=" in str(problem.hint)


@pytest.mark.parametrize("name", ["current", "temperature", "pwm", "voltage_V", "status", "velocity_command"])
def test_what_no_joint_has_is_not_asked_about(tmp_path, name):
    recording = read(tmp_path, ["q1", name])
    assert recording.channels[name].quantity is None
    assert recording.asked == ()


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
        ("angle \u00b0", "angle", "rad", np.pi / 180),
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
    ],
)
def test_a_letter_of_a_name_is_not_a_unit(header):
    assert split_header(header) == (header, None)


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
