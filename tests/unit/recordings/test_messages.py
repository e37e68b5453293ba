"""Messages of many shapes: when each was sent, and what of which joint, in whatever order it says so."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from asrsim.recordings import Recording, read_recording

pytestmark = pytest.mark.once

COUNT = 40
TIME = 0.01 * np.arange(COUNT)
Q, DQ = np.array([np.sin(TIME), np.cos(TIME)]), np.array([np.cos(TIME), -np.sin(TIME)])
NAMES = ("joint_1", "joint_2")
ZERO = 1_700_000_000_000_000_000


def written(path: Path, message: Callable[[int, int], dict[str, Any]], slow: float = 1.5) -> Recording:
    """What is read of messages that a recorder got `slow` times as late as they were sent: message(i, when, in ns)."""
    from mcap.writer import Writer

    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        channel = writer.register_channel("/state", "json", writer.register_schema("lab/State", "jsonschema", b"{}"))
        for i in range(COUNT):
            got, sent = ZERO + round(slow * 1e7 * i), ZERO + 10_000_000 * i
            writer.add_message(channel, log_time=got, publish_time=got, data=json.dumps(message(i, sent)).encode())
        writer.finish()
    return read_recording(path, joints=NAMES)


def check(recording: Recording, quantity: str = "link_position", values: np.ndarray = Q) -> None:
    for name, truth in zip(NAMES, values, strict=True):
        column = recording.column(name, quantity)
        np.testing.assert_allclose(column.time, TIME, atol=1e-6)
        np.testing.assert_allclose(column.values, truth, atol=1e-12)


def of(i: int) -> dict[str, Any]:
    return {"q": Q[:, i].tolist()}


def parts(stamp: int, whole: str, rest: str) -> dict[str, int]:
    return {whole: stamp // 10**9, rest: stamp % 10**9}


SENT: dict[str, Callable[[int, int], dict[str, Any]]] = {
    "ROS": lambda i, t: {"header": {"stamp": parts(t, "sec", "nanosec"), "frame_id": ""}, **of(i)},
    "ROS 1": lambda i, t: {"header": {"stamp": parts(t, "secs", "nsecs"), "seq": i}, **of(i)},
    "Foxglove": lambda i, t: {"timestamp": parts(t, "sec", "nsec"), **of(i)},
    "a stamp without a header": lambda i, t: {"stamp": parts(t, "sec", "nanosec"), **of(i)},
}


@pytest.mark.parametrize("name", SENT)
def test_messages_that_say_when_they_were_sent_were_measured_then(tmp_path: Path, name: str) -> None:
    check(written(tmp_path / "a.mcap", SENT[name]))


def test_a_number_that_is_named_as_a_time_is_used_where_that_is_stated(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    found = written(path, lambda i, _: {"t": 1000 * TIME[i], **of(i)})
    assert [one.key for one in found.findings if one.code == "two-time-bases"] == ["/state/t"]
    np.testing.assert_allclose(found.column("joint_1", "link_position").time, 1.5 * TIME, atol=1e-6)
    check(read_recording(path, joints=NAMES, mapping=["/state/t=time [ms]"]))


def test_names_hold_in_any_order(tmp_path: Path) -> None:
    """Of objects in a list, and of the interfaces of ros2_control."""

    def objects(i: int, t: int) -> dict[str, Any]:
        every = [{"name": name, "position": Q[j, i], "velocity": DQ[j, i]} for j, name in enumerate(NAMES)]
        return {"stamp": parts(t, "sec", "nanosec"), "joints": every[:: 1 if i % 3 else -1]}

    def interfaces(i: int, t: int) -> dict[str, Any]:
        said = [("position", Q), ("velocity", DQ)][:: 1 if i % 3 else -1]
        values = [{"interface_names": [n for n, _ in said], "values": [v[j, i] for _, v in said]} for j in range(2)]
        return {"stamp": parts(t, "sec", "nanosec"), "joint_names": [*NAMES], "interface_values": values}

    for name, message in (("objects", objects), ("interfaces", interfaces)):
        recording = written(tmp_path / f"{name}.mcap", message)
        check(recording)
        check(recording, "link_velocity", DQ)


def test_what_some_messages_leave_out_is_missing_there_only(tmp_path: Path) -> None:
    def message(i: int, t: int) -> dict[str, Any]:
        header = {"header": {"stamp": parts(t, "sec", "nanosec")}, "name": [*NAMES], "position": Q[:, i].tolist()}
        return header | ({"velocity": DQ[:, i].tolist()} if i % 2 else {"velocity": []})

    recording = written(tmp_path / "a.mcap", message)
    check(recording)
    velocity = next(one for name, one in recording.channels.items() if name.endswith("velocity[joint_1]"))
    np.testing.assert_allclose(velocity.time, TIME[1::2], atol=1e-6)
    np.testing.assert_allclose(velocity.values, DQ[0, 1::2])


def test_arrays_of_two_lengths_are_of_two_publishers(tmp_path: Path) -> None:
    recording = written(tmp_path / "a.mcap", lambda i, t: {"stamp": parts(t, "sec", "nanosec"), "q": [0.5] * (2 + i % 2)})
    assert {name: len(one.time) for name, one in recording.channels.items()} == {
        "/state/q[0]": 20, "/state/q[1]": 20, "/state/q[0]#2": 20, "/state/q[1]#2": 20, "/state/q[2]": 20
    }  # fmt: skip
