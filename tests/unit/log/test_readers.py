"""The same numbers for every reader: the official one with CRC validation, mcap-ros2-support, and rosbags."""

import struct
from dataclasses import replace

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.records import Channel, DataEnd, Schema
from mcap.stream_reader import StreamReader
from mcap_ros2.decoder import DecoderFactory

from asrsim.log import LogWriter, read_log
from asrsim.log.structure import read_structure
from support.log_example import INFO, example_samples

COUNT = 1500
BODIES, CONTACTS = ("box", "ball"), ("box/ground", "box/finger-1")
TIMES = [round(0.002 * 1e9) * n for n in range(COUNT)]


@pytest.fixture(scope="module")
def samples():
    return example_samples(COUNT, bodies=BODIES, contacts=CONTACTS)


@pytest.fixture(scope="module")
def log_path(tmp_path_factory, samples):
    path = tmp_path_factory.mktemp("log") / "run.mcap"
    with LogWriter(path, INFO) as writer:
        writer.write(samples)
    return path


@pytest.fixture(scope="module")
def decoded(log_path):
    """Topic -> (log time, message), by the official reader and mcap-ros2-support."""
    found = {}
    with log_path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for _, channel, message, value in reader.iter_decoded_messages():
            assert message.log_time == message.publish_time
            found.setdefault(channel.topic, []).append((message.log_time, value))
    return found


def same(left, right):
    """Equal bit for bit, also NaN."""
    return struct.pack("<d", left) == struct.pack("<d", right)


def test_what_the_file_counts_is_what_is_in_it(log_path):
    with log_path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
        assert summary is not None
        assert all(channel.metadata["offered_qos_profiles"] == "" for channel in summary.channels.values())
        assert all(channel.message_encoding == "cdr" for channel in summary.channels.values())
        assert all(schema.encoding == "ros2msg" for schema in summary.schemas.values())
        counts = summary.statistics
        times = [message.log_time for _, _, message in reader.iter_messages()]
        assert counts.message_count == len(times) == sum(counts.channel_message_counts.values())
        assert (counts.message_start_time, counts.message_end_time) == (min(times), max(times))
        assert counts.attachment_count == len(list(reader.iter_attachments())) == len(summary.attachment_indexes)
        assert counts.metadata_count == len(list(reader.iter_metadata())) == len(summary.metadata_indexes)
    assert (counts.channel_count, counts.schema_count) == (len(summary.channels), len(summary.schemas))
    assert counts.chunk_count == len(summary.chunk_indexes) > 1


def test_topics_and_types(log_path):
    with log_path.open("rb") as file:
        summary = make_reader(file).get_summary()
        assert summary is not None
        types = {channel.topic: summary.schemas[channel.schema_id].name for channel in summary.channels.values()}
    number, state = "std_msgs/msg/Float64", "sensor_msgs/msg/JointState"
    numbers = ["time", "torque_el1_state", "torque_el2_state", "external_torque", "equilibrium_position", "stiffness_preset",
               "motor_1_voltage", "temperature", "reference_1", "motor_1_command", "motor_2_command"]  # fmt: skip
    states = ["motor_1_state", "motor_2_state", "robot_state", "joint_states"]
    assert {topic.rpartition("/")[2]: kind for topic, kind in types.items()} == {
        **dict.fromkeys(numbers, number),
        **dict.fromkeys(states, state),
        "robot_description": "std_msgs/msg/String",
        "link_state": "asrsim_msgs/msg/LinkState",
        "details": "asrsim_msgs/msg/JointDetails",
        "tf": "tf2_msgs/msg/TFMessage",
        "ground": "geometry_msgs/msg/Vector3Stamped",
        "finger_1": "geometry_msgs/msg/Vector3Stamped",
    }
    assert {topic.rpartition("/")[0] for topic in types} == {
        "", "/asrsim", "/arm/right", "/arm/right/shoulder", "/arm/right/_lbow_2", "/slide", "/lever", "/contacts/box"
    }  # fmt: skip
    assert len(types) == 39


def test_attachments_and_metadata_with_the_official_reader(log_path):
    with log_path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        attachments = {attachment.name: attachment for attachment in reader.iter_attachments()}
        metadata = {record.name: record.metadata for record in reader.iter_metadata()}
    assert attachments["robot.urdf"].data.decode() == INFO.urdf
    assert attachments["scenario.yaml"].data.decode() == INFO.scenario
    assert attachments["attachments/raw"].data == bytes(range(256))
    assert {"run.json", "resolved.json"} < set(attachments)
    assert {attachment.log_time for attachment in attachments.values()} == {0}
    assert metadata["asrsim"]["seed"] == "7"
    assert metadata["asrsim_result"]["status"] == "complete"


def test_numbers_with_mcap_ros2_support(decoded, samples):
    values = samples.values
    assert [value.data for _, value in decoded["/robot_description"]] == [INFO.urdf]
    assert [time for time, _ in decoded["/asrsim/time"]] == TIMES
    assert [value.data for _, value in decoded["/asrsim/time"]] == samples.time.tolist()
    for n, (_, state) in enumerate(decoded["/arm/right/shoulder/link_state"]):
        assert state.header.stamp.sec * 10**9 + state.header.stamp.nanosec == TIMES[n]
        got = (state.q, state.dq, state.ref_1, state.ref_2, state.tau, state.stiff)
        names = ("link_position", "link_velocity", "reference_1", "reference_2", "link_torque", "stiffness")
        assert all(same(number, values[name][n, 0]) for number, name in zip(got, names, strict=True))
    for n, (_, state) in enumerate(decoded["/joint_states"]):
        assert state.name == list(samples.joints)
        assert all(same(a, b) for a, b in zip(state.position, values["link_position"][n], strict=True))
    for n, (_, value) in enumerate(decoded["/lever/details"]):
        assert same(value.spring_energy, values["spring_energy"][n, 3])
    for n, (_, message) in enumerate(decoded["/tf"]):
        assert [transform.child_frame_id for transform in message.transforms] == list(BODIES)
        ball = message.transforms[1].transform
        got = [ball.translation.x, ball.translation.z, ball.rotation.x, ball.rotation.w]
        assert got == samples.bodies["ball"][n, [0, 2, 3, 6]].tolist()
    for n, (_, message) in enumerate(decoded["/contacts/box/finger_1"]):
        vector = message.vector
        assert [vector.x, vector.y, vector.z] == samples.contacts["box/finger-1"][n].tolist()


@pytest.fixture(scope="module")
def compact(tmp_path_factory, samples):
    path = tmp_path_factory.mktemp("compact") / "run.mcap"
    info = replace(INFO, resolved={"scenario": {"robot": "arm.urdf", "log": "compact"}})
    with LogWriter(path, info) as writer:
        writer.write(samples)
    return path


def test_a_compact_log_holds_the_same_numbers_for_every_reader(log_path, compact, samples):
    from rosbags.highlevel import AnyReader

    whole, small = read_log(log_path).samples, read_log(compact).samples
    for name in whole.values:
        assert np.array_equal(whole.values[name].view(np.uint64), small.values[name].view(np.uint64)), name
    joint = INFO.joints[0]
    topic = next(name for name in topics_of(compact) if name.endswith(f"/{joint.name}/state"))
    with compact.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        official = [value for _, _, _, value in reader.iter_decoded_messages([topic])]
    with AnyReader([compact]) as reader:
        chosen = [connection for connection in reader.connections if connection.topic == topic]
        ours = [reader.deserialize(raw, one.msgtype) for one, _, raw in reader.messages(chosen)]
    assert len(official) == len(ours) == COUNT
    for quantity in joint.quantities:
        column = samples.values[quantity][:, samples.joints.index(joint.name)]
        if hasattr(official[0], quantity):
            assert all(same(getattr(message, quantity), value) for message, value in zip(official, column, strict=True))
            assert all(same(getattr(message, quantity), value) for message, value in zip(ours, column, strict=True))
    assert "/joint_states" in topics_of(compact)


def test_arrays_of_the_robot_are_there_where_a_manager_asks(tmp_path, log_path, samples):
    without = tmp_path / "run.mcap"
    with LogWriter(without, replace(INFO, resolved={"scenario": {"robot": "arm.urdf"}})) as writer:
        writer.write(samples)
    gone = topics_of(log_path) - topics_of(without)
    assert {name.rpartition("/")[2] for name in gone} == {"robot_state", "motor_1_state", "motor_2_state", "external_torque"}
    whole, small = read_log(log_path).samples, read_log(without).samples
    for name in whole.values:
        assert np.array_equal(whole.values[name].view(np.uint64), small.values[name].view(np.uint64)), name


def topics_of(path):
    return {channel.topic for channel in read_structure(path).channels}


def test_every_channel_comes_after_its_schema(log_path):
    """A reader that goes from the start, or a file that ends early, has no summary to find them in."""
    known = set()
    channels = 0
    for record in StreamReader(log_path.open("rb")).records:
        if isinstance(record, Schema):
            known.add(record.id)
        elif isinstance(record, Channel):
            assert record.schema_id in known
            channels += 1
        elif isinstance(record, DataEnd):
            break
    assert channels > 3
