"""The WebSocket for Foxglove: its protocol's own client from npm, and bytes that no client should send."""

import base64
import json
import math
import os
import shutil
import signal
import socket
import subprocess
import sys
from types import SimpleNamespace

import pytest

from support.paths import ROOT

pytest.importorskip("foxglove")

from asrsim.errors import InputError
from asrsim.live.foxglove import FoxgloveTransport, decoded
from asrsim.live.mailbox import LARGEST_MESSAGE, WAITING, WAITING_BYTES
from asrsim.live.origin import origin_of
from asrsim.live.transport import Access, Interface, LiveTopic
from asrsim.log import open_log
from asrsim.runs.rerun import rerun


def test_messages_in_json():
    assert decoded(1, b'{"data": 0.5}').values == [0.5]
    assert decoded(1, b'{"data": [1, null]}').values == pytest.approx([1.0, math.nan], nan_ok=True)
    state = decoded(1, b'{"name": ["a"], "position": [], "effort": [2.0]}')
    assert (state.names, state.values) == (["a"], [2.0])
    point = b'{"positions": [0.5], "time_from_start": {"sec": 1, "nanosec": 500000000}}'
    found = decoded(1, b'{"joint_names": ["a"], "points": [' + point + b"]}")
    assert (found.names, found.points) == (["a"], [(1.5, [0.5], [])])


@pytest.mark.parametrize(
    "data",
    [
        b"", b"{", b"[]", b'{"data": "high"}', b"\xff\xfe", b"[" * 100_000, b"\x00\x01\x00\x00", b'{"position": [1]}',
        b'{"data": 1' + b"0" * 400 + b"}",
        *(b'{"name": [], "position": [], "effort": [], "header": {"stamp": {"sec": %b}}}' % sec for sec in (b"1e308", b"NaN")),
    ],
)  # fmt: skip
def test_unreadable_messages_have_a_fault(data):
    found = decoded(1, data)
    assert found.fault
    assert not found.values


def test_only_this_machine_reaches_a_transport_unless_it_is_said():
    assert Access() == Access(network=False, port=8765, origins=())


def connected(transport, *headers):
    """A client's socket after its request, and the first line of the answer."""
    client = socket.create_connection(("127.0.0.1", transport.port), timeout=10)
    key = base64.b64encode(os.urandom(16)).decode()
    lines = [
        "GET / HTTP/1.1",
        f"Host: 127.0.0.1:{transport.port}",
        "Upgrade: websocket",
        "Connection: Upgrade",
        f"Sec-WebSocket-Key: {key}",
        "Sec-WebSocket-Version: 13",
        "Sec-WebSocket-Protocol: foxglove.sdk.v1",
        *headers,
    ]
    client.sendall("\r\n".join([*lines, "", ""]).encode())
    answer = b""
    while b"\r\n" not in answer and (part := client.recv(64)):
        answer += part
    return client, answer.split(b"\r\n")[0].decode()


@pytest.fixture
def transport():
    notices = []
    interface = Interface("/asrsim", (LiveTopic("/clock", "rosgraph_msgs/Clock"),), (LiveTopic("/go", "std_msgs/Float64"),))
    transport = FoxgloveTransport(interface, Access(port=0, origins=(origin_of("https://Lab.example/"),)), notices.append)
    transport.notices = notices
    yield transport
    transport.close()


@pytest.mark.parametrize(
    "origin",
    [None, "http://localhost", "http://localhost:8080", "https://127.0.0.1:3000", "http://[::1]:1", "file://", "app://lichtblick",
     "https://lab.example"],
)  # fmt: skip
def test_clients_without_origin_and_allowed_pages_connect(transport, origin):
    client, answer = connected(transport, *([] if origin is None else [f"Origin: {origin}"]))
    client.close()
    assert answer == "HTTP/1.1 101 Switching Protocols"


@pytest.mark.parametrize(
    "origin",
    ["https://evil.example", "null", "", "http://localhost.evil.example", "http://localhost@evil.example", "http://127.0.0.1.nip.io",
     "http://lab.example", "https://lab.example:444", "chrome-extension://abc"],
)  # fmt: skip
def test_web_pages_of_other_origins_are_refused_by_name(transport, origin):
    client, answer = connected(transport, f"oRIGIN:{origin}")
    client.close()
    assert answer == "HTTP/1.1 403 Forbidden"
    assert transport.notices[1:] == [f"a web page of {origin} was refused; to allow its commands: --allow-origin {origin}"]


def test_one_foreign_origin_among_several_is_refused(transport):
    client, answer = connected(transport, "Origin: http://localhost", "Origin: https://evil.example")
    client.close()
    assert answer == "HTTP/1.1 403 Forbidden"


def test_commands_that_are_lost_are_counted(transport):
    client = SimpleNamespace(id=1)
    transport.on_client_advertise(client, SimpleNamespace(id=2, topic="/go"))
    for i in range(WAITING + 3):
        transport.on_message_data(client, 2, b'{"data": %d}' % i)
    received = list(transport.poll())
    assert [bool(one.fault) for one in received] == [True] * 3 + [False] * WAITING
    assert received[-1].values == [WAITING + 2]
    assert not list(transport.poll())


def test_waiting_messages_are_limited_by_their_bytes(transport):
    client, channel = SimpleNamespace(id=1), SimpleNamespace(id=2, topic="/go")
    transport.on_client_advertise(client, channel)
    large = b'{"data": 1' + b" " * (LARGEST_MESSAGE - 11) + b"}"
    transport.on_message_data(client, channel.id, large + b" ")
    count = 3 + WAITING_BYTES // LARGEST_MESSAGE
    for _ in range(count):
        transport.on_message_data(client, channel.id, large)
    received = list(transport.poll())
    assert [one.fault.split()[1] for one in received if one.fault] == ["message", *["messages"] * 3]
    assert sum(not one.fault for one in received) == count - 3
    assert not list(transport.poll())


@pytest.mark.parametrize("text", ["lab.example", "https://lab.example/page", "*", "https://"])
def test_an_origin_is_a_scheme_and_a_host(text):
    with pytest.raises(InputError, match="is not an origin"):
        origin_of(text)


@pytest.mark.slow
def test_a_client_of_the_protocol(tmp_path):
    """Channels and client publish, by npm's @foxglove/ws-protocol."""
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
        "--publish-rate", "200", "-o", tmp_path / "out", "--set", "engine=mujoco",
    ]  # fmt: skip
    with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT) as process:
        assert process.stderr is not None
        line = process.stderr.readline()
        assert "ws://127.0.0.1:" in line, line + process.stderr.read()
        address = line.split("foxglove: ")[1].strip()
        client = subprocess.run(
            ["node", ROOT / "tests" / "support" / "live_client.mjs", address, packages],
            capture_output=True,
            text=True,
            check=False,
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
    assert list(open_log(tmp_path / "out" / "log.mcap").commands())[-1].value == 0.1
    live = json.loads((tmp_path / "out" / "summary.json").read_text())["live"]
    assert (live["commands"], sum(live["dropped"].values())) == (100, 5)
    assert rerun(tmp_path / "out" / "log.mcap").identical
