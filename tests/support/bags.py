"""Small ROS bags."""

from __future__ import annotations

from pathlib import Path

import numpy as np


def write_bag(path: Path, ros1: bool) -> Path:
    """Write a bag of 1 s with two topics at 10 Hz: a Float64 sin(t), and a JointState of two joints with clock stamps."""
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    number, state = types.types["std_msgs/msg/Float64"], types.types["sensor_msgs/msg/JointState"]
    header, stamp = types.types["std_msgs/msg/Header"], types.types["builtin_interfaces/msg/Time"]
    writer = Writer1(path) if ros1 else Writer2(path, version=9, storage_plugin=StoragePlugin.MCAP)
    with writer as bag:
        topics = [
            bag.add_connection(name, kind.__msgtype__, typestore=types) for name, kind in (("/q", number), ("/states", state))
        ]
        serialise = types.serialize_ros1 if ros1 else types.serialize_cdr
        for index in range(11):
            time = 1_700_000_000_000_000_000 + index * 100_000_000
            sequence = {"seq": index} if ros1 else {}
            head = header(stamp=stamp(sec=100, nanosec=index * 50_000_000), frame_id="", **sequence)
            values = np.array([0.1 * index, -0.1 * index])
            message = state(header=head, name=["a", "b"], position=values, velocity=values, effort=values)
            bag.write(topics[0], time, serialise(number(data=0.1 * index), number.__msgtype__))
            bag.write(topics[1], time, serialise(message, state.__msgtype__))
    return path


ARM_TIME = 0.01 * np.arange(300)
ARM_ELBOW = 0.32 * (1 - np.cos(2 * np.pi * 0.7 * ARM_TIME))


def write_arm(path: Path, storage: str) -> Path:
    """Write a ROS 2 bag of two joints with a custom message: positions `q` follow the references `q_des` exactly."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg("float64[] q\nfloat64[] q_des\n", "lab_msgs/msg/Arm"))
    with Writer(path, version=9, storage_plugin=StoragePlugin[storage]) as bag:
        connection = bag.add_connection("/arm_state", "lab_msgs/msg/Arm", typestore=store)
        for t, elbow in zip(ARM_TIME, ARM_ELBOW, strict=True):
            q = np.array([0.6 * np.sin(np.pi * t) * np.exp(-0.2 * t) + 0.1 * t, elbow])
            message = store.types["lab_msgs/msg/Arm"](q, q)
            bag.write(connection, 1_700_000_000_000_000_000 + round(t * 1e9), store.serialize_cdr(message, "lab_msgs/msg/Arm"))
    return path
