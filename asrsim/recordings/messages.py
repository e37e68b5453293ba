"""Numbers out of decoded messages of any type: flat labels and values, joints where the message names them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from asrsim.quantities import QUANTITIES

_LONGEST = 64
"""Arrays longer than this are pictures, scans or maps, not signals."""
_NAMES = ("name", "names", "joint_names")
_OWN_NAMES = ("name", "joint_name", "joint", "label", "id")
"""Fields by which one object of a list says what it is of."""
_JOINT_STATE = {"position": "position", "velocity": "velocity", "effort": "torque"}
_POINTS = {"positions": "link_position", "velocities": "link_velocity", "effort": "link_torque"}
_COMMANDS = ("command", "cmd", "desired", "reference", "target", "setpoint")
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
Label = tuple[str, str | None]
"""Path of a number in a message, and the joint that the message names for it."""


class NoSignal(Exception):  # noqa: N818
    """The message holds arrays that are too long for signals."""


def stamp_of(message: Any) -> int | None:
    """Stamp of a header, or of a message without one, in ns; None where there is none, or a zero one."""
    for holder, key in ((member(message, "header"), "stamp"), (message, "stamp"), (message, "timestamp"), (message, "time")):
        stamp = member(holder, key)
        whole, rest = (
            next((value for name in names if (value := member(stamp, name)) is not None), None)
            for names in (("sec", "secs"), ("nanosec", "nsec", "nsecs"))
        )
        if isinstance(whole, int) and isinstance(rest, int):
            return (whole * 1_000_000_000 + rest) or None
    return None


def member(message: Any, key: str) -> Any:
    """A field of a message or of an object of JSON; None where it has none."""
    return message.get(key) if isinstance(message, dict) else getattr(message, key, None)


def flatten(message: Any) -> Iterator[tuple[Label, float]]:
    """All numbers of a message, or of plain JSON, with their labels. Raises NoSignal."""
    return _walk(message, "", ())


def _members(message: Any) -> dict[str, Any]:
    if isinstance(message, dict):
        return message
    return {field.name: getattr(message, field.name) for field in fields(message) if not field.name.startswith("__")}


def _is_number(value: Any) -> bool:
    return isinstance(value, bool | int | float | np.number | np.bool_)


def _walk(message: Any, prefix: str, names: Sequence[str]) -> Iterator[tuple[Label, float]]:
    members = _members(message)
    for key in _NAMES:
        if isinstance(told := members.get(key), list) and told and isinstance(told[0], str):
            names = told
    interfaces, values = members.get("interface_names"), members.get("values")
    if len(members) == 2 and interfaces is not None and values is not None and len(interfaces) == len(values):
        # ros2_control: names that stand apart from their values, in any order
        yield from (((f"{prefix}{name}", None), float(value)) for name, value in zip(interfaces, values, strict=True))
        return
    for key, value in members.items():
        if key in ("header", "layout") or (key in ("stamp", "timestamp", "time") and not _is_number(value)):
            continue
        if _is_number(value):
            yield (f"{prefix}{key}", None), float(value)
        elif isinstance(value, np.ndarray | list | tuple):
            yield from _entries(f"{prefix}{key}", value, names)
        elif isinstance(value, dict) or is_dataclass(value):
            yield from _walk(value, f"{prefix}{key}.", names)


def _entries(label: str, value: Any, names: Sequence[str]) -> Iterator[tuple[Label, float]]:
    if len(value) > _LONGEST:
        raise NoSignal
    objects = [item for item in value if isinstance(item, dict) or is_dataclass(item)]
    own = next((told for key in _OWN_NAMES if (told := _told(objects, key))), None) if len(objects) == len(value) else None
    named: Sequence[Any] = own or (names if len(names) == len(value) else ())
    for i, item in enumerate(value):
        place = f"{label}[{named[i] if named else i}]"
        if _is_number(item):
            yield (place, str(named[i]) if named else None), float(item)
        elif isinstance(item, dict) or is_dataclass(item):
            yield from _walk(item, f"{place}.", ())


def _told(items: Sequence[Any], key: str) -> list[Any] | None:
    """What the objects of a list say under `key`, where each says another word or small number; else None."""
    told = [member(item, key) for item in items]
    words = all(isinstance(one, str) and one for one in told)
    numbers = all(isinstance(one, int) and not isinstance(one, bool) and 0 <= one < _LONGEST for one in told)
    return told if told and (words or numbers) and len(set(told)) == len(told) else None


def understand(topic: str, kind: str, label: str, joint: str | None) -> tuple[str | None, str | None]:
    """Joint and quantity of a labelled number by its topic and message type, as far as these fix them."""
    parts = [part for part in topic.split("/") if part]
    last, field = parts[-1] if parts else "", label.partition("[")[0]
    if kind.endswith("/JointState") and field in _JOINT_STATE:
        if any(word in topic.lower() for word in _COMMANDS):
            return joint, "reference_1" if field == "position" else None
        side = next((name for name in ("motor_1", "motor_2") if name in topic.lower()), "link")
        return joint, f"{side}_{_JOINT_STATE[field]}"
    if field in ("data", "value") and last in TOPICS and len(parts) > 1 and "[" not in label:
        return parts[-2], TOPICS[last]
    if last == "link_state" and field in _LINK_STATE and len(parts) > 1:
        return parts[-2], _LINK_STATE[field]
    head, _, tail = field.rpartition(".")
    if joint is not None and tail in _POINTS:
        # Controller states of ros_control: measured and desired points of named joints.
        if any(word in head for word in ("desired", "reference")):
            return joint, "reference_1" if tail == "positions" else None
        if any(word in head for word in ("actual", "feedback")):
            return joint, _POINTS[tail]
    return joint, None
