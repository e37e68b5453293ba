"""Topics of a log: topics of the toolbox under `/<namespace>/`, topics that viewers expect, and asrsim's own topics.

Each number is stored exactly once on a *canonical* topic, from which it is read back. Arrays for the whole robot repeat some
numbers for tools that expect the arrays.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass

from asrsim.log.cdr import CdrBuilder, CdrTemplate, MessageColumn
from asrsim.quantities import MOST_MOTORS, QUANTITIES
from asrsim.samples import JointInfo

LINK_STATE_FIELDS: dict[str, str] = {
    "q": "link_position",
    "dq": "link_velocity",
    "ref_1": "reference_1",
    "ref_2": "reference_2",
    "tau": "link_torque",
    "stiff": "stiffness",
}
"""Quantity in each field of the toolbox's `state_info` message. asrsim's message adds a header, and has the type float64
instead of float32."""

_OWN_TOPICS = {
    *LINK_STATE_FIELDS.values(),
    *(f"motor_{i}_{what}" for i in range(1, MOST_MOTORS + 1) for what in ("position", "velocity", "torque")),
    *(f"elastic_torque_{i}" for i in range(1, MOST_MOTORS + 1)),
}
"""Quantities of the toolbox's messages about a joint, which have one topic for each motor."""

DETAIL_FIELDS: tuple[str, ...] = tuple(
    name for name, quantity in QUANTITIES.items() if name not in _OWN_TOPICS and not quantity.apart
)
"""Quantities without a separate topic. They share one message for each joint, with NaN for quantities that are not recorded."""

SAMPLE_FIELDS: tuple[str, ...] = tuple(name for name, quantity in QUANTITIES.items() if not quantity.apart)
"""Quantities in the message that contains all quantities of a joint."""

_FIELDS: dict[str, str] = {
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec",
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "std_msgs/Float64": "float64 data",
    "std_msgs/String": "string data",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Quaternion": "float64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1",
    "geometry_msgs/Transform": "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation",
    "geometry_msgs/TransformStamped": "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform",
    "geometry_msgs/Vector3Stamped": "std_msgs/Header header\ngeometry_msgs/Vector3 vector",
    "tf2_msgs/TFMessage": "geometry_msgs/TransformStamped[] transforms",
    "sensor_msgs/JointState": (
        "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort"
    ),
    "std_msgs/MultiArrayDimension": "string label\nuint32 size\nuint32 stride",
    "std_msgs/MultiArrayLayout": "std_msgs/MultiArrayDimension[] dim\nuint32 data_offset",
    "std_msgs/Float64MultiArray": "std_msgs/MultiArrayLayout layout\nfloat64[] data",
    "rosgraph_msgs/Clock": "builtin_interfaces/Time clock",
    "asrsim_msgs/Command": "std_msgs/Header header\nstring joint\nstring reference\nuint64 substep\nfloat64 value",
    "asrsim_msgs/Wrench": "\n".join(
        ["std_msgs/Header header", "string body", "uint64 substep"]
        + [f"float64 {name}_{axis}" for name in ("point", "force", "torque") for axis in "xyz"]
    ),
    "asrsim_msgs/LinkState": "\n".join(["std_msgs/Header header", *(f"float64 {name}" for name in LINK_STATE_FIELDS)]),
    "asrsim_msgs/JointSample": "\n".join(["std_msgs/Header header", *(f"float64 {name}" for name in SAMPLE_FIELDS)]),
    "asrsim_msgs/JointDetails": "\n".join(["std_msgs/Header header", *(f"float64 {name}" for name in DETAIL_FIELDS)]),
}

OWN_MESSAGES = {name.split("/")[1]: text + "\n" for name, text in _FIELDS.items() if name.startswith("asrsim_msgs/")}
"""Definitions of asrsim's messages by name, as in the ROS package `asrsim_msgs`."""

_SEPARATOR = "=" * 80


def schema_name(message: str) -> str:
    """Name of a message in MCAP and ROS 2: `std_msgs/msg/Float64` for `std_msgs/Float64`."""
    package, name = message.split("/")
    return f"{package}/msg/{name}"


def message_definition(message: str) -> str:
    """Definition of a message, followed by the definitions of the messages in it, as rosbag2 stores them."""
    parts = [_FIELDS[message]]
    parts += [f"{_SEPARATOR}\nMSG: {name}\n{_FIELDS[name]}" for name in _dependencies(message)]
    return "\n".join(parts) + "\n"


def _dependencies(message: str) -> list[str]:
    found: list[str] = []
    waiting = [message]
    while waiting:
        for line in _FIELDS[waiting.pop(0)].splitlines():
            name = line.split()[0].removesuffix("[]")
            if name in _FIELDS and name not in found:
                found.append(name)
                waiting.append(name)
    return found


DESCRIPTION_TOPIC = "/robot_description"

REFERENCE_TOPICS: dict[int | None, tuple[str, ...]] = {
    0: ("torque_command",),
    1: ("link_command",),
    2: ("reference_1", "reference_2"),
    3: ("equilibrium_position", "stiffness_preset"),
    4: ("motor_1_command", "motor_2_command"),
    5: ("reference_1", "reference_2"),
    6: ("equilibrium_position", "stiffness_preset"),
    7: ("motor_1_voltage_command", "motor_2_voltage_command"),
    8: ("motor_1_current_command", "motor_2_current_command"),
}
"""Operation mode -> names of its reference topics: the toolbox's names, or asrsim's names for modes that the toolbox lacks."""


def reference_topics(mode: int | None, motors: int) -> tuple[str, ...]:
    """Names of the reference topics of a joint with this number of motors. Modes with a reference for each motor have a topic
    for each motor.
    """
    names = REFERENCE_TOPICS.get(mode, ())
    per_motor = len(names) > 1 and names[1] == names[0].replace("1", "2")
    more = [names[0].replace("1", str(i)) for i in range(3, motors + 1)] if per_motor else []
    return (*names, *more)[: 1 if motors == 1 else None]


@dataclass(frozen=True, kw_only=True)
class Topic:
    """Topic of a log."""

    name: str
    message: str
    """Short type, such as `sensor_msgs/JointState`."""
    template: CdrTemplate
    canonical: bool = True
    """Whether the quantities of this topic are read from this topic when a log is read; False: the topic repeats other
    topics."""


def robot_topics(
    joints: Sequence[JointInfo], *, compact: bool = False, arrays: bool = True, external: bool = True
) -> tuple[Topic, ...]:
    """Topics in every row of a log, the time first.

    Args:
        joints: Joints of the robot.
        compact: Whether one message with all numbers of a joint replaces the toolbox's messages.
        arrays: Whether to add the arrays for the whole robot that the toolbox's manager publishes.
        external: Whether to add the topic of external torques.
    """
    paths = topic_paths(joints)
    # Also store the simulated time as a float64 in s, since log times are rounded to ns.
    topics = [
        Topic(name="/asrsim/time", message="std_msgs/Float64", template=CdrBuilder().float64(MessageColumn("time")).build())
    ]
    for joint, path in zip(joints, paths, strict=True):
        if compact:
            topics += _numbers(f"{path}/state", joint, SAMPLE_FIELDS, "asrsim_msgs/JointSample")
        else:
            topics += _joint_topics(joint, path, external=external)
        known = {*SAMPLE_FIELDS} if compact else {*SAMPLE_FIELDS} | _OWN_TOPICS
        for quantity in joint.quantities:
            if quantity not in known:
                topics += _numbers(path + _ros_path(quantity), joint, [quantity])
    # The toolbox's manager publishes arrays with one entry for each joint with an actuator.
    for namespace in dict.fromkeys(joint.namespace for joint in joints if arrays and not compact):
        members = [joint for joint in joints if joint.namespace == namespace and joint.mode is not None]
        topics += _states(f"{_ros_path(namespace)}/robot_state", members, "link")
        for i in range(1, max((joint.motors for joint in members), default=0) + 1):
            topics += _states(f"{_ros_path(namespace)}/motor_{i}_state", members, f"motor_{i}")
    return (*topics, *_states("/joint_states", joints, "link"))


def body_topic(bodies: Sequence[str]) -> Topic:
    """Topic `/tf` with the pose of every body in the world frame."""
    builder = CdrBuilder().uint32(len(bodies))
    for body in bodies:
        builder.header("world").string(body).numbers(MessageColumn("body", body, index) for index in range(7))
    return Topic(name="/tf", message="tf2_msgs/TFMessage", template=builder.build())


def contact_topic(contact: str) -> Topic:
    """Topic `/contacts/<first>/<second>` with the force on the first body in the world frame."""
    force = CdrBuilder().header("world").numbers(MessageColumn("contact", contact, index) for index in range(3))
    return Topic(name="/contacts" + _ros_path(contact), message="geometry_msgs/Vector3Stamped", template=force.build())


def topic_paths(joints: Sequence[JointInfo]) -> tuple[str, ...]:
    """Unique path `/<namespace>/<joint>` of every joint, in characters that ROS allows."""
    paths: list[str] = []
    for joint in joints:
        path = plain = _ros_path(f"{joint.namespace}/{joint.name.replace('/', '_')}")
        number = 1
        while path in paths:
            number += 1
            path = f"{plain}_{number}"
        paths.append(path)
    return tuple(paths)


def _numbers(
    name: str, joint: JointInfo, quantities: Collection[str], message: str = "std_msgs/Float64", *, canonical: bool = True
) -> Iterator[Topic]:
    """Topic with quantities of a joint, if one of them is recorded. Messages other than Float64 begin with a header."""
    if any(quantity in joint.quantities for quantity in quantities):
        builder = CdrBuilder() if message == "std_msgs/Float64" else CdrBuilder().header()
        template = builder.numbers(_of_joint(joint, quantities)).build()
        yield Topic(name=name, message=message, template=template, canonical=canonical)


def _joint_topics(joint: JointInfo, path: str, *, external: bool) -> Iterator[Topic]:
    yield from _numbers(f"{path}/link_state", joint, LINK_STATE_FIELDS.values(), "asrsim_msgs/LinkState")
    motors = range(1, joint.motors + 1)
    for i in motors:
        yield from _states(f"{path}/motor_{i}_state", [joint], f"motor_{i}", canonical=True)
    for i in motors:
        yield from _numbers(f"{path}/torque_el{i}_state", joint, [f"elastic_torque_{i}"])
    for i, name in enumerate(reference_topics(joint.mode, joint.motors), start=1):
        # Publish commands as they were sent, before delays and other imperfections.
        sent = f"sent_reference_{i}"
        yield from _numbers(f"{path}/{name}", joint, [sent if sent in joint.quantities else f"reference_{i}"], canonical=False)
    if external:
        yield from _numbers(f"{path}/external_torque", joint, ["external_torque"], canonical=False)
    yield from _numbers(f"{path}/details", joint, DETAIL_FIELDS, "asrsim_msgs/JointDetails")


def _states(name: str, joints: Sequence[JointInfo], part: str, *, canonical: bool = False) -> Iterator[Topic]:
    """Topic with the JointState of a part (link, motor_1 or motor_2) of some joints, if a quantity of the part is recorded."""
    quantities = [f"{part}_{what}" for what in ("position", "velocity", "torque")]
    if any(quantity in joint.quantities for joint in joints for quantity in quantities):
        columns = [[column for joint in joints for column in _of_joint(joint, [quantity])] for quantity in quantities]
        yield joint_state(name, joints, columns, canonical=canonical)


def joint_state(
    name: str, joints: Sequence[JointInfo], columns: Sequence[Sequence[MessageColumn | None]], *, canonical: bool = True
) -> Topic:
    """Topic with the JointState of some joints. columns: sources of positions, velocities and efforts; None for NaN."""
    builder = CdrBuilder().header().strings([joint.name for joint in joints])
    for sequence in columns:
        builder.float64s(sequence)
    return Topic(name=name, message="sensor_msgs/JointState", template=builder.build(), canonical=canonical)


def _of_joint(joint: JointInfo, quantities: Iterable[str]) -> list[MessageColumn | None]:
    """Sources of a joint's quantities; None for quantities that are not recorded."""
    return [MessageColumn("value", name, joint.name) if name in joint.quantities else None for name in quantities]


def _ros_path(name: str) -> str:
    """ROS path for a name: parts of letters, digits and underscores that start with no digit; empty for an empty name."""
    parts = [re.sub(r"\W", "_", part, flags=re.ASCII) for part in name.split("/") if part]
    return "".join(f"/_{part}" if part[0].isdecimal() else f"/{part}" for part in parts)
