"""ROS bags made of given messages."""

import numpy as np

START = 1_700_000_000_000_000_000
"""Time of recording of the first message, ns."""
STATE, NUMBER = "sensor_msgs/msg/JointState", "std_msgs/msg/Float64"


def write_bag(path, kind, topics, times, *, definitions=None, version=9):
    """Write a bag. kind: ros1, sqlite3 or mcap. topics: by topic, the type of the messages, and a function that makes
    a message, or None, from the message classes, the message's number and its time in ns. definitions: texts of further message
    types, by name."""
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    ros1 = kind == "ros1"
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    for name, text in (definitions or {}).items():
        store.register(get_types_from_msg(text, name))
    serialise = store.serialize_ros1 if ros1 else store.serialize_cdr
    with Writer1(path) if ros1 else Writer2(path, version=version, storage_plugin=StoragePlugin[kind.upper()]) as bag:
        opened = {topic: bag.add_connection(topic, message, typestore=store) for topic, (message, _) in topics.items()}
        for i, time in enumerate(map(int, times)):
            for topic, (message, make) in topics.items():
                if (made := make(store.types, i, time)) is not None:
                    bag.write(opened[topic], time, serialise(made, message))
    return path


def header(types, stamp):
    """Header with a stamp in ns."""
    made = types["std_msgs/msg/Header"]
    fields = {"stamp": types["builtin_interfaces/msg/Time"](*divmod(stamp, 10**9)), "frame_id": ""}
    return made(**fields, **({"seq": 0} if "seq" in made.__dataclass_fields__ else {}))


def joint_state(types, stamp, names, position, effort):
    """State of joints without velocities."""
    parts = {"position": position.copy(), "velocity": np.array([]), "effort": effort.copy()}
    return types[STATE](header=header(types, stamp), name=list(names), **parts)


def ramp_bag(path, kind):
    """Bag of 1 s at 10 Hz: /q rises to 1, and so does the position of joint a, whose stamps are on another clock."""

    def state(types, i, time):
        values = np.array([0.1 * i, -0.1 * i])
        return joint_state(types, 10**11 + i * 50_000_000, ["a", "b"], values, values)

    topics = {"/q": (NUMBER, lambda types, i, time: types[NUMBER](0.1 * i)), "/states": (STATE, state)}
    return write_bag(path, kind, topics, START + 10**8 * np.arange(11))
