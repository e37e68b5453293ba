"""One file for each quantity, or for each topic: a folder is one recording."""

import os
from pathlib import Path

import numpy as np
import pytest

from asrsim.errors import RecordingError
from asrsim.recordings import read_recording
from asrsim.recordings.reading import modified
from asrsim.robot import load_robot
from asrsim.scenario.recording_plan import make_plan

TIME = np.arange(60) * 0.01
STAMPS = (1.7e9 + TIME) * 1e9
"""Times in ns, as `rostopic echo -p` writes them."""


def write(path, header, *columns, fmt="%.9g"):
    path.parent.mkdir(exist_ok=True)
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=header, comments="", fmt=fmt)


def meanings(folder, joints):
    recording = read_recording(folder, joints=joints)
    return {column.source: column.meaning for column in recording.channels.values()}


def test_files_of_one_quantity_each_are_joined_by_time(tmp_path, monkeypatch):
    """In the order of their names, whatever the order of the file system."""
    listed = Path.iterdir
    monkeypatch.setattr(Path, "iterdir", lambda path: iter(sorted(listed(path), reverse=True)))
    lab = tmp_path / "lab"
    write(lab / "position.csv", "time,knee,hip", TIME, np.sin(TIME), np.cos(TIME))
    write(lab / "desired_torque.csv", "time,knee", TIME[::2], np.sin(2 * TIME[::2]))
    write(lab / "run_3_velocity.csv", "time,hip [deg/s]", TIME, 180 * TIME)
    recording = read_recording(lab, joints=["hip", "knee"])
    assert {column.source: (column.meaning, column.unit) for column in recording.channels.values()} == {
        "desired_torque/knee": ("knee.reference_1", "N m"),
        "position/knee": ("knee.link_position", "rad"),
        "position/hip": ("hip.link_position", "rad"),
        "run_3_velocity/hip [deg/s]": ("hip.link_velocity", "rad/s"),
    }
    assert [name.partition("/")[0] for name in recording.channels] == [
        "desired_torque",
        "position",
        "position",
        "run_3_velocity",
    ]
    command = recording.column("knee", "reference_1")
    np.testing.assert_allclose(command.values, np.sin(2 * command.time), atol=1e-8)
    np.testing.assert_allclose(recording.column("hip", "link_velocity").values, np.pi * TIME, rtol=1e-8)


def test_topics_that_rostopic_wrote_are_joined(tmp_path, tiny):
    lab = tmp_path / "lab"
    write(lab / "elbow_controller_command.csv", "%time,field.data", STAMPS, np.sin(TIME), fmt="%.0f")
    write(lab / "joint_states.csv", "%time,field.position0,field.effort0", STAMPS + 5e6, TIME, TIME, fmt="%.20g")
    recording = read_recording(lab, joints=["elbow"])
    assert {column.meaning for column in recording.channels.values()} == {
        "elbow.reference_1",
        "elbow.link_position",
        "elbow.link_torque",
    }
    assert recording.column("elbow", "link_position").time[0] == pytest.approx(0.005, abs=1e-6)
    assert [one.column.source for one in make_plan(load_robot(tiny.robot), recording, step=0.001).played] == [
        "elbow_controller_command/field.data"
    ]


def test_joint_states_of_several_joints_without_names_are_asked_about(tmp_path):
    write(tmp_path / "states.csv", "%time,field.position0,field.position1", STAMPS, TIME, TIME, fmt="%.20g")
    for joints in (["elbow"], ["elbow", "wrist"]):
        assert len(read_recording(tmp_path / "states.csv", joints=joints).asked) == 2


def test_a_complete_column_keeps_its_meaning_in_any_file(tmp_path):
    lab = tmp_path / "lab"
    write(lab / "command_response_7.csv", "time,knee_pos,knee_cmd", TIME, TIME, TIME)
    assert meanings(lab, ["knee"]) == {
        "command_response_7/knee_pos": "knee.link_position",
        "command_response_7/knee_cmd": "knee.reference_1",
    }


def test_numbers_in_the_file_of_a_body_are_asked_about(tmp_path):
    lab = tmp_path / "lab"
    write(lab / "joints.csv", "time,q1", TIME, np.sin(TIME))
    write(lab / "imu.csv", "time,position_2", TIME, np.cos(TIME))
    recording = read_recording(lab)
    assert [column.source for column in recording.asked] == ["imu/position_2"]
    assert recording.channels["joints/q1"].meaning == "joint_1.link_position"


@pytest.mark.parametrize(
    ("second", "times", "code"),
    [
        ("run2", TIME, "two-recordings"),
        ("velocity", TIME + 5, "no-overlap"),
        ("velocity", STAMPS, "two-clocks"),
    ],
)
def test_files_that_are_no_single_recording_are_refused(tmp_path, second, times, code):
    lab = tmp_path / "lab"
    write(lab / "run1.csv", "time,knee_pos", TIME, TIME)
    write(lab / f"{second}.csv", f"time,knee_{'pos' if second == 'run2' else 'vel'}", times, TIME, fmt="%.20g")
    with pytest.raises(RecordingError) as error:
        read_recording(lab, joints=["knee"])
    assert [problem.code for problem in error.value.problems] == [code]


def test_a_folder_reads_no_links_and_no_other_files(tmp_path):
    lab = tmp_path / "lab"
    write(tmp_path / "secret.csv", "time,knee_vel", TIME, TIME)
    lab.mkdir()
    (lab / "velocity.csv").symlink_to(tmp_path / "secret.csv")
    (lab / "notes.md").write_text("time,knee_tau\n0,1\n")
    with pytest.raises(RecordingError, match="folder without recordings"):
        read_recording(lab)
    write(lab / "position.csv", "time,knee", TIME, TIME)
    assert meanings(lab, ["knee"]) == {"position/knee": "knee.link_position"}


def test_a_map_names_columns_by_their_file(tmp_path):
    lab = tmp_path / "lab"
    write(lab / "a.csv", "time,x", TIME, TIME)
    write(lab / "b.csv", "time,x", TIME, 2 * TIME)
    recording = read_recording(lab, mapping=["a/x=knee.reference_1 [deg]", "b/x=knee.link_position"], joints=["knee"])
    assert recording.column("knee", "reference_1").values[-1] == pytest.approx(np.radians(TIME[-1]))
    assert recording.column("knee", "link_position").values[-1] == pytest.approx(2 * TIME[-1])


def test_a_changed_file_of_a_folder_is_noticed(tmp_path):
    lab = tmp_path / "lab"
    write(lab / "position.csv", "time,knee", TIME, TIME)
    before = modified(lab)
    os.utime(lab / "position.csv", ns=(2 * 10**18, 2 * 10**18))
    assert modified(lab) != before
