"""The topics of a log: the toolbox's names under `/<namespace>/`, what viewers expect, and what only asrsim knows.

Every number is stored exactly once on a *canonical* topic, from which it is read back; robot-level arrays repeat some
for tools that expect them.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from asrsim.log.cdr import CdrBuilder, CdrTemplate, Column
from asrsim.log.messages import DETAIL_FIELDS, LINK_STATE_FIELDS, SAMPLE_FIELDS
from asrsim.samples import JointInfo

TIME_TOPIC = "/asrsim/time"
"""Simulated time as float64 in s: the log time is rounded to ns."""
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
"""Operation mode -> the toolbox's names of its reference topics; of modes that it does not have, ours."""


@dataclass(frozen=True, kw_only=True)
class Topic:
    """A topic of one log."""

    name: str
    message: str
    """Short type, such as `sensor_msgs/JointState`."""
    template: CdrTemplate
    canonical: bool = True
    """Its numbers are read back from here."""


def robot_topics(
    joints: Sequence[JointInfo], *, compact: bool = False, arrays: bool = True, external: bool = True
) -> tuple[Topic, ...]:
    """Topics that are in every row of a log, the time first.

    compact: one message a joint with all its numbers, instead of the toolbox's; arrays: the robot-level arrays that the
    toolbox's manager publishes too; external: the topic of external torques, which there may be none of.
    """
    paths = topic_paths(joints)
    topics = [Topic(name=TIME_TOPIC, message="std_msgs/Float64", template=CdrBuilder().float64(Column("time")).build())]
    for joint, path in zip(joints, paths, strict=True):
        topics += _whole_joint(joint, path) if compact else _joint_topics(joint, path, external=external)
    for namespace in dict.fromkeys(joint.namespace for joint in joints if arrays and not compact):
        members = [joint for joint in joints if joint.namespace == namespace and joint.mode is not None]
        topics += _array_topics(members, _ros_path(namespace))
    if joints:
        columns = [_of(joints, f"link_{what}") for what in ("position", "velocity", "torque")]
        topics.append(joint_state("/joint_states", joints, columns, canonical=False))
    return tuple(topics)


def body_topic(bodies: Sequence[str]) -> Topic:
    """`/tf` with the pose of every body in the world frame."""
    builder = CdrBuilder().uint32(len(bodies))
    for body in bodies:
        builder.header("world").string(body)
        for index in range(7):
            builder.float64(Column("body", body, index))
    return Topic(name="/tf", message="tf2_msgs/TFMessage", template=builder.build())


def contact_topic(contact: str) -> Topic:
    """`/contacts/<first>/<second>` with the force on the first body in the world frame."""
    builder = CdrBuilder().header("world")
    for index in range(3):
        builder.float64(Column("contact", contact, index))
    name = "/contacts" + _ros_path(contact)
    return Topic(name=name, message="geometry_msgs/Vector3Stamped", template=builder.build())


def topic_paths(joints: Sequence[JointInfo]) -> tuple[str, ...]:
    """`/<namespace>/<joint>` of every joint, in characters that ROS allows, no two alike."""
    paths: list[str] = []
    for joint in joints:
        path = plain = _ros_path(f"{joint.namespace}/{joint.name.replace('/', '_')}")
        number = 1
        while path in paths:
            number += 1
            path = f"{plain}_{number}"
        paths.append(path)
    return tuple(paths)


def _whole_joint(joint: JointInfo, path: str) -> Iterator[Topic]:
    """All numbers of a joint in one message, NaN where it does not record one; those with topics of their own beside it."""
    builder = CdrBuilder().header()
    for quantity in SAMPLE_FIELDS:
        builder.float64(Column("value", quantity, joint.name) if quantity in joint.quantities else None)
    yield Topic(name=f"{path}/state", message="asrsim_msgs/JointSample", template=builder.build())
    yield from _own_quantities(joint, path)


def _own_quantities(joint: JointInfo, path: str) -> Iterator[Topic]:
    for quantity in joint.quantities:
        if quantity not in SAMPLE_FIELDS:
            template = CdrBuilder().float64(Column("value", quantity, joint.name)).build()
            yield Topic(name=path + _ros_path(quantity), message="std_msgs/Float64", template=template)


def _joint_topics(joint: JointInfo, path: str, *, external: bool) -> Iterator[Topic]:
    def source(quantity: str) -> Column | None:
        return Column("value", quantity, joint.name) if quantity in joint.quantities else None

    def recorded(quantities: Sequence[str]) -> bool:
        return any(quantity in joint.quantities for quantity in quantities)

    def scalar(name: str, quantity: str, *, canonical: bool = True) -> Iterator[Topic]:
        if quantity in joint.quantities:
            template = CdrBuilder().float64(source(quantity)).build()
            yield Topic(name=f"{path}/{name}", message="std_msgs/Float64", template=template, canonical=canonical)

    if recorded(tuple(LINK_STATE_FIELDS.values())):
        builder = CdrBuilder().header()
        for quantity in LINK_STATE_FIELDS.values():
            builder.float64(source(quantity))
        yield Topic(name=f"{path}/link_state", message="asrsim_msgs/LinkState", template=builder.build())
    for index in (1, 2):
        quantities = [f"motor_{index}_{what}" for what in ("position", "velocity", "torque")]
        if recorded(quantities):
            yield joint_state(f"{path}/motor_{index}_state", [joint], [_of([joint], quantity) for quantity in quantities])
    for index in (1, 2):
        yield from scalar(f"torque_el{index}_state", f"elastic_torque_{index}")
    for index, name in enumerate(REFERENCE_TOPICS.get(joint.mode, ()), start=1):
        yield from scalar(name, f"reference_{index}", canonical=False)
    if external:
        yield from scalar("external_torque", "external_torque", canonical=False)
    if recorded(DETAIL_FIELDS):
        builder = CdrBuilder().header()
        for quantity in DETAIL_FIELDS:
            builder.float64(source(quantity))
        yield Topic(name=f"{path}/details", message="asrsim_msgs/JointDetails", template=builder.build())
    yield from _own_quantities(joint, path)


def _array_topics(joints: Sequence[JointInfo], path: str) -> Iterator[Topic]:
    """What the toolbox's manager publishes: one entry a joint with an actuator, in joint order."""
    names = {
        "robot_state": ("link_position", "link_velocity", "link_torque"),
        "motor_1_state": ("motor_1_position", "motor_1_velocity", "motor_1_torque"),
        "motor_2_state": ("motor_2_position", "motor_2_velocity", "motor_2_torque"),
    }
    for name, quantities in names.items():
        if any(quantity in joint.quantities for joint in joints for quantity in quantities):
            columns = [_of(joints, quantity) for quantity in quantities]
            yield joint_state(f"{path}/{name}", joints, columns, canonical=False)


def joint_state(
    name: str, joints: Sequence[JointInfo], columns: Sequence[Sequence[Column | None]], *, canonical: bool = True
) -> Topic:
    """A JointState of some joints; columns: sources of positions, velocities and efforts, None for NaN."""
    builder = CdrBuilder().header().strings([joint.name for joint in joints])
    for sequence in columns:
        builder.float64s(sequence)
    return Topic(name=name, message="sensor_msgs/JointState", template=builder.build(), canonical=canonical)


def _of(joints: Sequence[JointInfo], quantity: str) -> list[Column | None]:
    return [Column("value", quantity, joint.name) if quantity in joint.quantities else None for joint in joints]


def _ros_path(name: str) -> str:
    """A ROS name: letters, digits and underscores, no part starting with a digit; a slash in front; empty for nothing."""
    parts = [re.sub(r"\W", "_", part, flags=re.ASCII) for part in name.split("/") if part]
    return "".join(f"/_{part}" if part[0].isdecimal() else f"/{part}" for part in parts)
