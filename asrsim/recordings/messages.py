"""Numbers out of decoded ROS messages of any type: flat labelled values, joints named where the message names them."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from asrsim.quantities import QUANTITIES

_LONGEST = 64
"""Arrays longer than this are pictures, scans or maps, not signals."""
NAME_FIELDS = ("name", "names", "joint_names")
_OWN_NAMES = ("name", "joint_name", "joint", "label", "id")
"""Fields by which one object of a list says what it is of."""
_STAMPS = ("stamp", "timestamp", "time")
"""Fields of a message that hold when it was sent, in seconds and nanoseconds."""
_TIME = (("sec", "secs"), ("nanosec", "nsec", "nsecs"))
"""How these two are called."""
_JOINT_STATE = {"position": "position", "velocity": "velocity", "effort": "torque"}
_STATE_OF = {**{name: name for name in _JOINT_STATE}, "positions": "position", "velocities": "velocity", "efforts": "effort"}
TOPICS: dict[str, str] = {
    "torque_command": "reference_1", "link_command": "reference_1", "reference_1": "reference_1", "reference_2": "reference_2",
    "equilibrium_position": "reference_1", "stiffness_preset": "reference_2", "motor_1_command": "reference_1",
    "motor_2_command": "reference_2", "torque_m1_command": "reference_1", "torque_m2_command": "reference_2",
    **{f"motor_{i}_{what}_command": f"reference_{i}" for i in (1, 2) for what in ("voltage", "current")},
    "torque_el1_state": "elastic_torque_1", "torque_el2_state": "elastic_torque_2",
    **{name: name for name in QUANTITIES},
}  # fmt: skip
"""Last part of a Float64 topic `.../<joint>/<topic>` of the toolbox, and what it carries."""
_LINK_STATE = {
    "q": "link_position", "dq": "link_velocity", "ref_1": "reference_1", "ref_2": "reference_2", "tau": "link_torque",
    "stiff": "stiffness",
}  # fmt: skip
_ARRAY = re.compile(
    r"(?P<prefix>.*?)(?P<field>joint_names|names?|positions?|velocity|velocities|efforts?)[\[_.]?(?P<place>\d+)\]?"
)
_FIELDS: dict[type, tuple[str, ...]] = {}


class Skip(Exception):  # noqa: N818
    """The message holds no signal."""


def stamp_of(message: Any) -> int | None:
    """Stamp of a header, or of a message without one, in ns; None where there is none, or a zero one."""
    for holder, key in ((_member(message, "header"), "stamp"), *((message, key) for key in _STAMPS)):
        stamp = _member(holder, key)
        whole, parts = (
            next((_member(stamp, name) for name in names if _member(stamp, name) is not None), None) for names in _TIME
        )
        if isinstance(whole, int) and isinstance(parts, int):
            return (whole * 1_000_000_000 + parts) or None
    return None


def _member(message: Any, key: str) -> Any:
    """A field of a message or of an object of JSON; None where it has none."""
    return message.get(key) if isinstance(message, dict) else getattr(message, key, None)


def flatten(message: Any) -> tuple[list[tuple[str, str | None]], list[float]]:
    """Labels with joints, and values, of all numbers in a message (or in plain JSON tables and lists)."""
    labels: list[tuple[str, str | None]] = []
    values: list[float] = []
    for label, joint, value in _walk(message, "", ()):
        labels.append((label, joint))
        values.append(value)
    return labels, values


def _members(message: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(message, dict):
        yield from message.items()
        return
    kind = type(message)
    names = _FIELDS.get(kind)
    if names is None:
        names = _FIELDS[kind] = tuple(field.name for field in fields(message) if not field.name.startswith("__"))
    for name in names:
        yield name, getattr(message, name)


def _walk(message: Any, prefix: str, names: Sequence[str]) -> Iterator[tuple[str, str | None, float]]:
    members = list(_members(message))
    for key, value in members:
        if key in NAME_FIELDS and isinstance(value, list) and value and isinstance(value[0], str):
            names = value
    if (told := _interfaces(dict(members))) is not None:
        yield from ((f"{prefix}{name}", None, float(value)) for name, value in told)
        return
    for key, value in members:
        if key in ("header", "stamp", "layout") or (key in _STAMPS and (isinstance(value, dict) or is_dataclass(value))):
            continue
        label = f"{prefix}{key}"
        if isinstance(value, bool | int | float | np.number | np.bool_):
            yield label, None, float(value)
        elif isinstance(value, np.ndarray | list | tuple):
            yield from _sequence(label, value, names)
        elif isinstance(value, dict) or is_dataclass(value):
            yield from _walk(value, f"{label}.", names)


def _interfaces(members: Mapping[str, Any]) -> Iterator[tuple[str, Any]] | None:
    """What ros2_control knows of a joint: names that stand apart from their values, in any order; None for all else."""
    names, values = members.get("interface_names"), members.get("values")
    if names is None or values is None or len(names) != len(values) or len(members) != 2:
        return None
    return zip(names, values, strict=True)


def _sequence(label: str, value: Any, names: Sequence[str]) -> Iterator[tuple[str, str | None, float]]:
    if len(value) > _LONGEST:
        raise Skip
    labelled = len(names) == len(value)
    if not labelled and (own := own_names(value)) is not None:
        for said, item in zip(own[1], value, strict=True):
            members = {key: member for key, member in _members(item) if key != own[0]}
            yield from _walk(members, f"{label}[{said}].", ())
        return
    for i, item in enumerate(value):
        name = names[i] if labelled else None
        place = f"{label}[{name if name is not None else i}]"
        if isinstance(item, bool | int | float | np.number | np.bool_):
            yield place, name, float(item)
        elif isinstance(item, dict) or is_dataclass(item):
            yield from _walk(item, f"{place}.", ())


def own_names(items: Sequence[Any]) -> tuple[str, list[str | int]] | None:
    """The field by which objects of a list say which of them they are, and what each says; None where they do not.

    They may stand in any order, and in another one in the next message. Numbers are those of a robot's motors, not of what
    a camera has counted.
    """
    for key in _OWN_NAMES if all(isinstance(one, dict) or is_dataclass(one) for one in items) else ():
        told: list[Any] = [one.get(key) if isinstance(one, dict) else getattr(one, key, None) for one in items]
        words = all(isinstance(one, str) and one for one in told)
        numbers = all(isinstance(one, int) and not isinstance(one, bool) and 0 <= one < _LONGEST for one in told)
        if (words or numbers) and len(set(told)) == len(told):
            return key, told
    return None


def named_joints(labels: Sequence[str], words: Mapping[int, str], topic: str) -> dict[int, tuple[str | None, str | None]]:
    """Column -> (joint, quantity) of a JointState in a table: the word under `name0` is the joint of `position0`.

    words: column of text -> its one word. topic: of the messages, or the file's name.
    """
    spelled = {i: match for i, label in enumerate(labels) if (match := _ARRAY.fullmatch(label))}
    joints = {(m["prefix"], int(m["place"])): words[i] for i, m in spelled.items() if m["field"] in NAME_FIELDS and i in words}
    found: dict[int, tuple[str | None, str | None]] = {}
    for i, match in spelled.items():
        state = _STATE_OF.get(match["field"])
        # The names of a controller's state stand above its points: `joint_names0`, `desired.positions0`.
        above = [prefix for prefix, place in joints if place == int(match["place"]) and match["prefix"].startswith(prefix)]
        if state is None or not above:
            continue
        prefix = max(above, key=len)
        point = match["prefix"].removeprefix(prefix)
        kind = "" if point else "sensor_msgs/JointState"
        field = point + match["field"] if point else state
        found[i] = understand(topic, kind, field, joints[prefix, int(match["place"])])[:2]
    return found


def mixed_names(labels: Sequence[str], text: Sequence[int], words: Mapping[int, str]) -> str | None:
    """The column of names that are not the same in every row: rows are of other joints than those above them."""
    fields = {i: match["field"] for i in text if (match := _ARRAY.fullmatch(labels[i])) is not None}
    return next((labels[i] for i, field in fields.items() if field in NAME_FIELDS and i not in words), None)


def understand(topic: str, kind: str, label: str, joint: str | None) -> tuple[str | None, str | None, str]:
    """Joint, quantity and unit of a labelled number by its topic and message type, as far as these fix them."""
    parts = [part for part in topic.split("/") if part]
    last = parts[-1] if parts else ""
    field = label.partition("[")[0]
    lower = topic.lower()
    if kind.endswith("/JointState") and field in _JOINT_STATE:
        commanded = any(word in lower for word in ("command", "cmd", "desired", "reference", "target", "setpoint"))
        if commanded:
            return joint, "reference_1" if field == "position" else None, ""
        side = next((name for name in ("motor_1", "motor_2") if name in lower), "link")
        return joint, f"{side}_{_JOINT_STATE[field]}", ""
    if field in ("data", "value") and "[" not in label and last in TOPICS and len(parts) > 1:
        return parts[-2], TOPICS[last], ""
    if field in ("data", "value") and "[" in label and last in ("reference_1", "reference_2"):
        return None, last, ""
    if last == "link_state" and field in _LINK_STATE and len(parts) > 1:
        return parts[-2], _LINK_STATE[field], ""
    if joint is not None:
        # Controller states of ros_control: actual/feedback and desired/reference points of named joints.
        head, _, tail = field.rpartition(".")
        if tail in ("positions", "velocities", "effort"):
            desired = any(word in head for word in ("desired", "reference"))
            if not desired and any(word in head for word in ("actual", "feedback")):
                quantity = {"positions": "link_position", "velocities": "link_velocity", "effort": "link_torque"}[tail]
                return joint, quantity, ""
            return joint, "reference_1" if desired and tail == "positions" else None, ""
    return joint, None, ""
