"""One field of a topic against time, from an MCAP file (our logs too) or a ROS 1 or ROS 2 bag, without ROS."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.errors import RecordingError, did_you_mean
from asrsim.samples import Array

_STEP = re.compile(r"([A-Za-z_]\w*)(?:\[([^\]]+)\])?")


def read_bag_series(path: Path, topic: str, field: str, *, header_time: bool) -> tuple[Array, Array]:
    """Times in s as recorded (or of the messages' headers) and values of `field` of the messages on `topic`.

    `field` is a dotted path; an entry of an array is given by its number or, where the message has a list `name`
    (JointState), by that name: `position[joint1]`. Raises RecordingError naming file, topic and what there is.
    """
    try:
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:  # pragma: no cover - rosbags is a dependency
        raise RecordingError(f"rosbags is needed to read it: {error}", file=path) from None
    steps = _steps(path, field)
    times: list[float] = []
    values: list[float] = []
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.LATEST)) as reader:
            connections = [connection for connection in reader.connections if connection.topic == topic]
            if not connections:
                raise _no_topic(path, topic, sorted({connection.topic for connection in reader.connections}))
            for connection, stamp, data in reader.messages(connections=connections):
                message: Any = reader.deserialize(data, connection.msgtype)
                if header_time:
                    header = getattr(message, "header", None)
                    if header is None:
                        raise _fault(path, topic, f"messages of type {connection.msgtype} have no header", "time")
                    times.append(header.stamp.sec + 1e-9 * header.stamp.nanosec)
                else:
                    times.append(stamp * 1e-9)
                values.append(_value(path, topic, message, field, steps))
    except AnyReaderError as error:
        raise RecordingError(f"cannot be read as a bag: {error}", file=path, code="bag") from None
    except (OSError, ValueError, KeyError, MemoryError, OverflowError) as error:
        message = f"cannot be read as a bag: {type(error).__name__}: {error}"
        raise RecordingError(message, file=path, code="bag") from None
    if not times:
        raise _fault(path, topic, f"topic {topic} has no messages", "topic")
    return _ascending(path, topic, np.array(times), np.array(values))


def _ascending(path: Path, topic: str, times: Array, values: Array) -> tuple[Array, Array]:
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        raise _fault(path, topic, f"{bad.size} values are not finite, the first at {times[bad[0]]:g} s", "field")
    backward = np.flatnonzero(np.diff(times) < 0.0)
    if backward.size:
        raise _fault(path, topic, f"times run backwards at message {backward[0] + 1}", "time")
    # Of messages with one stamp the last counts, as for a receiver that is read afterwards.
    keep = np.append(np.diff(times) > 0.0, True)
    return times[keep], values[keep]


def _steps(path: Path, field: str) -> list[tuple[str, str | None]]:
    steps = [_STEP.fullmatch(part) for part in re.split(r"\.(?![^\[]*\])", field)]
    if not all(steps):
        message = f"'{field}' is no field path such as data, pose.position.x or position[joint1]"
        raise RecordingError(message, file=path, key="field", code="no-field")
    return [(step[1], step[2]) for step in steps if step]


def _value(path: Path, topic: str, message: Any, field: str, steps: list[tuple[str, str | None]]) -> float:
    here = message
    for name, index in steps:
        fields = [key for key in getattr(here, "__dataclass_fields__", {}) if not key.startswith("__")]
        if name not in fields:
            raise _fault(path, topic, f"messages have no field '{name}'", "field", tuple(fields), did_you_mean(name, fields))
        entries = getattr(here, name)
        if index is not None:
            names = [str(entry) for entry in getattr(here, "name", ())]
            place = int(index) if index.isdecimal() else names.index(index) if index in names else -1
            if not 0 <= place < len(entries):
                raise _fault(path, topic, f"'{name}' has no entry '{index}' of {len(entries)}", "field", tuple(names))
            entries = entries[place]
        here = entries
    try:
        return float(here)
    except (TypeError, ValueError):
        raise _fault(path, topic, f"'{field}' is no number but {type(here).__name__}", "field") from None


def _no_topic(path: Path, topic: str, topics: list[str]) -> RecordingError:
    return _fault(path, topic, f"there is no topic '{topic}'", "topic", tuple(topics), did_you_mean(topic, topics))


def _fault(
    path: Path, topic: str, message: str, key: str, choices: tuple[str, ...] = (), hint: str | None = None
) -> RecordingError:
    text = message if topic in message else f"{topic}: {message}"
    return RecordingError(text, file=path, key=key, choices=choices, hint=hint, code=f"no-{key}")
