"""Reads ROS 1 bags, ROS 2 bags and MCAP files without ROS: message definitions are taken from the file itself."""

from __future__ import annotations

import json
import re
import struct
from array import array
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.errors import Problem, RecordingError
from asrsim.quantities import QUANTITIES, unit_of
from asrsim.recordings.data import Content, RawColumn, RawTable
from asrsim.recordings.reading import Reading
from asrsim.recordings.text import printable

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


_FOREIGN = ("Image", "PointCloud", "LaserScan", "CameraInfo", "OccupancyGrid", "/Log", "String", "TFMessage", "tfMessage",
            "Diagnostic")  # fmt: skip
_NO_TIME = 2**63
"""ns from which on a stamp is damage, not a time."""


@dataclass
class _Topic:
    name: str
    kind: str
    decode: Callable[[bytes], Any] | None
    """None: its messages are not read."""
    reason: str = ""


Messages = Iterator[tuple[int, int, bytes]]
"""Topic's id, ns at which it was recorded, bytes."""


@dataclass
class _Group:
    """Messages of one topic with the same labels."""

    labels: tuple[Label, ...]
    order: array[int] = field(default_factory=lambda: array("q"))
    """Places of the messages among all of the file."""
    received: array[int] = field(default_factory=lambda: array("q"))
    stamped: array[int] = field(default_factory=lambda: array("q"))
    """ns; 0 without a stamp."""
    values: array[float] = field(default_factory=lambda: array("d"))


def read_bag(path: Path, reading: Reading) -> Content:
    """All numeric series of a bag, but of the topics that are ignored. Raises RecordingError where nothing can be read."""
    findings: list[Problem] = []
    with ExitStack() as stack:
        if path.suffix.lower() == ".bag" or path.is_dir() or path.suffix.lower() == ".db3":
            topics, messages = _open_bag(path, stack, findings)
        elif _is_own_log(path):
            return _own_log(path)
        else:
            topics, messages = _open_mcap(path, stack, findings)
        groups = _collect(topics, messages, reading.ignored, findings)
    read = [topic for topic in topics.values() if topic.name not in reading.ignored]
    unknown = [topic for topic in read if topic.decode is None]
    findings += [
        Problem(f"topic is not read: {one.reason}", key=one.name, value=one.kind, code="unknown-message-type")
        for one in unknown
    ]
    tables = tuple(table for id_, own in groups.items() for table in _tables(topics[id_], own, findings))
    if not tables:
        held = ", ".join(f"{topic.name} ({topic.kind})" for topic in topics.values()) or "no topic"
        reasons = "; ".join(f"{topic.name}: {topic.reason}" for topic in unknown)
        raise RecordingError(
            f"holds no numeric messages that can be read; it holds {held}" + (f"; {reasons}" if reasons else ""),
            code="unknown-message-type" if unknown else "no-numbers",
            hint="Expected sensor_msgs/JointState, std_msgs/Float64 or other messages with numbers, with their definitions "
            "in the file",
        )  # fmt: skip
    return Content(format="bag", tables=tables, findings=tuple(findings), topics=tuple(one.name for one in topics.values()))


def _open_bag(path: Path, stack: ExitStack, findings: list[Problem]) -> tuple[dict[int, _Topic], Messages]:
    from rosbags.rosbag1 import Reader as Reader1
    from rosbags.rosbag2 import Reader as Reader2

    ros1 = path.suffix.lower() == ".bag"
    try:
        reader: Any = stack.enter_context(Reader1(path) if ros1 else Reader2(path))
    except Exception as error:  # on damaged files rosbags lets errors of many kinds through (struct, sqlite, KeyError, ...)
        raise RecordingError(
            f"cannot be read as a ROS {1 if ros1 else 2} bag: {error}", code="damaged",
            hint="A bag that was not closed can be repaired with `rosbag reindex` or `ros2 bag reindex`",
        ) from None  # fmt: skip
    types = _Types(ros1=ros1)
    topics = {}
    for connection in reader.connections:
        # Enum by name: NONE, MSG or IDL.
        definition = connection.msgdef.data if connection.msgdef.format.name != "NONE" else ""
        language = connection.msgdef.format.name.lower()
        topics[connection.id] = types.topic(connection.topic, connection.msgtype, definition, language)

    def messages() -> Messages:
        wanted = [c for c in reader.connections if topics[c.id].decode is not None]
        try:
            for connection, stamp, data in reader.messages(connections=wanted) if wanted else ():
                yield connection.id, stamp, data
        except Exception as error:  # as above
            findings.append(Problem(f"the file is damaged ({str(error)[:80]}); read up to there", code="truncated"))

    return topics, messages()


def _open_mcap(path: Path, stack: ExitStack, findings: list[Problem]) -> tuple[dict[int, _Topic], Messages]:
    from mcap.exceptions import McapError
    from mcap.records import Channel, Chunk, McapRecord, Message, Schema
    from mcap.stream_reader import StreamReader, breakup_chunk

    from asrsim.log.chunks import decompress

    stream = stack.enter_context(path.open("rb"))
    types = {"ros1": _Types(ros1=True), "cdr": _Types(ros1=False)}
    schemas: dict[int, Schema] = {}
    topics: dict[int, _Topic] = {}

    def records() -> Iterator[McapRecord]:
        for record in StreamReader(stream, emit_chunks=True, record_size_limit=path.stat().st_size).records:
            if isinstance(record, Chunk):
                data = decompress(record.compression, record.data, record.uncompressed_size)
                yield from breakup_chunk(replace(record, compression="", data=data))
            else:
                yield record

    def messages() -> Messages:
        try:
            for record in records():
                if isinstance(record, Schema):
                    schemas[record.id] = record
                elif isinstance(record, Channel) and record.id not in topics:
                    topics[record.id] = _mcap_topic(record, schemas.get(record.schema_id), types)
                elif isinstance(record, Message) and record.channel_id in topics and record.log_time < _NO_TIME:
                    yield record.channel_id, record.log_time, record.data
        except (McapError, MemoryError, OverflowError, EOFError, ValueError, struct.error) as error:
            if not topics:
                raise RecordingError(f"cannot be read as MCAP: {type(error).__name__} {error}", code="damaged") from None
            findings.append(
                Problem("the file ends early (was the recorder killed?); read up to its last whole chunk", code="truncated")
            )

    return topics, messages()


def _mcap_topic(channel: Any, schema: Any, types: dict[str, _Types]) -> _Topic:
    kind = schema.name if schema is not None else "without schema"
    if channel.message_encoding == "json":
        return _Topic(channel.topic, kind, json.loads)
    if channel.message_encoding not in types or schema is None:
        reason = f"its encoding '{channel.message_encoding}' is not known here (cdr, ros1 and json are)"
        return _Topic(channel.topic, kind, None, reason)
    language = "idl" if schema.encoding == "ros2idl" else "msg"
    return types[channel.message_encoding].topic(channel.topic, kind, schema.data.decode("utf-8", "replace"), language)


class _Types:
    """Message definitions: those in the file, and the standard ones of ROS where the file has none."""

    def __init__(self, *, ros1: bool) -> None:
        from rosbags.typesys import Stores, get_typestore

        self.ros1 = ros1
        self.own = get_typestore(Stores.EMPTY)
        self.standard = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.LATEST)

    def topic(self, name: str, kind: str, definition: str, language: str) -> _Topic:
        """The topic with its decoder, or with the reason why it has none."""
        from rosbags.typesys import get_types_from_idl, get_types_from_msg

        if any(word in kind for word in _FOREIGN):
            return _Topic(name, kind, None, "it carries no signals")
        full = kind if "/msg/" in kind else kind.replace("/", "/msg/", 1)
        store = self.standard
        reason = "its type is none of the standard ones and the file holds no definition of it"
        if definition.strip():
            try:
                found = get_types_from_msg(definition, full) if language == "msg" else get_types_from_idl(definition)
                self.own.register({key: value for key, value in found.items() if key not in self.own.fielddefs})
                store = self.own
            except Exception as error:  # rosbags' parser raises errors of several kinds for definitions that it cannot read
                reason = f"its definition cannot be understood ({str(error)[:80]})"
        if full not in store.fielddefs:
            return _Topic(name, kind, None, reason)
        read = store.deserialize_ros1 if self.ros1 else store.deserialize_cdr
        return _Topic(name, kind, lambda data: read(data, full))


def _collect(
    topics: dict[int, _Topic], messages: Messages, ignored: set[str], findings: list[Problem]
) -> dict[int, list[_Group]]:
    groups: dict[int, dict[tuple[Label, ...], _Group]] = {}
    broken: dict[int, int] = {}
    for count, (topic_id, logged, data) in enumerate(messages):
        topic = topics[topic_id]
        if topic.decode is None or topic.name in ignored:
            continue
        try:
            message = topic.decode(data)
            numbers = list(flatten(message))
        except NoSignal:
            topic.decode, topic.reason = None, "its arrays are too long for signals"
            continue
        except Exception:  # a message that does not fit its definition: counted and reported
            broken[topic_id] = broken.get(topic_id, 0) + 1
            continue
        if not numbers:
            continue
        labels = tuple(label for label, _ in numbers)
        group = groups.setdefault(topic_id, {}).setdefault(labels, _Group(labels))
        group.order.append(count)
        group.received.append(logged)
        group.stamped.append(stamp_of(message) or 0)
        group.values.extend(value for _, value in numbers)
    findings += [
        Problem(f"{count} messages do not fit their type's definition and are left out", key=topics[id_].name,
                value=topics[id_].kind, code="broken-message")
        for id_, count in broken.items()
    ]  # fmt: skip
    return {id_: list(own.values()) for id_, own in groups.items() if topics[id_].decode is not None}


def _tables(topic: _Topic, groups: list[_Group], findings: list[Problem]) -> Iterator[RawTable]:
    """One table of the messages whose numbers have names, in whatever order; one for each length of arrays without names."""
    named = [group for group in groups if all(joint or not re.search(r"\[\d+\]", label) for label, joint in group.labels)]
    seen: dict[str, int] = {}
    for own in ([named] if named else []) + [[group] for group in groups if group not in named]:
        labels = list(dict.fromkeys(label for group in own for label in group.labels))
        places = {label: i for i, label in enumerate(labels)}
        count = sum(len(group.order) for group in own)
        if count < 2:
            findings.append(Problem("one message only; not a series", key=topic.name, code="too-short"))
            continue
        values = np.full((count, len(labels)), np.nan)
        begin = 0
        for group in own:
            rows = np.frombuffer(group.values).reshape(len(group.order), len(group.labels))
            values[begin : begin + len(rows), [places[label] for label in group.labels]] = rows
            begin += len(rows)
        order = np.argsort(np.concatenate([group.order for group in own]), kind="stable")
        received, stamped = (np.concatenate([getattr(group, name) for group in own])[order] for name in ("received", "stamped"))
        columns = []
        for i, (label, joint) in enumerate(labels):
            name = printable(topic.name if label == "data" else f"{topic.name}/{label}")
            seen[name] = seen.get(name, 0) + 1
            joint, quantity = understand(topic.name, topic.kind, label, joint)
            columns.append(
                RawColumn(
                    name=name if seen[name] == 1 else f"{name}#{seen[name]}", values=values[order, i], quantity=quantity,
                    joint=None if joint is None else printable(joint),
                )
            )  # fmt: skip
        own_stamps = stamped.astype(np.int64) if stamped.all() else None
        yield RawTable(name=topic.name, columns=tuple(columns), received=received.astype(np.int64), stamped=own_stamps)


def _is_own_log(path: Path) -> bool:
    """Whether asrsim wrote the file: the MCAP header's library says so."""
    with path.open("rb") as stream:
        return b"asrsim " in stream.read(128)


def _own_log(path: Path) -> Content:
    """A log of another run as a recording."""
    from asrsim.log import read_log

    log = read_log(path)
    slides = {info.name for info in log.info.joints if info.prismatic}
    columns = [
        RawColumn(name=f"{joint}.{quantity}", values=values, joint=joint, quantity=quantity,
                  unit=unit_of(quantity, prismatic=joint in slides))
        for joint in log.samples.joints
        for quantity, values in log.samples.joint(joint).items()
        if quantity in QUANTITIES
    ]  # fmt: skip
    if not columns:
        raise RecordingError("the log holds nothing of any joint", code="no-columns")
    note = Problem("the log was cut off; read up to its last whole chunk", code="truncated")
    table = RawTable(columns=(RawColumn(name="time", values=log.samples.time, unit="s"), *columns))
    return Content(format="asrsim", tables=(table,), findings=(note,) if log.truncated else ())
