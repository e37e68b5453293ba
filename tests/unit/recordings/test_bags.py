"""ROS 1 and ROS 2 bags, MCAP, our own logs: read without ROS, with the definitions in the file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from asrsim.errors import RecordingError
from asrsim.recordings import read_recording

rosbags = pytest.importorskip("rosbags")
from rosbags.rosbag1 import Writer as Writer1  # noqa: E402
from rosbags.rosbag2 import StoragePlugin  # noqa: E402
from rosbags.rosbag2 import Writer as Writer2  # noqa: E402
from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # noqa: E402

pytestmark = pytest.mark.once

N = 40
ZERO = 1_700_000_000_000_000_000
STAMPS = ZERO + 10_000_000 * np.arange(N)
TIME = 0.01 * np.arange(N)
Q = np.array([np.sin(TIME), np.cos(TIME)])


def joint_state(store: Any, i: int, stamp: int, names: list[str], ros1: bool) -> Any:
    types = store.types
    time = types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
    header = {"seq": i, "stamp": time, "frame_id": ""} if ros1 else {"stamp": time, "frame_id": ""}
    return types["sensor_msgs/msg/JointState"](
        header=types["std_msgs/msg/Header"](**header), name=names, position=Q[: len(names), i].copy(),
        velocity=np.array([]), effort=2 * Q[: len(names), i],
    )  # fmt: skip


def write_ros1(path: Path, *, offset: int = 0, extra: str = "") -> Path:
    store = get_typestore(Stores.ROS1_NOETIC)
    with Writer1(path) as writer:
        states = writer.add_connection("/joint_states", "sensor_msgs/msg/JointState", typestore=store)
        command = writer.add_connection("/arm/elbow/equilibrium_position", "std_msgs/msg/Float64", typestore=store)
        text = writer.add_connection("/chatter", "std_msgs/msg/String", typestore=store)
        for i, stamp in enumerate(STAMPS.tolist()):
            message = joint_state(store, i, stamp + offset, ["shoulder", "elbow"], ros1=True)
            writer.write(states, stamp, store.serialize_ros1(message, "sensor_msgs/msg/JointState"))
            value = store.types["std_msgs/msg/Float64"](data=0.5 * i)
            writer.write(command, stamp, store.serialize_ros1(value, "std_msgs/msg/Float64"))
            word = store.types["std_msgs/msg/String"](data="hello")
            writer.write(text, stamp, store.serialize_ros1(word, "std_msgs/msg/String"))
    return path


def write_ros2(path: Path, storage: StoragePlugin, version: int = 9) -> Path:
    store = get_typestore(Stores.ROS2_HUMBLE)
    definition = "float64 angle\nfloat32[2] pair\nstd_msgs/Header header\n"
    store.register(get_types_from_msg(definition, "lab_msgs/msg/Angle"))
    with Writer2(path, version=version, storage_plugin=storage) as writer:
        states = writer.add_connection("/joint_states", "sensor_msgs/msg/JointState", typestore=store)
        own = writer.add_connection("/lab/angle", "lab_msgs/msg/Angle", typestore=store)
        for i, stamp in enumerate(STAMPS.tolist()):
            message = joint_state(store, i, stamp, ["shoulder", "elbow"], ros1=False)
            writer.write(states, stamp, store.serialize_cdr(message, "sensor_msgs/msg/JointState"))
            angle = store.types["lab_msgs/msg/Angle"](
                angle=3.0 * i, pair=np.array([1.0, i], dtype=np.float32), header=message.header
            )
            writer.write(own, stamp, store.serialize_cdr(angle, "lab_msgs/msg/Angle"))
    return path


def check(path: Path) -> None:
    recording = read_recording(path)
    np.testing.assert_allclose(recording.time, TIME, atol=1e-9)
    assert recording.epoch == pytest.approx(ZERO * 1e-9)
    assert recording.joints == ("shoulder", "elbow")
    np.testing.assert_allclose(recording.column("shoulder", "link_position").values, Q[0])
    np.testing.assert_allclose(recording.column("elbow", "link_torque").values, 2 * Q[1])


@pytest.mark.parametrize("off", [-3600, 45, 3600, 4_000_000])
def test_one_bad_stamp_does_not_refuse_a_bag(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, off: int) -> None:
    """One message's header is off by `off` seconds, as after a clock that was set; its times of recording are sound."""
    stamps = STAMPS.copy()
    whole = joint_state

    def spoilt(store: Any, i: int, stamp: int, names: list[str], ros1: bool) -> Any:
        return whole(store, i, stamp + (off * 10**9 if i == 17 else 0), names, ros1)

    monkeypatch.setitem(globals(), "joint_state", spoilt)
    recording = read_recording(write_ros1(tmp_path / "lab.bag"))
    column = recording.column("elbow", "link_position")
    np.testing.assert_allclose(column.time, (np.delete(stamps, 17) - ZERO) * 1e-9, atol=1e-9)
    np.testing.assert_allclose(column.values, np.delete(Q[1], 17))


def test_joints_in_any_order_and_messages_that_overtake_each_other(tmp_path: Path) -> None:
    """Two publishers, each with its own order of the joints; the recorder got each third message late."""
    store = get_typestore(Stores.ROS1_NOETIC)
    got = STAMPS + 1_000_000 + np.where(np.arange(N) % 3 == 0, 15_000_000, 0)
    with Writer1(tmp_path / "lab.bag") as writer:
        states = writer.add_connection("/joint_states", "sensor_msgs/msg/JointState", typestore=store)
        for i in np.argsort(got).tolist():
            message = joint_state(store, i, int(STAMPS[i]), ["shoulder", "elbow"], ros1=True)
            if i % 2 == 0:
                message.name.reverse()
                message.position[:], message.effort[:] = message.position[::-1].copy(), message.effort[::-1].copy()
            writer.write(states, int(got[i]), store.serialize_ros1(message, "sensor_msgs/msg/JointState"))
    check(tmp_path / "lab.bag")
    assert any(f.code == "overtaken" for f in read_recording(tmp_path / "lab.bag").findings)


def test_ros1_bag(tmp_path: Path) -> None:
    path = write_ros1(tmp_path / "lab.bag")
    check(path)
    recording = read_recording(path)
    assert recording.format == "bag"
    np.testing.assert_allclose(recording.column("elbow", "reference_1").values, 0.5 * np.arange(N))
    assert any(f.key == "/chatter" for f in recording.findings)


@pytest.mark.parametrize("storage", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
def test_ros2_bag_with_messages_of_its_own(tmp_path: Path, storage: StoragePlugin) -> None:
    path = write_ros2(tmp_path / "bag", storage)
    check(path)
    recording = read_recording(path, mapping=["/lab/angle/angle=elbow.reference_1 [deg]"])
    np.testing.assert_allclose(recording.column("elbow", "reference_1").values, np.radians(3.0 * np.arange(N)))
    np.testing.assert_allclose(recording.channels["/lab/angle/pair[1]"].values, np.arange(N))


@pytest.mark.parametrize("storage", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
def test_a_single_file_of_a_ros2_bag(tmp_path: Path, storage: StoragePlugin) -> None:
    path = write_ros2(tmp_path / "bag", storage)
    check(next(file for file in path.iterdir() if file.suffix in (".mcap", ".db3")))


def test_a_truncated_mcap_is_read_up_to_its_last_whole_chunk(tmp_path: Path) -> None:
    whole = write_mcap(tmp_path / "whole.mcap", json_only=False, chunk=400).read_bytes()
    path = tmp_path / "cut.mcap"
    path.write_bytes(whole[: len(whole) // 2])
    recording = read_recording(path, mapping=["/lab/elbow=elbow.link_position"])
    values = recording.column("elbow", "link_position").values
    assert 2 < len(values) < N
    np.testing.assert_allclose(values, 0.5 * np.arange(len(values)))
    assert any(f.code == "truncated" for f in recording.findings)


def write_mcap(path: Path, *, json_only: bool, encoding: str = "json", chunk: int = 100_000) -> Path:
    from mcap.writer import Writer

    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=chunk)
        writer.start()
        schema = writer.register_schema("lab/Value", "jsonschema" if encoding == "json" else "protobuf", b"{}")
        channel = writer.register_channel("/lab/elbow", encoding, schema)
        for i, stamp in enumerate(STAMPS.tolist()):
            data = json.dumps({"data": 0.5 * i}).encode()
            writer.add_message(channel, log_time=stamp, publish_time=stamp, data=data)
        writer.finish()
    return path


def test_json_messages(tmp_path: Path) -> None:
    recording = read_recording(
        write_mcap(tmp_path / "lab.mcap", json_only=True), mapping=["/lab/elbow=elbow.link_position [deg]"]
    )
    np.testing.assert_allclose(recording.column("elbow", "link_position").values, np.radians(0.5 * np.arange(N)))


def test_unknown_encodings_say_what_the_file_holds(tmp_path: Path) -> None:
    path = write_mcap(tmp_path / "lab.mcap", json_only=False, encoding="protobuf")
    with pytest.raises(RecordingError, match="lab/Value") as error:
        read_recording(path)
    assert error.value.problems[0].code == "unknown-message-type"
    assert "protobuf" in str(error.value)
    assert "JointState" in str(error.value)


def test_unknown_message_types_without_definition(tmp_path: Path) -> None:
    """Bags before ROS 2 Iron hold no definitions; types outside of the standard ones cannot be read."""
    import sqlite3

    path = write_ros2(tmp_path / "bag", StoragePlugin.SQLITE3, version=8)
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


def test_two_time_bases_fall_back_to_the_time_of_recording_and_say_so(tmp_path: Path) -> None:
    recording = read_recording(write_ros1(tmp_path / "lab.bag", offset=-ZERO + 5_000_000_000))
    assert any(f.code == "two-time-bases" for f in recording.findings)
    np.testing.assert_allclose(recording.time, TIME, atol=1e-9)


@pytest.mark.parametrize(("late", "same"), [(0.4, True), (-0.8, True), (1.5, False), (60.0, False)])
def test_stamps_that_are_about_the_time_of_recording_count(tmp_path: Path, late: float, same: bool) -> None:
    """Within a second it is the way of the messages; beyond, another clock, which not all topics have."""
    recording = read_recording(write_ros1(tmp_path / "lab.bag", offset=round(late * 1e9)))
    assert any(f.code == "two-time-bases" for f in recording.findings) != same
    begins = [recording.column("elbow", name).time[0] for name in ("link_position", "reference_1")]
    assert begins[0] - begins[1] == pytest.approx(late if same else 0.0, abs=1e-9)


@pytest.mark.parametrize("name", ["lab.bag", "lab.mcap", "lab.db3"])
def test_damaged_and_empty_bags(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_bytes(b"no bag at all" * 50)
    with pytest.raises(RecordingError, match="no bag at all"):
        read_recording(path)
    path.write_bytes(b"")
    with pytest.raises(RecordingError, match="empty"):
        read_recording(path)


@pytest.mark.parametrize(("prismatic", "unit"), [(False, "rad"), (True, "m")])
def test_own_logs_are_recordings_too(tmp_path: Path, prismatic: bool, unit: str) -> None:
    from asrsim.log import LogWriter
    from asrsim.samples import JointInfo, RunInfo, Samples

    quantities = ("link_position", "reference_1")
    joint = JointInfo(name="elbow", actuator="sea", mode=3, motors=1, quantities=quantities, prismatic=prismatic)
    values = {"link_position": Q[:1].T, "reference_1": Q[1:].T}
    with LogWriter(tmp_path / "run.mcap", RunInfo(robot="arm", joints=(joint,), step=0.01)) as log:
        log.write(Samples(time=TIME, joints=("elbow",), values=values))
    recording = read_recording(tmp_path / "run.mcap")
    assert recording.format == "asrsim"
    np.testing.assert_array_equal(recording.time, TIME)
    np.testing.assert_array_equal(recording.column("elbow", "link_position").values, Q[0])
    assert recording.column("elbow", "link_position").unit == unit


def write_many(path: Path, *, bad: int | None = None, restart: bool = False) -> Path:
    """JointState beside 60 topics that nobody needs, each with jitter, gaps or text; `bad`: ns of one stamp of the first."""
    store = get_typestore(Stores.ROS1_NOETIC)
    types = store.types
    rng = np.random.default_rng(0)
    vector = types["geometry_msgs/msg/Vector3"](x=1.0, y=2.0, z=3.0)
    with Writer1(path) as writer:
        states = writer.add_connection("/joint_states", "sensor_msgs/msg/JointState", typestore=store)
        kinds = {
            "/force_{}": "geometry_msgs/msg/Vector3Stamped",
            "/value_{}": "std_msgs/msg/Float64",
            "/word_{}": "std_msgs/msg/String",
        }
        others = {
            name.format(k): (kind, writer.add_connection(name.format(k), kind, typestore=store))
            for name, kind in kinds.items() for k in range(20)
        }  # fmt: skip
        for i, stamp in enumerate((STAMPS + rng.integers(0, 10**6, N)).tolist()):
            state = joint_state(store, i, stamp, ["shoulder", "elbow"], ros1=True)
            writer.write(states, stamp, store.serialize_ros1(state, "sensor_msgs/msg/JointState"))
            for name, (kind, connection) in others.items():
                own = bad if bad is not None and name == "/force_0" and i == 20 else stamp
                own = int(STAMPS[i % 20]) if restart and name == "/force_0" else own
                time = types["builtin_interfaces/msg/Time"](sec=own // 10**9, nanosec=own % 10**9)
                header = types["std_msgs/msg/Header"](seq=i, stamp=time, frame_id="")
                fields = {
                    "Vector3Stamped": {"header": header, "vector": vector},
                    "Float64": {"data": 1.0},
                    "String": {"data": "x"},
                }
                if rng.random() < 0.8:
                    message = types[kind](**fields[kind.rpartition("/")[2]])
                    writer.write(connection, stamp, store.serialize_ros1(message, kind))
    return path


@pytest.mark.parametrize("bad", [None, 12 * 10**9, ZERO + 400 * 86400 * 10**9])
def test_of_sixty_topics_each_kind_of_note_stands_once_or_twice(tmp_path: Path, bad: int | None) -> None:
    recording = read_recording(write_many(tmp_path / "lab.bag", bad=bad), joints=["shoulder", "elbow"])
    assert recording.joints == ("shoulder", "elbow")
    assert recording.epoch == pytest.approx(ZERO * 1e-9, abs=1e-3)
    np.testing.assert_allclose(recording.column("shoulder", "link_position").values, Q[0])
    assert 0.0 < recording.time[-1] < 0.5
    codes = [one.code for one in recording.findings]
    assert max(map(codes.count, codes)) <= 2


def test_a_topic_whose_time_restarts_does_not_refuse_the_others(tmp_path: Path) -> None:
    path = write_many(tmp_path / "lab.bag", restart=True)
    recording = read_recording(path, joints=["shoulder", "elbow"])
    np.testing.assert_allclose(recording.column("elbow", "link_position").values, Q[1])
    assert not any(name.startswith("/force_0/") for name in recording.channels)


@pytest.mark.parametrize("topic", ["/force_0", "/word_3"])
def test_topics_can_be_ignored_whether_they_can_be_read_or_not(tmp_path: Path, topic: str) -> None:
    path = write_many(tmp_path / "lab.bag", restart=True)
    recording = read_recording(path, mapping=[f"{topic}=ignore"])
    assert not any(name.startswith(f"{topic}/") for name in recording.channels)
    with pytest.raises(RecordingError, match="no such column") as error:
        read_recording(path, mapping=["/nothing=ignore"])
    assert len(str(error.value)) < 1000
