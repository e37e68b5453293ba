"""What a live run says: its topics, and their messages at a whole step, of the same numbers that the log will hold."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from asrsim.actuators.vectorised import over_arrays
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
from asrsim.simulation.groups import spring_groups
from asrsim.simulation.recorder import COLUMN
from asrsim.simulation.simulation import Simulation

APPLIED = "applied"
"""Part of the names of topics that tell which reference is in force: the toolbox's own names are for setting it."""
CONTROL = "/ros2_control"
STIFFNESS_JOINT = "_stiffness"
"""Ending of the pseudo-joint whose position is the stiffness preset, for ros2_control."""

_DIRECT = {
    "link_position": "link_position", "link_torque": "link_torque", "damping_torque": "damping_torque",
    "elastic_torque_1": "torque_1", "elastic_torque_2": "torque_2",
    **{f"motor_{i}_{what}": f"{column}_{i}"
       for i in (1, 2) for what, column in (("position", "position"), ("velocity", "velocity"), ("torque", "drive"))},
}  # fmt: skip
"""Quantity -> column of the raw record."""
_INPUTS = ("reference_1", "reference_2", "external_torque")


class Board:
    """Messages of all topics from the simulation's last substep."""

    def __init__(self, simulation: Simulation, info: RunInfo, *, namespace: str = "") -> None:
        """info: of the run; namespace: stands before all names but `/clock` and `/tf`."""
        self._simulation = simulation
        self._joints = tuple(simulation.joints)
        topics = list(_topics(info.joints))
        prefix = f"/{namespace.strip('/')}" if namespace.strip("/") else ""
        self.prefix = prefix
        self._encoder = _Encoder([_named(topic, prefix) for topic in topics], self._joints)
        self._frames = FrameMessages(info.frames, info.frame_rate) if info.frames and info.frame_rate else None
        outlets = [Outlet(topic.name, topic.message) for topic in self._encoder.topics]
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
        self._groups = [
            (group, over_arrays(group.actuator.stiffness), group.elastic) for group in spring_groups(simulation.prepared.drives)
        ]
        named = list(enumerate(self._encoder.quantities))
        direct = [(line, COLUMN[_DIRECT[name]]) for line, name in named if name in _DIRECT]
        self._direct = (np.array([line for line, _ in direct]), np.array([column for _, column in direct]))
        self._others = [(line, name) for line, name in named if name not in _DIRECT]
        self._lacking = np.zeros((len(self._encoder.quantities), len(self._joints)), bool)
        for j, name in enumerate(self._joints):
            known = next(joint.quantities for joint in info.joints if joint.name == name)
            self._lacking[:, j] = [quantity not in known for quantity in self._encoder.quantities]

    def messages(self, time: int) -> list[bytes]:
        """Of the outlets that are not latched, in their order, empty where one is not due; `time` of the last substep in ns."""
        values = self._values()
        found = self._encoder.encode(values, time)
        if self._frames is not None:
            found.append(b"" if not self._frames.due(time * 1e-9) else self._moved(values, time))
        return found

    def _moved(self, values: Array, time: int) -> bytes:
        """The frames' message."""
        if self._frames is None:
            return b""
        position = values[self._encoder.quantities.index("link_position")]
        samples = Samples(time=np.array([time * 1e-9]), joints=self._joints, values={"link_position": position[None]})
        return self._frames.messages(samples)[0][1]

    def begin_again(self) -> None:
        """The simulation is back at its start."""
        if self._frames is not None:
            self._frames.rewind()

    def _values(self) -> Array:
        """(quantities, joints), as the log will have them: the last substep completed by the velocity after it."""
        simulation = self._simulation
        if simulation.row is None:
            raise RuntimeError("nothing has been simulated yet")
        raw, inputs = simulation.row
        values = np.empty((len(self._encoder.quantities), len(self._joints)))
        lines, columns = self._direct
        values[lines] = raw.T[columns]
        for line, name in self._others:
            if name in _INPUTS:
                values[line] = inputs[_INPUTS.index(name)]
            elif name == "link_velocity":
                values[line] = raw[:, COLUMN["engine_velocity"]]
                if simulation.prepared.stepping.staggered and simulation.substep > 1:
                    values[line] = 0.5 * (values[line] + simulation.engine.read()[1])
            else:
                values[line] = np.nan
                for group, law, elastic in self._groups:
                    places = (COLUMN["link_position"], COLUMN["position_1"], COLUMN["position_2"])
                    values[line][group.pick] = law(*(raw[group.pick, place, None] for place in places), elastic)[:, 0]
        values[self._lacking] = np.nan
        return values


class _Encoder:
    """All messages of a step in one piece of memory, into which numbers are laid at once."""

    def __init__(self, topics: Sequence[Topic], joints: Sequence[str]) -> None:
        self.topics = tuple(topics)
        columns = [column for topic in topics for _, column in topic.template.floats]
        self.quantities = tuple(dict.fromkeys(["link_position", *(column.name for column in columns)]))
        data = bytearray()
        self._places: list[tuple[int, int]] = []
        floats, sources, stamps = [], [], []
        for topic in topics:
            # Four bytes of CDR's header come before what is aligned.
            data += bytes((4 - len(data)) % 8)
            start = len(data)
            data += topic.template.data
            self._places.append((start, len(data)))
            for offset, column in topic.template.floats:
                floats.append((start + offset) // 8)
                sources.append(self.quantities.index(column.name) * len(joints) + joints.index(str(column.part)))
            stamps += [(start + offset) // 4 for offset in topic.template.stamps]
        self._data = np.frombuffer(bytes(data) + bytes(-len(data) % 8), np.uint8).copy()
        self._numbers, self._words = self._data.view("<f8"), self._data.view("<u4")
        self._floats, self._sources, self._stamps = np.array(floats), np.array(sources), np.array(stamps)

    def encode(self, values: Array, time: int) -> list[bytes]:
        """values: (quantities, joints); time in ns."""
        self._numbers[self._floats] = values.ravel()[self._sources]
        seconds, rest = divmod(time, 1_000_000_000)
        self._words[self._stamps], self._words[self._stamps + 1] = seconds, rest
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
        if topic.name == TIME_TOPIC or topic.message == "asrsim_msgs/JointDetails" or _users(topic):
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


def _users(topic: Topic) -> bool:
    """Whether its number is a quantity of a user's own, which the recorder works out later."""
    wanted = {*_DIRECT, *_INPUTS, "link_velocity", "stiffness"}
    return any(column.name not in wanted for _, column in topic.template.floats)


def _named(topic: Topic, prefix: str) -> Topic:
    return topic if topic.name in ("/clock", "/tf") else replace(topic, name=prefix + topic.name)
