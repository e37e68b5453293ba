"""ROS 2 message definitions (`ros2msg` text) of everything a log contains or a live run sends: standard ones and ours."""

from __future__ import annotations

from asrsim.quantities import QUANTITIES

LINK_STATE_FIELDS: dict[str, str] = {
    "q": "link_position",
    "dq": "link_velocity",
    "ref_1": "reference_1",
    "ref_2": "reference_2",
    "tau": "link_torque",
    "stiff": "stiffness",
}
"""Fields of the toolbox's `state_info` message -> quantities. Ours has a header, and float64 instead of float32."""

_OWN_TOPICS = {
    *LINK_STATE_FIELDS.values(),
    *(f"motor_{i}_{what}" for i in (1, 2) for what in ("position", "velocity", "torque")),
    "elastic_torque_1",
    "elastic_torque_2",
}

DETAIL_FIELDS: tuple[str, ...] = tuple(
    name for name, quantity in QUANTITIES.items() if name not in _OWN_TOPICS and not quantity.apart
)
"""Quantities without a topic of the toolbox or their own; they share one message a joint, NaN where a joint does not
record one."""

SAMPLE_FIELDS: tuple[str, ...] = tuple(name for name, quantity in QUANTITIES.items() if not quantity.apart)
"""Quantities of a message that holds all of a joint."""

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
    "asrsim_msgs/LinkState": "\n".join(["std_msgs/Header header", *(f"float64 {name}" for name in LINK_STATE_FIELDS)]),
    "asrsim_msgs/JointSample": "\n".join(["std_msgs/Header header", *(f"float64 {name}" for name in SAMPLE_FIELDS)]),
    "asrsim_msgs/JointDetails": "\n".join(["std_msgs/Header header", *(f"float64 {name}" for name in DETAIL_FIELDS)]),
}

OWN_MESSAGES = {name.split("/")[1]: text + "\n" for name, text in _FIELDS.items() if name.startswith("asrsim_msgs/")}
"""Name -> definition of our own messages: what the ROS package `asrsim_msgs` holds."""

_SEPARATOR = "=" * 80


def schema_name(message: str) -> str:
    """The name MCAP and ROS 2 use: `std_msgs/Float64` -> `std_msgs/msg/Float64`."""
    package, name = message.split("/")
    return f"{package}/msg/{name}"


def schema_text(message: str) -> str:
    """The definition of a message followed by those of all the messages it is made of, as rosbag2 stores it."""
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
