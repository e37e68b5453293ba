"""ROS node of a user, run by a Python with rclpy but without asrsim. It reads every topic, sends commands,
and prints what it observed as JSON.

Arguments: duration in s, ROS domain, rate of the commands in Hz.
"""

import importlib
import json
import math
import os
import sys
import time

os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"

import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import Float64, Float64MultiArray

SECONDS, DOMAIN, RATE = float(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3])


def message_class(kind):
    package, _, name = kind.split("/")
    return getattr(importlib.import_module(f"{package}.msg"), name)


def mine(infos):
    return [info for info in infos if info.node_name == "asrsim"]


def discovered(node):
    """Types of the discovered topics by name. Discovery ends when no new topic has appeared for 1.5 s."""
    topics, since, began = {}, time.time(), time.time()
    while time.time() - began < 60 and (not topics or time.time() - since < 1.5):
        found = {
            name: kinds[0] for name, kinds in node.get_topic_names_and_types() if name not in ("/rosout", "/parameter_events")
        }
        if found != topics:
            topics, since = found, time.time()
        time.sleep(0.05)
    return topics


def subscribe(node, name, kind):
    quality = QoSProfile(depth=2000)
    if name in ("/robot_description", "/tf_static"):
        quality.durability = DurabilityPolicy.TRANSIENT_LOCAL
    return node.create_subscription(kind, name, lambda message: None, quality)


def main():
    rclpy.init(domain_id=DOMAIN)
    node = rclpy.create_node("user")
    topics = discovered(node)
    outlets = [name for name in topics if mine(node.get_publishers_info_by_topic(name))]
    inlets = [name for name in topics if mine(node.get_subscriptions_info_by_topic(name))]
    listening = {name: (subscribe(node, name, message_class(topics[name])), message_class(topics[name])) for name in outlets}
    publishers = {name: node.create_publisher(message_class(topics[name]), name, 10) for name in inlets}
    time.sleep(1.0)
    latched = {}
    for name, (subscription, kind) in listening.items():
        # Messages that arrived during discovery do not count.
        while (taken := subscription.handle.take_message(kind, False)) is not None:
            if name == "/robot_description":
                latched[name] = len(taken[0].data)
    counts, gaps, numbers, last = {}, {}, {}, {}

    def read():
        """Take all waiting messages; return whether there was one."""
        found = False
        for name, (subscription, kind) in listening.items():
            while (taken := subscription.handle.take_message(kind, False)) is not None:
                found = True
                message, about = taken
                counts[name] = counts.get(name, 0) + 1
                number = about["publication_sequence_number"]
                if name in numbers and number > numbers[name] + 1:
                    gaps[name] = gaps.get(name, 0) + number - numbers[name] - 1
                numbers[name], last[name] = number, message
        return found

    equilibria = [name for name in inlets if name.endswith("equilibrium_position")]
    presets = [name for name in inlets if name.endswith("reference_2") and topics[name].endswith("MultiArray")]
    began = due = time.time()
    while (now := time.time()) - began < SECONDS:
        if RATE and now >= due:
            due += 1.0 / RATE
            for number, name in enumerate(equilibria):
                value = 0.3 * math.sin(6.0 * (now - began) + number)
                publishers[name].publish(Float64(data=value))
            for name in presets:
                publishers[name].publish(Float64MultiArray(data=[0.25] * len(equilibria)))
        if not read():
            time.sleep(1e-4)
    state, applied = last.get("/joint_states"), last.get("/applied_commands")
    print(json.dumps({
        "topics": topics, "outlets": outlets, "inlets": inlets, "counts": counts, "gaps": gaps,
        "description": latched,
        "positions": dict(zip(state.name, state.position, strict=True)) if state is not None else {},
        "applied": dict(zip(applied.name, applied.position, strict=True)) if applied is not None else {},
    }))  # fmt: skip
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
