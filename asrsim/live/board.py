"""What a live run says: its topics, and their messages at a whole step, of the same numbers that the log will hold."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from asrsim.live.transport import Outlet
from asrsim.log.cdr import CdrBuilder, Column
from asrsim.log.frames import FrameMessages
from asrsim.log.topics import (
    DESCRIPTION_TOPIC,
    REFERENCE_TOPICS,
    TIME_TOPIC,
    Topic,
    joint_state,
    robot_topics,
    topic_paths,
)
from asrsim.samples import Array, JointInfo, RunInfo, Samples
from asrsim.simulation.simulation import Simulation

APPLIED = "applied"
"""Part of the names of topics that tell which reference is in force: the toolbox's own names are for setting it."""
CONTROL = "/ros2_control"
STIFFNESS_JOINT = "_stiffness"
"""Ending of the pseudo-joint whose position is the stiffness preset, for ros2_control."""


class Board:
    """Messages of all topics from the simulation's last substep."""

    def __init__(self, simulation: Simulation, info: RunInfo, *, namespace: str = "") -> None:
        """info: of the run; namespace: stands before all names but `/clock` and `/tf`."""
        self._simulation = simulation
        self._joints = tuple(simulation.joints)
        self._known = {joint.name: joint.quantities for joint in info.joints}
        prefix = f"/{namespace.strip('/')}" if namespace.strip("/") else ""
        self.prefix = prefix
        topics = [_named(topic, prefix) for topic in _topics(info.joints)]
        # What answers a command goes first: each message takes some us.
        topics.sort(key=lambda topic: f"/{APPLIED}/" not in topic.name)
        self._frames = FrameMessages(info.frames, info.frame_rate) if info.frames and info.frame_rate else None
        outlets = [Outlet(topic.name, topic.message) for topic in topics]
        latched: dict[str, bytes] = {}
        if self._frames is not None:
            outlets.append(Outlet("/tf", self._frames.topic.message))
        if info.urdf:
            outlets.append(Outlet(prefix + DESCRIPTION_TOPIC, "std_msgs/String", latched=True))
            latched[outlets[-1].name] = CdrBuilder().string(info.urdf).build().data
        if self._frames is not None and self._frames.static is not None:
            outlets.append(Outlet("/tf_static", self._frames.static_topic.message, latched=True))
            latched[outlets[-1].name] = self._frames.static
        self.outlets, self.latched = tuple(outlets), latched
        self._quantities = tuple(dict.fromkeys(name for joint in info.joints for name in joint.quantities))
        self._table = np.full(len(self._quantities) * len(self._joints) + 1, np.nan)
        """Numbers of a step: quantities (of each joint), and a NaN."""
        self._encoder = _Encoder(topics, self._place)
        self._wanted: Sequence[Sequence[bool]] = ()

    def _place(self, quantity: str, joint: str) -> int:
        """Where a joint's quantity stands in the table."""
        j = self._joints.index(joint)
        if quantity not in self._known[joint]:
            return len(self._table) - 1
        return self._quantities.index(quantity) * len(self._joints) + j

    def messages(self, time: int, wanted: Sequence[Sequence[bool]]) -> list[bytes]:
        """Of the outlets that are not latched, in their order, empty where nobody wants one or it is not due.

        time: of the last substep in ns; wanted: of each transport, see :attr:`asrsim.live.transport.Transport.wanted`.
        """
        if wanted != self._wanted:
            self._wanted = wanted
            self._listened = [any(each) for each in zip(*wanted, strict=True)]
            self._encoder.choose(self._listened)
        if not any(self._listened):
            return [b""] * len(self._listened)
        self._fill()
        found = self._encoder.encode(self._table, time)
        if self._frames is not None:
            found.append(self._moved(time) if self._listened[-1] and self._frames.due(time * 1e-9) else b"")
        return found

    def _moved(self, time: int) -> bytes:
        """The frames' message."""
        if self._frames is None:
            return b""
        position = self._table[:-1].reshape(len(self._quantities), -1)[None, self._quantities.index("link_position")]
        samples = Samples(time=np.array([time * 1e-9]), joints=self._joints, values={"link_position": position})
        return self._frames.messages(samples)[0][1]

    def begin_again(self) -> None:
        """The simulation is back at its start."""
        if self._frames is not None:
            self._frames.rewind()

    def _fill(self) -> None:
        """The table, as the log will have its numbers."""
        found = self._simulation.read(self._quantities)
        np.concatenate(list(found.values()), out=self._table[:-1])


class _Encoder:
    """All messages of a step in one piece of memory, into which numbers are laid at once."""

    def __init__(self, topics: Sequence[Topic], place: Callable[[str, str], int]) -> None:
        """place: where a joint's quantity stands in the table of a step's numbers."""
        data = bytearray()
        self._parts: list[tuple[Topic, int, int]] = []
        floats, sources, stamps = [], [], []
        for topic in topics:
            # Four bytes of CDR's header come before what is aligned.
            data += bytes((4 - len(data)) % 8)
            start = len(data)
            data += topic.template.data
            self._parts.append((topic, start, len(data)))
            for offset, column in topic.template.floats:
                floats.append((start + offset) // 8)
                sources.append(place(column.name, str(column.part)))
            stamps += [(start + offset) // 4 for offset in topic.template.stamps]
        self._data = np.frombuffer(bytes(data) + bytes(-len(data) % 8), np.uint8).copy()
        self._numbers, self._words = self._data.view("<f8"), self._data.view("<u4")
        self._floats, self._sources, self._stamps = np.array(floats), np.array(sources), np.add.outer(stamps, (0, 1))
        self.choose([True] * len(topics))

    def choose(self, listened: Sequence[bool]) -> None:
        """Which messages are made from now on."""
        chosen = [part if one else (part[0], 0, 0) for part, one in zip(self._parts, listened, strict=False)]
        self._places = [(start, end) for _, start, end in chosen]
        self.wanted = {column.name for topic, start, end in chosen if start < end for _, column in topic.template.floats}
        """Quantities in them."""

    def encode(self, table: Array, time: int) -> list[bytes]:
        """Time in ns."""
        self._numbers[self._floats] = table[self._sources]
        self._words[self._stamps] = divmod(time, 1_000_000_000)
        whole = self._data.tobytes()
        return [whole[start:end] for start, end in self._places]


def reference_names(joint: JointInfo) -> tuple[str, ...]:
    """The toolbox's names of the topics of a joint's references."""
    return REFERENCE_TOPICS.get(joint.mode, ()) if joint.motors != 1 else REFERENCE_TOPICS.get(joint.mode, ())[:1]


def _topics(joints: Sequence[JointInfo]) -> Iterator[Topic]:
    paths = dict(zip((joint.name for joint in joints), topic_paths(joints), strict=True))
    settable = {f"{paths[joint.name]}/{name}" for joint in joints for name in REFERENCE_TOPICS.get(joint.mode, ())}
    settable |= {f"{path}/external_torque" for path in paths.values()}
    known = {joint.name: joint.quantities for joint in joints}

    def of(members: Sequence[JointInfo], quantity: str) -> list[Column | None]:
        return [Column("value", quantity, one.name) if quantity in known[one.name] else None for one in members]

    yield Topic(name="/clock", message="rosgraph_msgs/Clock", template=CdrBuilder().stamp().build())
    for topic in robot_topics(joints):
        if topic.name == TIME_TOPIC or topic.message == "asrsim_msgs/JointDetails":
            continue
        if topic.name in settable:
            path, _, name = topic.name.rpartition("/")
            yield replace(topic, name=f"{path}/{APPLIED}/{name}")
        else:
            yield topic
    states = ("link_position", "link_velocity", "link_torque")
    for joint in joints:
        yield joint_state(f"{paths[joint.name]}/joint_state", [joint], [of([joint], name) for name in states])
        if "stiffness" in joint.quantities:
            template = CdrBuilder().float64(Column("value", "stiffness", joint.name)).build()
            yield Topic(name=f"{paths[joint.name]}/stiffness", message="std_msgs/Float64", template=template)
    # One kind of interface a message, stiffness as the position of pseudo-joints: what JointStateTopicSystem takes.
    driven = [joint for joint in joints if joint.mode is not None]
    preset = [joint for joint in driven if "stiffness_preset" in reference_names(joint)]
    builder = CdrBuilder().header().strings([*(j.name for j in driven), *(j.name + STIFFNESS_JOINT for j in preset)])
    builder.float64s([*of(driven, states[0]), *of(preset, "reference_2")])
    for name in states[1:]:
        builder.float64s([*of(driven, name), *(None for _ in preset)])
    if driven:
        yield Topic(name=f"{CONTROL}/joint_states", message="sensor_msgs/JointState", template=builder.build())


def _named(topic: Topic, prefix: str) -> Topic:
    return topic if topic.name in ("/clock", "/tf") else replace(topic, name=prefix + topic.name)
