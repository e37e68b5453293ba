"""Topics of a live run, and their messages after each step. The messages contain the values that the log contains."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from asrsim.actuators import MODES
from asrsim.live.transport import LiveTopic, prefix_of
from asrsim.log.cdr import CdrBuilder, MessageColumn
from asrsim.log.frames import FrameMessages
from asrsim.log.topics import DESCRIPTION_TOPIC, Topic, joint_state, reference_topics, robot_topics, topic_paths
from asrsim.quantities import MOST_MOTORS
from asrsim.samples import JointInfo, Samples
from asrsim.simulation.drives import EXTERNAL_TORQUE, Range, ranges_of
from asrsim.simulation.simulation import Simulation

Ranges = Mapping[str, Mapping[str, Range]]
"""Permitted range by joint and reference; references without a range cannot be set."""
APPLIED = "/applied_commands"
"""Topic of the references in effect: positions of a JointState with names such as `joint_1.equilibrium_position`. The topic
names of the toolbox are reserved for commands.
"""
CONTROL = "/ros2_control"
STIFFNESS_JOINT = "_stiffness"
"""Suffix of the pseudo-joint whose position is the stiffness preset, for ros2_control."""


class Publisher:
    """Creates the messages of all topics from the last step of the simulation."""

    def __init__(self, simulation: Simulation, *, namespace: str = "") -> None:
        """namespace: prefix of all topic names except `/clock` and `/tf`."""
        info = simulation.prepared.info
        self.ranges = ranges_of(simulation.scenario, simulation.prepared.drives)
        self._simulation = simulation
        self._joints = tuple(simulation.joints)
        self.prefix = prefix_of(namespace)
        topics = [replace(topic, name=self.prefix + topic.name) for topic in _topics(info.joints, self.ranges)]
        topics.append(Topic(name="/clock", message="rosgraph_msgs/Clock", template=CdrBuilder().stamp().build()))
        self._frames = FrameMessages(info.frames, info.frame_rate) if info.frames and info.frame_rate else None
        outlets = [LiveTopic(topic.name, topic.message) for topic in topics]
        if self._frames is not None:
            outlets.append(LiveTopic("/tf", self._frames.topic.message))
        if info.urdf:
            robot = CdrBuilder().string(info.urdf).build().data
            outlets.append(LiveTopic(self.prefix + DESCRIPTION_TOPIC, "std_msgs/String", robot))
        if self._frames is not None and self._frames.static is not None:
            outlets.append(LiveTopic("/tf_static", self._frames.static_topic.message, self._frames.static))
        self.outlets = tuple(outlets)
        self._quantities = tuple(dict.fromkeys(name for joint in info.joints for name in joint.quantities))
        self._lay_out(topics)

    def _lay_out(self, topics: Sequence[Topic]) -> None:
        """Place all messages in one block of memory, so that the numbers of a step are written in a single operation."""
        data = bytearray()
        self._places: list[tuple[int, int]] = []
        floats, sources, stamps = [], [], []
        for topic in topics:
            # CDR aligns numbers relative to the end of its four-byte header.
            data += bytes((4 - len(data)) % 8)
            start = len(data)
            data += topic.template.data
            self._places.append((start, len(data)))
            for offset, column in topic.template.floats:
                floats.append((start + offset) // 8)
                sources.append((self._quantities.index(column.name), self._joints.index(str(column.part))))
            stamps += [(start + offset) // 4 for offset in topic.template.stamps]
        self._data = np.frombuffer(data + bytes(-len(data) % 8), np.uint8)
        self._numbers, self._words = self._data.view("<f8"), self._data.view("<u4")
        self._floats, self._sources = np.array(floats), tuple(np.array(sources).T)
        self._stamps = np.add.outer(stamps, (0, 1))

    def messages(self, time: int, wanted: Sequence[Sequence[bool]]) -> list[bytes]:
        """Messages of the outlets that are not latched, in order; empty for an outlet that has no subscribers or is not due.

        time: time of the last step, ns; wanted: `asrsim.live.transport.Transport.wanted` of each transport.
        """
        listened = [any(each) for each in zip(*wanted, strict=True)]
        if not any(listened):
            return [b""] * len(listened)
        found = self._simulation.read(self._quantities)
        self._numbers[self._floats] = np.stack([*found.values()])[self._sources]
        self._words[self._stamps] = divmod(time, 1_000_000_000)
        whole = self._data.tobytes()
        messages = [whole[start:end] if one else b"" for (start, end), one in zip(self._places, listened, strict=False)]
        if self._frames is not None:
            position = found["link_position"][None]
            samples = Samples(time=np.array([time * 1e-9]), joints=self._joints, values={"link_position": position})
            due = self._frames.messages(samples) if listened[-1] else []
            messages.append(due[0][1] if due else b"")
        return messages


def reference_names(joint: JointInfo) -> tuple[str, ...]:
    """Topic names of a joint's references, as in the toolbox."""
    return reference_topics(joint.mode, joint.motors)


def _topics(joints: Sequence[JointInfo], ranges: Ranges) -> Iterator[Topic]:
    # Publish the applied commands before the positions, so that a twin receives the commands of a step before its positions.
    applied = {
        f"{joint.name}.{name}": MessageColumn("value", name if name == EXTERNAL_TORQUE else f"reference_{slot}", joint.name)
        for joint in joints
        for slot, name in enumerate(ranges.get(joint.name, ()), start=1)
    }
    builder = CdrBuilder().header().strings([*applied]).float64s([*applied.values()]).float64s([]).float64s([])
    yield Topic(name=APPLIED, message="sensor_msgs/JointState", template=builder.build())
    hidden = {"time", "details", *(name for mode in MODES for name in reference_topics(mode, MOST_MOTORS))}
    yield from (topic for topic in robot_topics(joints, external=False) if topic.name.rpartition("/")[2] not in hidden)
    for joint, path in zip(joints, topic_paths(joints), strict=True):
        if "stiffness" in joint.quantities:
            template = CdrBuilder().float64(MessageColumn("value", "stiffness", joint.name)).build()
            yield Topic(name=f"{path}/stiffness", message="std_msgs/Float64", template=template)
    # As in JointStateTopicSystem, stiffness presets are positions of pseudo-joints.
    driven = [joint for joint in joints if joint.mode is not None]
    preset = [joint for joint in driven if "stiffness_preset" in reference_names(joint)]
    positions = [*_columns(driven, "link_position"), *_columns(preset, "reference_2")]
    others = [[*_columns(driven, name), *(None for _ in preset)] for name in ("link_velocity", "link_torque")]
    members = [*driven, *(replace(joint, name=joint.name + STIFFNESS_JOINT) for joint in preset)]
    if driven:
        yield joint_state(f"{CONTROL}/joint_states", members, [positions, *others])


def _columns(joints: Sequence[JointInfo], quantity: str) -> list[MessageColumn | None]:
    return [MessageColumn("value", quantity, joint.name) if quantity in joint.quantities else None for joint in joints]
