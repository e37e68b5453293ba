"""Reads ROS 1 bags, ROS 2 bags and MCAP files without ROS: message definitions are taken from the file itself."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable, Collection, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from asrsim.errors import Problem, RecordingError
from asrsim.log.chunks import decompress
from asrsim.recordings.bag_clock import Group, series_of_groups
from asrsim.recordings.data import Raw
from asrsim.recordings.messages import Skip, flatten, stamp_of
from asrsim.recordings.unpacked import check_unpacked

_FOREIGN = (
    "Image",
    "PointCloud",
    "LaserScan",
    "CameraInfo",
    "OccupancyGrid",
    "/Log",
    "String",
    "TFMessage",
    "tfMessage",
    "Diagnostic",
)
_NO_TIME = 2**63
"""ns beyond which a stamp is damage, not a time."""


@dataclass
class _Topic:
    name: str
    kind: str
    decode: Callable[[bytes], Any] | None
    """None: the message's type is unknown."""
    reason: str = ""


def read_bag(path: Path, ignored: Collection[str] = ()) -> Raw:
    """All numeric series of a bag, but of the topics that are ignored.

    Raises RecordingError where nothing in it can be read, saying what it holds.
    """
    findings: list[Problem] = []
    with ExitStack() as stack:
        form, topics, messages = _open(path, stack, findings)
        groups = _collect(topics, messages, path, findings, ignored)
    unknown = [topic for topic in topics.values() if topic.decode is None and topic.name not in ignored]
    findings += [
        Problem(f"topic is not read: {t.reason}", file=path, key=t.name, value=t.kind, code="unknown-message-type")
        for t in unknown
    ]
    if not groups:
        held = ", ".join(f"{topic.name} ({topic.kind})" for topic in topics.values()) or "no topic"
        reasons = "; ".join(f"{topic.name}: {topic.reason}" for topic in unknown)
        raise RecordingError(
            f"holds no numeric messages that can be read; it holds {held}" + (f"; {reasons}" if reasons else ""), file=path,
            code="unknown-message-type" if unknown else "no-numbers",
            hint="Expected sensor_msgs/JointState, std_msgs/Float64 or other messages with numbers, with their definitions "
            "in the file",
        )  # fmt: skip
    series, epoch = series_of_groups(groups, path, findings)
    names = tuple(topic.name for topic in topics.values())
    return Raw(format=form, series=series, findings=tuple(findings), epoch=epoch, names=names)


def _open(
    path: Path, stack: ExitStack, findings: list[Problem]
) -> tuple[str, dict[int, _Topic], Iterator[tuple[int, int, bytes]]]:
    """Format, topics by id, and messages (id, log time in ns, bytes)."""
    if path.suffix == ".mcap":
        return _open_mcap(path, stack, findings)
    from rosbags.rosbag1 import Reader as Reader1
    from rosbags.rosbag2 import Reader as Reader2

    ros1 = path.suffix == ".bag"
    try:
        reader: Any = stack.enter_context(Reader1(path) if ros1 else Reader2(path))
    except Exception as error:  # on damaged files rosbags lets errors of many kinds through (struct, sqlite, KeyError, ...)
        raise RecordingError(
            f"cannot be read as a ROS {1 if ros1 else 2} bag: {error}", file=path, code="bad-bag",
            hint="A bag that was not closed can be repaired with `rosbag reindex` or `ros2 bag reindex`",
        ) from None  # fmt: skip
    types = _Types(ros1=ros1)
    topics = {}
    for connection in reader.connections:
        # Enum by name: NONE, MSG or IDL.
        definition = connection.msgdef.data if connection.msgdef.format.name != "NONE" else ""
        language = connection.msgdef.format.name.lower()
        topics[connection.id] = types.topic(connection.topic, connection.msgtype, definition, language)

    def messages() -> Iterator[tuple[int, int, bytes]]:
        wanted = [c for c in reader.connections if topics[c.id].decode is not None]
        if not wanted:
            return
        try:
            for connection, stamp, data in reader.messages(connections=wanted):
                yield connection.id, stamp, data
        except Exception as error:  # as above
            findings.append(Problem(f"the file is damaged ({str(error)[:80]}); read up to there", file=path, code="truncated"))

    return ("rosbag1" if ros1 else "rosbag2"), topics, messages()


def _open_mcap(
    path: Path, stack: ExitStack, findings: list[Problem]
) -> tuple[str, dict[int, _Topic], Iterator[tuple[int, int, bytes]]]:
    from mcap.exceptions import McapError
    from mcap.records import Channel, Chunk, McapRecord, Message, Schema
    from mcap.stream_reader import StreamReader, breakup_chunk

    stream = stack.enter_context(path.open("rb"))
    types = {"ros1": _Types(ros1=True), "cdr": _Types(ros1=False)}
    schemas: dict[int, Schema] = {}
    topics: dict[int, _Topic] = {}

    def records() -> Iterator[McapRecord]:
        size = 0
        for record in StreamReader(stream, emit_chunks=True, record_size_limit=path.stat().st_size).records:
            if isinstance(record, Chunk):
                size += record.uncompressed_size
                check_unpacked(path, size)
                data = decompress(record.compression, record.data, record.uncompressed_size)
                yield from breakup_chunk(replace(record, compression="", data=data))
            else:
                yield record

    def messages() -> Iterator[tuple[int, int, bytes]]:
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
                raise RecordingError(
                    f"cannot be read as MCAP: {type(error).__name__} {error}", file=path, code="bad-bag"
                ) from None
            findings.append(
                Problem("the file ends early (was the recorder killed?); read up to its last whole chunk", file=path,
                        code="truncated")
            )  # fmt: skip

    return "mcap", topics, messages()


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
    topics: dict[int, _Topic], messages: Iterator[tuple[int, int, bytes]], path: Path, findings: list[Problem],
    ignored: Collection[str],
) -> list[Group]:  # fmt: skip
    groups: dict[tuple[int, tuple[tuple[str, str | None], ...]], Group] = {}
    broken: dict[int, int] = {}
    for topic_id, logged, data in messages:
        topic = topics[topic_id]
        if topic.decode is None or topic.name in ignored:
            continue
        try:
            message = topic.decode(data)
            labels, values = flatten(message)
        except Skip:
            topic.decode, topic.reason = None, "its arrays are too long for signals"
            continue
        except Exception:  # a message that does not fit its definition: counted and reported
            broken[topic_id] = broken.get(topic_id, 0) + 1
            continue
        if not labels:
            continue
        key = (topic_id, tuple(labels))
        group = groups.get(key)
        if group is None:
            # What is named may come in any order, and be left out: such a message belongs to those that have the same.
            alike = (one for (other, _), one in groups.items() if other == topic_id and one.has(labels))
            group = groups[key] = next(alike, None) or Group(topic.name, topic.kind, [*labels])
        if labels != group.labels:
            values = group.row(labels, values)
        group.logged.append(logged)
        group.stamped.append(stamp_of(message))
        group.rows.append(values)
    for topic_id, count in broken.items():
        findings.append(
            Problem(f"{count} messages do not fit their type's definition and are left out", file=path,
                    key=topics[topic_id].name, value=topics[topic_id].kind, code="broken-message")
        )  # fmt: skip
    every = list({id(group): group for group in groups.values()}.values())
    findings += [
        Problem("one message only; not a series", file=path, key=group.topic, code="too-short")
        for group in every
        if len(group.rows) < 2
    ]
    return [group for group in every if len(group.rows) > 1]
