"""Reads ROS 1 bags, ROS 2 bags and MCAP files without ROS, by the message definitions in the file."""

from __future__ import annotations

import json
import struct
from array import array
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.errors import Problem, RecordingError, counted, printable
from asrsim.log.topics import LINK_STATE_FIELDS, REFERENCE_TOPICS
from asrsim.quantities import QUANTITIES
from asrsim.recordings.data import EPOCH, Content, RawColumn, RawTable
from asrsim.recordings.reading import Reading

_SAME_CLOCK = 1.0
"""Largest difference between header stamps and times of recording for which both are taken to be on one clock, s."""
_LONGEST = 64
"""Largest number of entries in an array of signals; longer arrays are pictures, scans or maps."""
_NAMES = ("name", "names", "joint_names")
"""Message fields that name the entries of the other arrays in the message."""
_JOINT_STATE = {"position": "position", "velocity": "velocity", "effort": "torque"}
_COMMANDS = ("command", "cmd", "desired", "reference", "target", "setpoint")
TOPICS: dict[str, str] = {
    **{name: name for name in QUANTITIES},
    **{f"torque_el{i}_state": f"elastic_torque_{i}" for i in (1, 2)},
    **{name: f"reference_{i}" for names in REFERENCE_TOPICS.values() for i, name in enumerate(names, start=1)},
}
"""Quantity carried by a toolbox topic `.../<joint>/<topic>` of type Float64, by the last part of the topic."""
_FOREIGN = ("Image", "PointCloud", "LaserScan", "CameraInfo", "OccupancyGrid", "/Log", "String", "TFMessage", "tfMessage",
            "Diagnostic")  # fmt: skip
"""Parts of the names of message types that carry no signals."""
_NO_TIME = 2**63
"""Time stamps from this value on are invalid, ns."""
Label = tuple[str, str | None]
"""Path of a number in a message, and the joint that the message states for this number."""
Messages = Iterator[tuple[int, int, bytes]]
"""For each message: id of its topic, time of recording in ns, and its bytes."""


class NoSignal(Exception):  # noqa: N818
    """Raised for a message whose arrays are too long for signals."""


def _members(message: Any) -> Mapping[str, Any]:
    """Fields of a message or JSON object, by name; none for other values."""
    return message if isinstance(message, dict) else vars(message) if is_dataclass(message) else {}


def stamp_of(message: Any) -> int | None:
    """Time stamp of a message, ns, from its header or its own fields; None if the stamp is missing or zero."""
    members = _members(message)
    for stamp in (_members(members.get("header")).get("stamp"), members.get("stamp"), members.get("timestamp")):
        # Seconds and nanoseconds are called sec and nanosec, secs and nsecs, or sec and nsec, in any order.
        parts = {name[:1]: part for name, part in _members(stamp).items() if isinstance(part, int)}
        if {*parts} == {"s", "n"}:
            return (parts["s"] * 1_000_000_000 + parts["n"]) or None
    return None


def _is_number(value: Any) -> bool:
    return isinstance(value, bool | int | float | np.number | np.bool_)


def flatten(message: Any, prefix: str = "") -> Iterator[tuple[Label, float]]:
    """Labels and values of all numbers in a message or JSON object. Raises NoSignal."""
    members = _members(message)
    named = [members[key] for key in _NAMES if isinstance(members.get(key), list)]
    names: Sequence[str] = next((entries for entries in named if entries and isinstance(entries[0], str)), [])
    for key, value in members.items():
        if key in ("header", "layout") or (key in ("stamp", "timestamp") and not _is_number(value)):
            continue
        path = f"{prefix}{key}"
        array = isinstance(value, np.ndarray | list | tuple)
        if array and len(value) > _LONGEST:
            raise NoSignal
        fitting = array and len(names) == len(value)
        items = [(f"{path}[{names[i] if fitting else i}]", item) for i, item in enumerate(value)] if array else [(path, value)]
        for i, (place, item) in enumerate(items):
            if _is_number(item):
                yield (place, str(names[i]) if fitting else None), float(item)
            else:
                yield from flatten(item, f"{place}.")


def understand(topic: str, kind: str, label: str, joint: str | None) -> tuple[str | None, str | None]:
    """Joint and quantity of a number in a message, by its topic and message type; None for an unknown joint or quantity."""
    parts = [part for part in topic.split("/") if part]
    last, name = parts[-1] if parts else "", label.partition("[")[0]
    if kind.endswith("/JointState") and name in _JOINT_STATE:
        if any(word in topic.lower() for word in _COMMANDS):
            return joint, "reference_1" if name == "position" else None
        side = next((side for side in ("motor_1", "motor_2") if side in topic.lower()), "link")
        return joint, f"{side}_{_JOINT_STATE[name]}"
    if label in ("data", "value") and last in TOPICS and len(parts) > 1:
        return parts[-2], TOPICS[last]
    if last in ("link_state", "details") and len(parts) > 1 and (quantity := LINK_STATE_FIELDS.get(name, name)) in QUANTITIES:
        return parts[-2], quantity
    return joint, None


@dataclass
class _Topic:
    name: str
    kind: str
    decode: Callable[[bytes], Any] | None
    """Decoder of the messages; None: the topic is not read."""
    reason: str = ""


@dataclass
class _Group:
    """Messages of one topic that contain the same labels."""

    labels: tuple[Label, ...]
    """Labels in the order of the first message."""
    received: array[int] = field(default_factory=lambda: array("q"))
    stamped: array[int] = field(default_factory=lambda: array("q"))
    """Header stamps, ns; 0 for a message without stamp."""
    values: array[float] = field(default_factory=lambda: array("d"))


def read_bag(path: Path, reading: Reading) -> Content:
    """All numeric series of a bag. Raises RecordingError where nothing can be read."""
    findings: list[Problem] = []
    with ExitStack() as stack:
        if path.suffix.lower() in (".bag", ".db3") or path.is_dir():
            topics, messages = _open_bag(path, stack, findings)
        else:
            topics, messages = _open_mcap(path, stack, findings)
        tables = tuple(_tables(topics, messages, reading.time.columns, findings))
    unknown = [topic for topic in topics.values() if topic.decode is None]
    findings += [
        Problem(f"topic is not read: {one.reason}", key=one.name, value=one.kind, code="unknown-message-type")
        for one in unknown
    ]
    if not tables:
        names = ", ".join(f"{topic.name} ({topic.kind})" for topic in topics.values()) or "no topic"
        reasons = "; ".join(f"{topic.name}: {topic.reason}" for topic in unknown)
        raise RecordingError(
            f"contains no readable numeric messages; its topics: {names}" + (f"; {reasons}" if reasons else ""),
            code="unknown-message-type" if unknown else "no-numbers",
            hint="Expected sensor_msgs/JointState, std_msgs/Float64 or other numeric messages whose definitions are in the "
            "file",
        )  # fmt: skip
    return Content(format="bag", tables=tables, findings=tuple(findings))


def _open_bag(path: Path, stack: ExitStack, findings: list[Problem]) -> tuple[dict[int, _Topic], Messages]:
    from rosbags.rosbag1 import Reader as Reader1
    from rosbags.rosbag2 import Reader as Reader2

    ros1 = path.suffix.lower() == ".bag"
    try:
        reader: Any = stack.enter_context(Reader1(path) if ros1 else Reader2(path))
    except Exception as error:  # on damaged files rosbags raises errors of many types (struct, sqlite, KeyError, ...)
        raise RecordingError(
            f"cannot be read as a ROS {1 if ros1 else 2} bag: {error}", code="damaged",
            hint="A bag that was not closed can be repaired with `rosbag reindex` or `ros2 bag reindex`",
        ) from None  # fmt: skip
    types = _Types(ros1=ros1)
    topics = {
        one.id: types.topic(one.topic, one.msgtype, one.msgdef.data, one.msgdef.format.name) for one in reader.connections
    }

    def messages() -> Messages:
        wanted = [c for c in reader.connections if topics[c.id].decode is not None]
        try:
            for connection, stamp, data in reader.messages(connections=wanted) if wanted else ():
                yield connection.id, stamp, data
        except Exception as error:  # as above
            findings.append(Problem(f"the file is damaged ({str(error)[:80]}); it is read up to there", code="truncated"))

    return topics, messages()


def _open_mcap(path: Path, stack: ExitStack, findings: list[Problem]) -> tuple[dict[int, _Topic], Messages]:
    from mcap.exceptions import McapError
    from mcap.records import Channel, Message, Schema
    from mcap.stream_reader import StreamReader

    stream = stack.enter_context(path.open("rb"))
    types = {"ros1": _Types(ros1=True), "cdr": _Types(ros1=False)}
    schemas: dict[int, Schema] = {}
    topics: dict[int, _Topic] = {}

    def topic_of(channel: Channel) -> _Topic:
        schema, encoding = schemas.get(channel.schema_id), channel.message_encoding
        kind = schema.name if schema is not None else "without schema"
        if encoding == "json":
            return _Topic(channel.topic, kind, json.loads)
        if encoding not in types or schema is None:
            return _Topic(channel.topic, kind, None, f"its encoding '{encoding}' is unknown; known are cdr, ros1 and json")
        language = "IDL" if schema.encoding == "ros2idl" else "MSG"
        return types[encoding].topic(channel.topic, kind, schema.data.decode("utf-8", "replace"), language)

    def messages() -> Messages:
        try:
            for record in StreamReader(stream, record_size_limit=path.stat().st_size).records:
                if isinstance(record, Schema):
                    schemas[record.id] = record
                elif isinstance(record, Channel) and record.id not in topics:
                    topics[record.id] = topic_of(record)
                elif isinstance(record, Message) and record.channel_id in topics and record.log_time < _NO_TIME:
                    yield record.channel_id, record.log_time, record.data
        except (McapError, MemoryError, OverflowError, EOFError, ValueError, struct.error) as error:
            if not topics:
                raise RecordingError(f"cannot be read as MCAP: {type(error).__name__} {error}", code="damaged") from None
            findings.append(
                Problem("is truncated (was the recorder killed?); it is read up to its last complete chunk", code="truncated")
            )

    return topics, messages()


class _Types:
    """Message definitions of the file, and ROS's standard definitions where the file has none."""

    def __init__(self, *, ros1: bool) -> None:
        from rosbags.typesys import Stores, get_typestore

        self.ros1 = ros1
        self.own = get_typestore(Stores.EMPTY)
        self.standard = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.LATEST)

    def topic(self, name: str, kind: str, definition: str, language: str) -> _Topic:
        """Topic with its decoder, or why it cannot be decoded. language: language of the definition, MSG, IDL, or NONE."""
        from rosbags.typesys import get_types_from_idl, get_types_from_msg

        if any(word in kind for word in _FOREIGN):
            return _Topic(name, kind, None, "it carries no signals")
        full = kind if "/msg/" in kind else kind.replace("/", "/msg/", 1)
        store = self.standard
        reason = "its type is not a standard type, and the file does not define it"
        if definition.strip() and language != "NONE":
            try:
                found = get_types_from_msg(definition, full) if language == "MSG" else get_types_from_idl(definition)
                self.own.register({key: value for key, value in found.items() if key not in self.own.fielddefs})
                store = self.own
            except Exception as error:  # rosbags' parser raises errors of several types for invalid definitions
                reason = f"its definition cannot be parsed ({str(error)[:80]})"
        if full not in store.fielddefs:
            return _Topic(name, kind, None, reason)
        read = store.deserialize_ros1 if self.ros1 else store.deserialize_cdr
        return _Topic(name, kind, lambda data: read(data, full))


def _tables(
    topics: dict[int, _Topic], messages: Messages, stated: Sequence[str], findings: list[Problem]
) -> Iterator[RawTable]:
    """Tables of a bag: one for each topic and set of labels in its messages. stated: time columns that the user states."""
    groups: dict[tuple[int, frozenset[Label]], _Group] = {}
    broken: Counter[int] = Counter()
    for topic_id, logged, data in messages:
        topic = topics[topic_id]
        if topic.decode is None:
            continue
        try:
            message = topic.decode(data)
            numbers = dict(flatten(message))
        except NoSignal:
            topic.decode, topic.reason = None, "its arrays are too long for signals"
            continue
        except Exception:  # a message that does not match its definition is counted and reported
            broken[topic_id] += 1
            continue
        if numbers:
            group = groups.setdefault((topic_id, frozenset(numbers)), _Group(tuple(numbers)))
            group.received.append(logged)
            group.stamped.append(stamp_of(message) or 0)
            group.values.extend(numbers[label] for label in group.labels)
    findings += [
        Problem(f"skipped {counted(count, 'message')} that do not match the definition of their type", key=topics[id_].name,
                value=topics[id_].kind, code="broken-message")
        for id_, count in broken.items()
    ]  # fmt: skip
    seen: Counter[str] = Counter()
    for (topic_id, _), group in groups.items():
        topic, labels, count = topics[topic_id], group.labels, len(group.received)
        if topic.decode is None:
            continue
        if count < 2:
            findings.append(Problem("the topic has one message only, which is no series", key=topic.name, code="too-short"))
            continue
        values = np.frombuffer(group.values).reshape(count, len(labels))
        columns = [_time_of(topic.name, group, stated, findings)]
        for i, (label, joint) in enumerate(labels):
            name = printable(topic.name if label == "data" else f"{topic.name}/{label}")
            seen[name] += 1
            joint, quantity = understand(topic.name, topic.kind, label, joint)
            columns.append(
                RawColumn(
                    name=name if seen[name] == 1 else f"{name}#{seen[name]}", values=np.ascontiguousarray(values[:, i]),
                    quantity=quantity, joint=None if joint is None else printable(joint),
                )
            )  # fmt: skip
        yield RawTable(name=topic.name, columns=tuple(columns))


def _time_of(topic: str, group: _Group, stated: Sequence[str], findings: list[Problem]) -> RawColumn:
    """Time of messages: header stamps if the user chose them or if both clocks agree; otherwise the times of recording."""
    received, stamped = (np.array(times, dtype=np.int64) for times in (group.received, group.stamped))
    lag = float(np.median(stamped - received)) * 1e-9
    by_header = stamped.all() and "received" not in stated and ("header" in stated or abs(lag) < _SAME_CLOCK)
    if stamped.all() and not by_header and not stated:
        message = f"two time bases: header stamps differ by {abs(lag):.6g} s from the time of recording, which is used"
        hint = "Use the stamps with `time: header` in its document"
        findings.append(Problem(message, key=topic, code="two-time-bases", hint=hint))
    stamps = stamped if by_header else received
    zero = int(stamps[0]) if stamps[0] > EPOCH * 1e9 else 0
    return RawColumn(
        name="header" if by_header else "received", values=np.asarray((stamps - zero) * 1e-9, dtype=np.float64), zero=zero
    )
