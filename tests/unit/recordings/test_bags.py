"""ROS 1 and ROS 2 bags, MCAP, our own logs: read without ROS, with the definitions and the stamps in the file."""

import json

import numpy as np
import pytest

from asrsim.errors import RecordingError
from asrsim.recordings import read_recording
from support.bags import NUMBER, START, STATE, header, joint_state, write_bag

N = 40
STAMPS = START + 10_000_000 * np.arange(N)
TIME = 0.01 * np.arange(N)
Q = np.array([np.sin(TIME), np.cos(TIME)])
ANGLE, COMMAND, TEXT = "lab_msgs/msg/Angle", "/arm/elbow/equilibrium_position", "std_msgs/msg/String"
JOINTS = np.array(["shoulder", "elbow"])


def states(types, i, stamp):
    """Positions, and twice as large efforts; each second message lists the joints in the other order, as two publishers do."""
    order = [1, 0] if i % 2 else [0, 1]
    return joint_state(types, stamp, JOINTS[order].tolist(), Q[order, i], 2 * Q[order, i])


def write_ros1(path, *, offset=0, bad=0):
    """offset: ns by which the headers' stamps are late; bad: ns by which that of message 17 is off."""
    topics = {
        "/joint_states": (STATE, lambda types, i, time: states(types, i, time + offset + bad * (i == 17))),
        COMMAND: (NUMBER, lambda types, i, time: types[NUMBER](0.5 * i)),
        "/chatter": (TEXT, lambda types, i, time: types[TEXT]("hello")),
    }
    return write_bag(path, "ros1", topics, STAMPS)


def write_ros2(path, kind, version=9):
    def angle(types, i, time):
        return types[ANGLE](angle=3.0 * i, pair=np.array([1.0, i], dtype=np.float32), header=header(types, time))

    definitions = {ANGLE: "float64 angle\nfloat32[2] pair\nstd_msgs/Header header\n"}
    topics = {"/joint_states": (STATE, states), "/lab/angle": (ANGLE, angle)}
    return write_bag(path, kind, topics, STAMPS, definitions=definitions, version=version)


def check(path):
    recording = read_recording(path)
    np.testing.assert_allclose(recording.time, TIME, atol=1e-9)
    assert recording.joints == ("shoulder", "elbow")
    np.testing.assert_allclose(recording.column("shoulder", "link_position").values, Q[0])
    np.testing.assert_allclose(recording.column("elbow", "link_torque").values, 2 * Q[1])


def test_joint_states_that_repeat_or_lack_names_are_told(tmp_path):
    def of(*names):
        return STATE, lambda types, i, time: joint_state(types, time, names, Q[:, i], Q[:, i])

    topics = {"/twice": of("elbow", "elbow"), "/nameless": of()}
    recording = read_recording(write_bag(tmp_path / "lab.bag", "ros1", topics, STAMPS), joints=["shoulder", "elbow"])
    doubts = " ".join(recording.doubts)
    assert "/twice: names position[elbow], effort[elbow] several times in one message (40 messages)" in doubts
    assert (
        "/nameless: the message names no joints for position[0], position[1], effort[0], effort[1]: these values are" in doubts
    )


def test_messages_that_lack_velocities_keep_their_positions(tmp_path):
    def state(i, _):
        whole = {"name": ["elbow"], "position": [Q[0, i]]}
        return whole | ({"velocity": [Q[1, i]]} if i % 3 else {})

    recording = read_recording(mcap(tmp_path / "lab.mcap", {"/joint_states": state}))
    (told,) = recording.doubts
    assert "/joint_states: 12 missing samples" in told
    np.testing.assert_allclose(recording.column("elbow", "link_position").values, Q[0])
    velocity = recording.column("elbow", "link_velocity")
    np.testing.assert_allclose(velocity.values, [Q[1, i] for i in range(N) if i % 3])
    np.testing.assert_allclose(np.diff(velocity.time)[:3], [0.015, 0.03, 0.015])


def test_a_topic_whose_messages_lack_velocities_has_one_time_base(tmp_path):
    def state(i, sent):
        stamp = {"header": {"stamp": parts(sent - 100 * 10**9, "sec", "nanosec")}}
        return stamp | {"name": ["elbow"], "position": [Q[0, i]]} | ({"velocity": [Q[1, i]]} if i % 3 else {})

    recording = read_recording(mcap(tmp_path / "lab.mcap", {"/joint_states": state}))
    assert [problem.code for problem in recording.findings].count("two-time-bases") == 1


def test_a_number_that_stands_in_a_single_message_is_named(tmp_path):
    def state(i, _):
        return {"name": ["elbow"], "position": [Q[0, i]]} | ({"velocity": [1.0]} if i == 5 else {})

    (told,) = read_recording(mcap(tmp_path / "lab.mcap", {"/joint_states": state})).findings
    assert "/joint_states: only one message has velocity[elbow]; a time series needs more" in str(told)


def test_ros1_bag(tmp_path):
    path = write_ros1(tmp_path / "lab.bag")
    check(path)
    recording = read_recording(path)
    assert recording.format == "bag"
    assert recording.doubts == ()
    np.testing.assert_allclose(recording.column("elbow", "reference_1").values, 0.5 * np.arange(N))
    assert any(f.key == "/chatter" for f in recording.findings)


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_a_ros2_bag_with_custom_messages_equals_its_single_file(tmp_path, storage):
    path = write_ros2(tmp_path / "bag", storage)
    check(path)
    check(next(file for file in path.iterdir() if file.suffix in (".mcap", ".db3")))
    recording = read_recording(path, mapping=["/lab/angle/angle=elbow.reference_1 [deg]"])
    np.testing.assert_allclose(recording.column("elbow", "reference_1").values, np.radians(3.0 * np.arange(N)))
    np.testing.assert_allclose(recording.channels["/lab/angle/pair[1]"].values, np.arange(N))


def test_unknown_message_types_without_definition(tmp_path):
    """Bags before ROS 2 Iron hold no definitions; types outside of the standard ones cannot be read."""
    import sqlite3

    path = write_ros2(tmp_path / "bag", "sqlite3", version=8)
    database = sqlite3.connect(next(path.glob("*.db3")))
    tables = [row[0] for row in database.execute("select name from sqlite_master where type = 'table'")]
    if "message_definitions" in tables:
        database.execute("delete from message_definitions")
        database.commit()
    database.close()
    recording = read_recording(path)
    assert recording.joints == ("shoulder", "elbow")
    unknown = [f for f in recording.findings if f.code == "unknown-message-type"]
    assert [(f.key, f.value) for f in unknown] == [("/lab/angle", "lab_msgs/msg/Angle")]


@pytest.mark.parametrize("name", ["lab.bag", "lab.mcap", "lab.db3"])
def test_a_damaged_bag_is_refused(tmp_path, name):
    path = tmp_path / name
    path.write_bytes(b"no bag at all" * 50)
    with pytest.raises(RecordingError, match="no bag at all"):
        read_recording(path)


def test_own_logs_are_recordings_too(tmp_path):
    from asrsim.log import LogWriter
    from asrsim.samples import JointInfo, RunInfo, Samples

    values = {"link_position": Q[:1].T, "reference_1": Q[1:].T, "external_torque": 2 * Q[1:].T}
    joint = JointInfo(name="elbow", actuator="sea", mode=3, motors=1, quantities=tuple(values))
    with LogWriter(tmp_path / "run.mcap", RunInfo(robot="arm", joints=(joint,), step=0.01)) as log:
        log.write(Samples(time=TIME, joints=("elbow",), values=values))
    recording = read_recording(tmp_path / "run.mcap")
    for quantity, recorded in values.items():
        column = recording.column("elbow", quantity)
        np.testing.assert_allclose(column.time, TIME, rtol=1e-15)
        np.testing.assert_array_equal(column.values, recorded[:, 0])


@pytest.mark.parametrize("off", [-3600, 45, 4_000_000])
def test_one_bad_stamp_leaves_out_one_message(tmp_path, off):
    recording = read_recording(write_ros1(tmp_path / "lab.bag", bad=off * 10**9))
    column = recording.column("elbow", "link_position")
    np.testing.assert_allclose(np.diff(column.time), np.diff(np.delete(STAMPS, 17)) * 1e-9, atol=1e-9)
    np.testing.assert_allclose(column.values, np.delete(Q[1], 17))


@pytest.mark.parametrize(
    ("late", "used"), [(0.4, True), (-0.8, True), (1.5, False), (60.0, False), (5.0 - START * 1e-9, False)]
)
def test_stamps_near_the_time_of_recording_are_used(tmp_path, late, used):
    """Within a second it is the way of the messages; beyond, another clock, which is said."""
    path = write_ros1(tmp_path / "lab.bag", offset=round(late * 1e9))
    recording = read_recording(path)
    assert any(f.code == "two-time-bases" for f in recording.findings) != used
    begins = [recording.column("elbow", name).time[0] for name in ("link_position", "reference_1")]
    assert begins[0] - begins[1] == pytest.approx(late if used else 0.0, abs=1e-9)


def mcap(path, messages, *, encoding="json", chunk=10**6):
    """Topics' JSON messages by their number and the ns at which they were sent; the recorder got them 1.5 times as late."""
    from mcap.writer import Writer

    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=chunk)
        writer.start()
        schema = writer.register_schema("lab/State", "jsonschema", b"{}")
        channels = {topic: writer.register_channel(topic, encoding, schema) for topic in messages}
        for i in range(N):
            got, sent = START + 15_000_000 * i, START + 10_000_000 * i
            for topic, message in messages.items():
                writer.add_message(channels[topic], log_time=got, publish_time=got, data=json.dumps(message(i, sent)).encode())
        writer.finish()
    return path


def parts(stamp, whole, rest):
    return {whole: stamp // 10**9, rest: stamp % 10**9}


SENT = {
    "ROS": lambda i, t: {"header": {"stamp": parts(t, "sec", "nanosec"), "frame_id": ""}},
    "ROS 1": lambda i, t: {"header": {"stamp": parts(t, "secs", "nsecs"), "seq": i}},
    "Foxglove": lambda i, t: {"timestamp": parts(t, "sec", "nsec")},
    "a stamp without a header": lambda i, t: {"stamp": parts(t, "sec", "nanosec")},
}


@pytest.mark.parametrize("name", SENT)
def test_json_messages_were_measured_when_they_say(tmp_path, name):
    path = mcap(tmp_path / "a.mcap", {"/state": lambda i, t: SENT[name](i, t) | {"names": [], "q": Q[:, i].tolist()}})
    column = read_recording(path, joints=["a", "b"]).column("b", "link_position")
    np.testing.assert_allclose(column.time, TIME, atol=1e-6)
    np.testing.assert_allclose(column.values, Q[1], atol=1e-12)


CONTROLLER = {
    "joint_names": ["b", "a"],
    "output": {"effort": [1.0, 2.0]},
    "points": [{"positions": [3.0, 4.0]}],
}


@pytest.mark.parametrize("suffix", ["mcap", "jsonl"])
def test_names_of_joints_hold_for_the_parts_of_a_message(tmp_path, suffix):
    """The state of a trajectory's controller: what it sends, and points that act later, are asked about."""

    def state(i, _):
        values = {"desired": Q[:, i], "actual": Q[:, i] - 0.1, "error": np.array([0.1, 0.1 + 0.01 * i])}
        return CONTROLLER | {name: {"positions": [*numbers]} for name, numbers in values.items()}

    path = tmp_path / f"lab.{suffix}"
    if suffix == "mcap":
        mcap(path, {"/arm/state": state})
    else:
        path.write_text("\n".join(json.dumps({"t": TIME[i]} | state(i, 0)) for i in range(N)))
    recording = read_recording(path, joints=["a", "b"])
    for name, values in {"reference_1": Q, "link_position": Q - 0.1}.items():
        np.testing.assert_allclose([recording.column(joint, name).values for joint in ("b", "a")], values)
    np.testing.assert_allclose(recording.column("a", "position_error").values, 0.1 + 0.01 * np.arange(N))
    assert len(recording.asked) == 4


def test_interfaces_of_joints_are_read(tmp_path):
    """DynamicJointState of ros2_control."""
    kind, parts = "control_msgs/msg/DynamicJointState", "control_msgs/msg/InterfaceValue"

    def make(types, i, time):
        one = [types[parts](interface_names=["effort", "position"], values=np.array([2.0, value])) for value in Q[:, i]]
        return types[kind](header=header(types, time), joint_names=["b", "a"], interface_values=one)

    texts = {
        parts: "string[] interface_names\nfloat64[] values\n",
        kind: "std_msgs/Header header\nstring[] joint_names\ncontrol_msgs/InterfaceValue[] interface_values\n",
    }
    path = write_bag(tmp_path / "lab", "mcap", {"/dynamic": (kind, make)}, STAMPS, definitions=texts)
    np.testing.assert_allclose(read_recording(path).column("b", "link_position").values, Q[0])


def test_a_number_is_used_as_time_where_that_is_stated(tmp_path):
    path = mcap(tmp_path / "a.mcap", {"/state": lambda i, _: {"t": 1000 * TIME[i], "q": Q[0, i]}})
    found = read_recording(path)
    np.testing.assert_allclose(found.column("joint_1", "link_position").time, 1.5 * TIME, atol=1e-6)
    np.testing.assert_allclose(read_recording(path, mapping=["/state/t=time [ms]"]).time, TIME, atol=1e-6)


def test_a_truncated_mcap_is_read_to_its_last_complete_chunk(tmp_path):
    path = mcap(tmp_path / "a.mcap", {"/q": lambda i, _: {"data": 0.5 * i}}, chunk=400)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    recording = read_recording(path, mapping=["/q=elbow.link_position [deg]"])
    values = recording.column("elbow", "link_position").values
    assert 2 < len(values) < N
    np.testing.assert_allclose(values, np.radians(0.5 * np.arange(len(values))))
    assert any(f.code == "truncated" for f in recording.findings)


def test_unknown_encodings_say_what_the_file_holds(tmp_path):
    path = mcap(tmp_path / "a.mcap", {"/q": lambda i, _: {}}, encoding="protobuf")
    with pytest.raises(RecordingError, match=r"/q \(lab/State: .*protobuf.*JointState"):
        read_recording(path)
