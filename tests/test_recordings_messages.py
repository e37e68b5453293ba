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
    "a unit in its name": lambda i, t: {"timestamp_us": (t - ZERO) // 1000, **of(i)},
    "seconds since 1970": lambda i, t: {"timestamp": t / 1e9, **of(i)},
    "nanoseconds since 1970": lambda i, t: {"time": t, **of(i)},
}


@pytest.mark.parametrize("name", SENT)
def test_messages_that_say_when_they_were_sent_were_measured_then(tmp_path: Path, name: str) -> None:
    check(written(tmp_path / "a.mcap", SENT[name]))


def test_a_time_of_unknown_unit_is_asked_about_where_it_goes_otherwise(tmp_path: Path) -> None:
    def message(i: int, _: int) -> dict[str, Any]:
        return {"t": TIME[i], "timeout_s": 3.0, **of(i)}

    slow, same = (written(tmp_path / f"{factor}.mcap", message, factor) for factor in (1.5, 1.0))
    assert [one.key for one in slow.findings if one.code == "two-time-bases"] == ["/state/t"]
    np.testing.assert_allclose(slow.column("joint_1", "link_position").time, 1.5 * TIME, atol=1e-6)
    assert not [one for one in same.findings if one.code == "two-time-bases"]


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


def test_what_a_controller_measures_stands_before_what_it_gives_out(tmp_path: Path) -> None:
    def message(i: int, t: int) -> dict[str, Any]:
        states = [
            {"name": name, "output": 5.0, "command": 7.0, "feedback": Q[j, i], "set_point": DQ[j, i]}
            for j, name in enumerate(NAMES)
        ]
        return {"stamp": parts(t, "sec", "nanosec"), "dof_states": states}

    recording = written(tmp_path / "a.mcap", message)
    check(recording)
    check(recording, "reference_1", DQ)
