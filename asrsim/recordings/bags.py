"""Reads ROS 1 bags, ROS 2 bags and MCAP files by the message definitions in the file, without an installation of ROS."""

from __future__ import annotations

import json
import re
from array import array
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from asrsim.errors import Problem, RecordingError, counted, listed, printable
from asrsim.log.topics import LINK_STATE_FIELDS, REFERENCE_TOPICS, reference_topics
from asrsim.quantities import MOST_MOTORS, QUANTITIES
from asrsim.recordings.data import EPOCH, Content, RawColumn, RawTable, unique
from asrsim.recordings.reading import Reading
from asrsim.samples import Array

_SAME_CLOCK = 1.0
"""Header stamps and times of recording count as times of the same clock if they differ by less than this time, s."""
LONGEST = 64
"""Largest number of entries in an array of signals. Longer arrays are pictures, scans or maps."""
NAMES = ("name", "names", "joint_names", "interface_names")
"""Message fields with names for the entries of the message's other arrays. The names also apply to arrays in parts of the
message that have no such field.
"""
_JOINT_STATE = {"position": "position", "velocity": "velocity", "effort": "torque"}
_COMMANDS = ("command", "cmd", "desired", "reference", "target", "setpoint")
TOPICS: dict[str, str] = {
    **{name: name for name in QUANTITIES},
    **{f"torque_el{i}_state": f"elastic_torque_{i}" for i in range(1, MOST_MOTORS + 1)},
    **{f"sent_reference_{i}": f"reference_{i}" for i in range(1, MOST_MOTORS + 1)},
    **{
        name: f"reference_{i}"
        for mode in REFERENCE_TOPICS
        for i, name in enumerate(reference_topics(mode, MOST_MOTORS), start=1)
    },
}
"""Quantity in the messages of a toolbox topic `.../<joint>/<topic>` of type Float64, by the last part of the topic."""
_FOREIGN = ("Image", "PointCloud", "LaserScan", "CameraInfo", "OccupancyGrid", "/Log", "String", "TFMessage", "tfMessage",
            "Diagnostic")  # fmt: skip
"""Parts of the names of message types that carry no signals."""
_NO_TIME = 2**63
"""Time stamps of this value or more are invalid, ns."""
Label = tuple[str, str | None]
"""Path of a number in a message, and the joint that the message states for this number."""


class NoSignal(Exception):  # noqa: N818
    """Raised for a message with arrays that are too long for signals."""


def _members(message: Any) -> Mapping[str, Any]:
    """Fields of a message or JSON object, by name; an empty mapping for other values."""
    return message if isinstance(message, dict) else vars(message) if is_dataclass(message) else {}


def stamp_of(message: Any) -> int | None:
    """Time stamp of a message, ns, from its header or its own fields; None if the stamp is missing or 0."""
    members = _members(message)
    for stamp in (_members(members.get("header")).get("stamp"), members.get("stamp"), members.get("timestamp")):
        # Seconds and nanoseconds are called sec and nanosec, secs and nsecs, or sec and nsec, in any order.
        parts = {name[:1]: part for name, part in _members(stamp).items() if isinstance(part, int)}
        if {*parts} == {"s", "n"}:
            return (parts["s"] * 1_000_000_000 + parts["n"]) or None
    return None


def _is_number(value: Any) -> bool:
    return isinstance(value, bool | int | float | np.number | np.bool_)


def flatten(
    message: Any, prefix: str = "", names: Sequence[str] = (), joint: str | None = None
) -> Iterator[tuple[Label, float]]:
    """Labels and values of all numbers in a message or JSON object. Raises NoSignal if an array is too long.

    names: names of array entries, from the enclosing message; joint: joint that the enclosing message states.
    """
    members = _members(message)
    named = [members[key] for key in NAMES if isinstance(members.get(key), list)]
    names = next((entries for entries in named if entries and isinstance(entries[0], str)), names)
    for key, value in members.items():
        if key in ("header", "layout") or (key in ("stamp", "timestamp") and not _is_number(value)):
            continue
        path = f"{prefix}{key}"
        array = isinstance(value, np.ndarray | list | tuple)
        if array and len(value) > LONGEST:
            raise NoSignal
        fitting = array and 0 < len(names) == len(value)
        items = [(f"{path}[{names[i] if fitting else i}]", item) for i, item in enumerate(value)] if array else [(path, value)]
        for i, (place, item) in enumerate(items):
            owner = str(names[i]) if fitting and joint is None else joint
            if _is_number(item):
                yield (place, owner), float(item)
            else:
                yield from flatten(item, f"{place}.", () if fitting else names, owner)


def understand(topic: str, kind: str, label: str, joint: str | None) -> tuple[str | None, str | None]:
    """Joint and quantity of a number in a message, by its topic and message type; None for an unknown joint or quantity."""
    parts = [part for part in topic.split("/") if part]
    last, name = parts[-1] if parts else "", label.partition("[")[0]
    if kind.endswith("/JointState") and name in _JOINT_STATE:
        if any(word in topic.lower() for word in _COMMANDS):
            return joint, "reference_1" if name in ("position", "effort") else None
        motor = re.search(r"motor_([1-8])(?!\d)", topic.lower())
        side = motor[0] if motor else "link"
        return joint, f"{side}_{_JOINT_STATE[name]}"
    if kind.endswith("/DynamicJointState") and (interface := re.search(r"\[(position|velocity|effort)\]$", label)):
        return joint, f"link_{_JOINT_STATE[interface[1]]}"
    if label in ("data", "value") and last in TOPICS and len(parts) > 1:
        return parts[-2], TOPICS[last]
    if last in ("link_state", "details") and len(parts) > 1 and (quantity := LINK_STATE_FIELDS.get(name, name)) in QUANTITIES:
        return parts[-2], quantity
    return joint, None


@dataclass(eq=False)
class _Topic:
    name: str
    kind: str
    decode: Callable[[bytes], Any] | None
    """Decoder of the messages; None: the topic is not read."""
    reason: str = ""


Messages = Iterator[tuple[_Topic, int, bytes]]
"""For each message: its topic, its time of recording in ns, and its bytes."""


@dataclass
class _Group:
    """Messages of one topic that contain the same labels."""

    labels: tuple[Label, ...]
    """Labels in the order of the first message."""
    received: array[int] = field(default_factory=lambda: array("q"))
    stamped: array[int] = field(default_factory=lambda: array("q"))
    """Header stamps, ns; 0 for a message without a stamp."""
    values: array[float] = field(default_factory=lambda: array("d"))

    @property
    def rows(self) -> Array:
        """Values (messages, labels)."""
        return np.frombuffer(self.values).reshape(-1, len(self.labels))


def _series(groups: Sequence[_Group]) -> Iterator[_Group]:
    """Groups of the numbers that occur in the same messages of a topic. For example, if some messages of a topic lack
    velocities, there are two groups: the positions of all messages, and the velocities of some messages.
    """
    found: dict[Label, list[_Group]] = {}
    for group in groups:
        for label in group.labels:
            found.setdefault(label, []).append(group)
    alike: dict[tuple[int, ...], list[Label]] = {}
    for label, own in found.items():
        alike.setdefault(tuple(map(id, own)), []).append(label)
    for labels in alike.values():
        yield _together(found[labels[0]], labels)


def _together(groups: Sequence[_Group], labels: Sequence[Label]) -> _Group:
    """Numbers with these labels in all messages of the groups, in the order in which the messages were received."""
    if len(groups) == 1 and len(labels) == len(groups[0].labels):
        return groups[0]
    received, stamped = (np.concatenate(times) for times in zip(*map(_times, groups), strict=True))
    values = np.concatenate([one.rows[:, [one.labels.index(label) for label in labels]] for one in groups])
    order = np.argsort(received, kind="stable")
    return _Group(
        tuple(labels),
        array("q", received[order].tolist()),
        array("q", stamped[order].tolist()),
        array("d", values[order].ravel().tolist()),
    )


def read_bag(path: Path, reading: Reading) -> Content:
    """Content of a bag: all series of numbers. Raises RecordingError if nothing can be read."""
    findings: list[Problem] = []
    topics: list[_Topic] = []
    tables = tuple(_tables(_messages(path, topics, findings), reading.time.columns, findings))
    unknown = [topic for topic in topics if topic.decode is None]
    findings += [
        Problem(f"topic is not read: {one.reason}", key=one.name, value=one.kind, code="unknown-message-type")
        for one in unknown
    ]
    if not tables:
        names = ", ".join(f"{one.name} ({': '.join(filter(None, (one.kind, one.reason)))})" for one in topics)
        raise RecordingError(
            f"contains no readable numeric messages; its topics: {names or 'none'}",
            code="unknown-message-type" if unknown else "no-numbers",
            hint="Expected sensor_msgs/JointState, std_msgs/Float64 or other numeric messages whose definitions are in the "
            "file",
        )
    return Content(tables=tables, findings=tuple(findings))


def _messages(path: Path, topics: list[_Topic], findings: list[Problem]) -> Messages:
    """Messages of a bag. Its topics are added to `topics`. Raises RecordingError if no topic can be read."""
    suffix = path.suffix.lower()
    kind = "a ROS 1 bag" if suffix == ".bag" else "a ROS 2 bag" if suffix == ".db3" or path.is_dir() else "MCAP"
    try:
        yield from _of_mcap(path, topics) if kind == "MCAP" else _of_bag(path, topics, ros1=suffix == ".bag")
    except Exception as error:  # for damaged files, rosbags and mcap raise errors of many types (struct, sqlite, KeyError, ...)
        said = f"{type(error).__name__} {str(error)[:80]}".rstrip()
        if not topics:
            hint = "`rosbag reindex`, `ros2 bag reindex` or `mcap recover` repair a file that its recorder did not close"
            raise RecordingError(f"cannot be read as {kind}: {said}", code="damaged", hint=hint) from None
        message = f"is damaged or was not closed (was the recorder killed?); only the part before the fault is read ({said})"
        findings.append(Problem(message, code="truncated"))


def _of_bag(path: Path, topics: list[_Topic], *, ros1: bool) -> Messages:
    from rosbags.rosbag1 import Reader as Reader1
    from rosbags.rosbag2 import Reader as Reader2

    types = _Types(ros1=ros1)
    opened: Any = Reader1(path) if ros1 else Reader2(path)
    with opened as reader:
        known = {one.id: types.topic(one.topic, one.msgtype, one.msgdef.data) for one in reader.connections}
        topics += known.values()
        wanted = [one for one in reader.connections if known[one.id].decode is not None]
        for connection, stamp, data in reader.messages(connections=wanted) if wanted else ():
            yield known[connection.id], stamp, data


def _of_mcap(path: Path, topics: list[_Topic]) -> Messages:
    from mcap.records import Channel, Message, Schema
    from mcap.stream_reader import StreamReader

    types = {"ros1": _Types(ros1=True), "cdr": _Types(ros1=False)}
    schemas: dict[int, Schema] = {}
    known: dict[int, _Topic] = {}

    def topic_of(channel: Channel) -> _Topic:
        schema, encoding = schemas.get(channel.schema_id), channel.message_encoding
        kind = schema.name if schema is not None else "without schema"
        if encoding == "json":
            return _Topic(channel.topic, kind, json.loads)
        if encoding not in types or schema is None:
            return _Topic(channel.topic, kind, None, f"its encoding '{encoding}' is unknown; known are cdr, ros1 and json")
        return types[encoding].topic(channel.topic, kind, schema.data.decode("utf-8", "replace"))

    with path.open("rb") as stream:
        for record in StreamReader(stream, record_size_limit=path.stat().st_size).records:
            if isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel) and record.id not in known:
                known[record.id] = topic_of(record)
                topics.append(known[record.id])
            elif isinstance(record, Message) and record.channel_id in known and record.log_time < _NO_TIME:
                yield known[record.channel_id], record.log_time, record.data


class _Types:
    """Message definitions of the file, and the standard definitions of ROS for types that the file does not define."""

    def __init__(self, *, ros1: bool) -> None:
        from rosbags.typesys import Stores, get_typestore

        self.ros1 = ros1
        self.own = get_typestore(Stores.EMPTY)
        self.standard = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.LATEST)

    def topic(self, name: str, kind: str, definition: str) -> _Topic:
        """Topic with its decoder, or with the reason why its messages cannot be decoded. definition: definition of the message
        type in the MSG language of ROS.
        """
        from rosbags.typesys import get_types_from_msg

        if any(word in kind for word in _FOREIGN):
            return _Topic(name, kind, None, "it carries no signals")
        full = kind if "/msg/" in kind else kind.replace("/", "/msg/", 1)
        store = self.standard
        reason = "its type is not a standard type, and the file does not define it"
        if definition.strip():
            try:
                found = get_types_from_msg(definition, full)
                self.own.register({key: value for key, value in found.items() if key not in self.own.fielddefs})
                store = self.own
            except Exception as error:  # rosbags' parser raises errors of several types for invalid definitions
                reason = f"its definition cannot be parsed ({str(error)[:80]})"
        if full not in store.fielddefs:
            return _Topic(name, kind, None, reason)
        read = store.deserialize_ros1 if self.ros1 else store.deserialize_cdr
        return _Topic(name, kind, lambda data: read(data, full))


def _tables(messages: Messages, stated: Sequence[str], findings: list[Problem]) -> Iterator[RawTable]:
    """Tables of a bag. stated: time columns that the user states."""
    topics: dict[_Topic, dict[frozenset[Label], _Group]] = {}
    broken: Counter[_Topic] = Counter()
    repeated: dict[_Topic, Counter[str]] = {}
    for topic, logged, data in messages:
        if topic.decode is None:
            continue
        try:
            message = topic.decode(data)
            pairs = [*flatten(message)]
            numbers = dict(pairs)
        except NoSignal:
            topic.decode, topic.reason = None, "its arrays are too long for signals"
            continue
        except Exception:  # a message that does not match its definition is counted and reported
            broken[topic] += 1
            continue
        if len(numbers) < len(pairs):
            places = Counter(label for label, _ in pairs)
            repeated.setdefault(topic, Counter()).update(label for (label, _), count in places.items() if count > 1)
        if numbers:
            group = topics.setdefault(topic, {}).setdefault(frozenset(numbers), _Group(tuple(numbers)))
            group.received.append(logged)
            group.stamped.append(stamp_of(message) or 0)
            group.values.extend(numbers[label] for label in group.labels)
    for topic, count in broken.items():
        message = f"skipped {counted(count, 'message')} that do not match the definition of their type"
        findings.append(Problem(message, key=topic.name, value=topic.kind, code="broken-message"))
    for topic, labels in repeated.items():
        message = (
            f"names {listed([*labels], 4)} several times in one message ({counted(max(labels.values()), 'message')}); "
            "only the last value is kept"
        )
        hint = "Record each joint once: asrsim cannot know which of its values is right"
        findings.append(Problem(message, key=topic.name, value=topic.kind, hint=hint, code="repeated-name"))
    seen: Counter[str] = Counter()
    for topic, groups in topics.items():
        if topic.decode is not None:
            yield from _tables_of(topic, [*groups.values()], stated, findings, seen)


def _tables_of(
    topic: _Topic, groups: Sequence[_Group], stated: Sequence[str], findings: list[Problem], seen: Counter[str]
) -> Iterator[RawTable]:
    """Tables of a topic, one for each set of numbers that occur in the same messages. stated: time columns that the user
    states; seen: number of uses of each column name so far.
    """
    count, series = sum(len(group.received) for group in groups), list[_Group]()
    for group in _series(groups):
        if len(group.received) > 1:
            series.append(group)
        else:
            message = "the topic has only one message; a time series needs more"
            if count > 1:
                message = f"only one message has {listed([label for label, _ in group.labels], 4)}; a time series needs more"
            findings.append(Problem(message, key=topic.name, code="too-short"))
    if not series:
        return
    # Use the same clock for all numbers of a topic. Otherwise positions and velocities would be shifted against each other.
    by_header = _has_header_times(topic.name, groups, stated, findings)
    labels = [label for group in series for label, own in group.labels if own is None]
    nameless = [label for label in labels if label.partition("[")[0] in _JOINT_STATE]
    if topic.kind.endswith("/JointState") and nameless:
        message = (
            f"the message names no joints for {listed(nameless, 4)}: these values are assigned to the robot's joints by order, "
            "unless --map states their joints"
        )
        goal = understand(topic.name, topic.kind, nameless[0], None)[1] or "QUANTITY"
        hint = f"State the joint of each value: --map '{topic.name}/{nameless[0]}=JOINT.{goal}', or =ignore"
        findings.append(Problem(message, key=topic.name, value=topic.kind, hint=hint, code="suspected-order"))
    for group in series:
        columns = [_time_of(group, by_header=by_header)]
        for (label, own), numbers in zip(group.labels, np.ascontiguousarray(group.rows.T), strict=True):
            joint, quantity = understand(topic.name, topic.kind, label, own)
            name = unique(printable(topic.name if label == "data" else f"{topic.name}/{label}"), seen)
            joint = None if joint is None else printable(joint)
            columns.append(RawColumn(name=name, values=numbers, quantity=quantity, joint=joint))
        yield RawTable(name=topic.name, columns=tuple(columns))


def _has_header_times(topic: str, groups: Sequence[_Group], stated: Sequence[str], findings: list[Problem]) -> bool:
    """Whether the header stamps are used as the times of a topic's messages. They are used if the user states them, or if they
    agree with the times of recording. Otherwise the times of recording are used.
    """
    received, stamped = (np.concatenate(times) for times in zip(*map(_times, groups), strict=True))
    lag = float(np.median(stamped - received)) * 1e-9
    by_header = bool(stamped.all()) and "received" not in stated and ("header" in stated or abs(lag) < _SAME_CLOCK)
    if stamped.all() and not by_header and not stated:
        message = f"header stamps differ by {abs(lag):.6g} s from the times of recording; the times of recording are used"
        hint = "To use the stamps, write `time: header` in the document beside the file"
        findings.append(Problem(message, key=topic, code="two-time-bases", hint=hint))
    return by_header


def _times(group: _Group) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Times of recording, and header stamps, of a group's messages, ns."""
    return np.array(group.received, dtype=np.int64), np.array(group.stamped, dtype=np.int64)


def _time_of(group: _Group, *, by_header: bool) -> RawColumn:
    """Time column of a group: the header stamps of its messages, or their times of recording."""
    received, stamped = _times(group)
    stamps = stamped if by_header else received
    zero = int(stamps[0]) if stamps[0] > EPOCH * 1e9 else 0
    return RawColumn(
        name="header" if by_header else "received", values=np.asarray((stamps - zero) * 1e-9, dtype=np.float64), zero=zero
    )
