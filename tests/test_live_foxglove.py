"""The WebSocket for Foxglove: its protocol's own client from npm, and bytes that no client should send."""

from __future__ import annotations

import json
import math
import shutil
import signal
import struct
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("foxglove")

from asrsim.live.foxglove import read
from asrsim.runs.repeat import repeat

ROOT = Path(__file__).parents[1]
FLOAT, ARRAY, STATE = "std_msgs/Float64", "std_msgs/Float64MultiArray", "sensor_msgs/JointState"


def test_messages_in_both_encodings():
    assert read(1, FLOAT, "json", b'{"data": 0.5}').values == [0.5]
    assert read(1, FLOAT, "cdr", b"\x00\x01\x00\x00" + struct.pack("<d", 0.5)).values == [0.5]
    assert read(2, ARRAY, "json", b'{"data": [1, null]}').values[0] == 1.0
    assert math.isnan(read(2, ARRAY, "json", b'{"data": [1, null]}').values[1])
    state = read(3, STATE, "json", b'{"name": ["a"], "position": [], "effort": [2.0]}')
    assert (state.names, state.values) == (["a"], [2.0])


@pytest.mark.parametrize(
    ("message", "encoding", "data"),
    [
        (FLOAT, "json", b"{"),
        (FLOAT, "json", b"[]"),
        (FLOAT, "json", b'{"data": "high"}'),
        (FLOAT, "json", b"\xff\xfe"),
        (FLOAT, "json", b"[" * 100_000),
        (FLOAT, "cdr", b""),
        (FLOAT, "cdr", b"\x00\x01\x00\x00\x00"),
        (FLOAT, "protobuf", b"\x00"),
        (ARRAY, "json", b'{"data": 3}'),
        (ARRAY, "cdr", b"\x00\x01\x00\x00" + b"\xff" * 40),
        (STATE, "json", b'{"position": [1]}'),
        (STATE, "cdr", b"\x00\x01\x00\x00" + b"\xff" * 40),
    ],
)
def test_bytes_that_cannot_be_read_say_so(message, encoding, data):
    received = read(1, message, encoding, data)
    assert received.fault
    assert not received.values


@pytest.mark.slow
def test_a_client_of_the_protocol(tmp_path):
    """Channels, client publish, parameters and services, by npm's @foxglove/ws-protocol."""
    if shutil.which("npm") is None or shutil.which("node") is None:
        pytest.skip("node and npm are not installed")
    packages = tmp_path / "node"
    packages.mkdir()
    (packages / "package.json").write_text('{"name": "client", "private": true}')
    done = subprocess.run(["npm", "install", "@foxglove/ws-protocol", "ws"], cwd=packages, capture_output=True, check=False)
    if done.returncode:
        pytest.skip("npm cannot install the client")
    scenario = ROOT / "examples" / "scenarios" / "step_2dof.yaml"
    command = [
        sys.executable, "-m", "asrsim", "live", scenario, "--variant", "soft", "--on", "foxglove", "--port", "0",
        "--rate", "200", "-o", tmp_path / "out", "--set", "engine=mujoco",
    ]  # fmt: skip
    with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT) as process:
        assert process.stderr is not None
        line = process.stderr.readline()
        assert "ws://127.0.0.1:" in line, line + process.stderr.read()
        address = line.split("foxglove: ")[1].strip()
        client = subprocess.run(
            ["node", ROOT / "tests" / "live_client.mjs", address, packages], capture_output=True, text=True, check=False
        )
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=120)
    assert client.returncode == 0, client.stdout + client.stderr
    assert process.returncode == 0, err
    seen = json.loads(client.stdout)
    assert seen["subprotocol"] == "foxglove.sdk.v1"
    assert not seen["errors"]
    for topic, channel in seen["channels"].items():
        assert (channel["encoding"], channel["schemaEncoding"]) == ("cdr", "ros2msg"), topic
    assert set(seen["messages"]) == set(seen["channels"])
    assert seen["messages"]["/robot_description"] == 1
    assert seen["values"]["/joint_1/applied/equilibrium_position"] == 0.1
    assert seen["values"]["/joint_2/applied/equilibrium_position"] == -0.1
    first, second = (seen["parameters"][name] for name in ("first", "second"))
    assert [(one["name"], one["value"]) for one in first] == [("speed", 1)]
    assert [(one["name"], one["value"]) for one in second] == [("speed", 2)]
    assert sorted(seen["services"]) == [f"/asrsim/{name}" for name in ("pause", "release", "reset", "step")]
    assert [seen["answers"][number]["success"] for number in "1234"] == [True, True, True, False]
    live = json.loads((tmp_path / "out" / "summary.json").read_text())["live"]
    assert live["commands"] == 200
    assert sum(live["dropped"].values()) == 5
    assert repeat(tmp_path / "out" / "log.mcap").identical
