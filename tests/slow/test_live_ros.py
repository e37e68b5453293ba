"""Live runs with ROS 2 nodes in separate Python environments, over loopback. Needs rclpy wheels in all environments.

ASRSIM_PEERS names a folder with the environments `jazzy` and `kilted`. Without it, the tests create them in the user's cache:
python3.11 -m venv jazzy && jazzy/bin/pip install 'ros-jazzy-rclpy[fastrtps]' ros-jazzy-common-interfaces; also for Kilted.
"""

import json
import os
import resource
import signal
import subprocess
import sys
import time
from importlib.util import find_spec
from pathlib import Path
from xml.etree import ElementTree

import pytest

from asrsim.errors import InputError
from asrsim.live.mailbox import LARGEST_MESSAGE, WAITING_BYTES
from asrsim.live.ros import RosTransport, fast_dds, load_rclpy
from asrsim.live.transport import Access, Interface, LiveTopic
from asrsim.log import open_log
from asrsim.runs.rerun import rerun
from support.paths import ROOT

PACKAGES = {"jazzy": "ros-jazzy-", "kilted": "ros-"}
DOMAIN = 87
PEER = ROOT / "tests" / "support" / "live_peer.py"
# The wheels restart Python with their library folders and mark this in the environment. Other nodes need their own restart.
_OURS = ("PYTHONPATH", "LD_LIBRARY_PATH", "AMENT_PREFIX_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE")
ALONE = {key: value for key, value in os.environ.items() if key not in _OURS}
SCENARIO = """\
robot: {root}/examples/urdf/dof2_horizontal.urdf
duration: 1.0
engine: mujoco
references: {{"*": {{equilibrium_position: 0.0, stiffness_preset: 0.2}}}}
reference_ranges: {{"*": {{equilibrium_position: [-1, 1], stiffness_preset: [0, 0.3], external_torque: [-1, 1]}}}}
"""


def test_incompatible_ros_environment_is_reported(tmp_path, asrsim_command, tiny, monkeypatch):
    """A sourced ROS distribution for another Python version comes first on the path, and its rclpy cannot be loaded."""
    if find_spec("rclpy") is None:
        (tmp_path / "rclpy").mkdir()
        (tmp_path / "rclpy" / "__init__.py").write_text("raise ImportError('_rclpy_pybind11.cpython-312 not found')")
        monkeypatch.syspath_prepend(tmp_path)
    else:
        (tmp_path / "librcl.so").write_text("")
        monkeypatch.setenv("LD_LIBRARY_PATH", str(tmp_path))
    monkeypatch.setenv("ROS_DISTRO", "jazzy")
    monkeypatch.setenv("AMENT_PREFIX_PATH", "/opt/ros/jazzy")
    done = asrsim_command("live", tiny.scenario, "--on", "ros", "--duration", 0.1, "--set", "compiled=false")
    assert done.code == 1
    assert "sourced" in done.err
    assert "env -u PYTHONPATH" in done.err
    assert "Traceback" not in done.err


def test_missing_ros_middleware_is_refused(tmp_path, monkeypatch):
    """Without this check, ROS would end the process without a helpful message."""
    (tmp_path / "librcl.so").write_text("")
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    monkeypatch.setenv("LD_LIBRARY_PATH", f"/nowhere{os.pathsep}{tmp_path}")
    monkeypatch.setenv("RMW_IMPLEMENTATION", "rmw_cyclonedds_cpp")
    with pytest.raises(InputError, match=r"names 'rmw_cyclonedds_cpp'.*env -u RMW_IMPLEMENTATION"):
        load_rclpy()


PROFILES, RANGE = "FASTDDS_DEFAULT_PROFILES_FILE", "ROS_AUTOMATIC_DISCOVERY_RANGE"


@pytest.mark.parametrize("network", [False, True])
def test_fast_dds_listens_on_loopback_unless_configured(monkeypatch, network):
    for name in (PROFILES, RANGE, "LD_LIBRARY_PATH"):
        monkeypatch.delenv(name, raising=False)
    with fast_dds(network=network):
        path = Path(os.environ[PROFILES])
        root = ElementTree.parse(path).getroot()
        assert os.environ.get(RANGE) == (None if network else "SYSTEM_DEFAULT")
    said = {element.tag.rpartition("}")[2]: element for element in root.iter()}
    assert said["useBuiltinTransports"].text == "false"
    assert ("interfaceWhiteList" in said) == ("initialPeersList" in said) == (not network)
    assert set(os.environ).isdisjoint({PROFILES, RANGE})
    assert not path.exists()
    monkeypatch.setenv(PROFILES, "mine.xml")
    with fast_dds(network=network):
        assert os.environ[PROFILES] == "mine.xml"
        assert os.environ.get(RANGE) == (None if network else "LOCALHOST")


@pytest.fixture(scope="session")
def peers():
    """Python interpreter of each environment, by name."""

    def python(name):
        folder = Path(os.environ.get("ASRSIM_PEERS", Path.home() / ".cache" / "asrsim-peers")) / name
        if not (folder / "bin" / "python").exists():
            subprocess.run(["python3.11", "-m", "venv", folder], check=True, env=ALONE)
            names = [f"{PACKAGES[name]}rclpy[fastrtps]", f"{PACKAGES[name]}common-interfaces"]
            done = subprocess.run([folder / "bin" / "pip", "install", "-q", *names], check=False, env=ALONE)
            if done.returncode:
                pytest.skip(f"no wheels of {name}'s rclpy here")
        return folder / "bin" / "python"

    return python


@pytest.fixture
def server(tmp_path):
    """Live run with ROS that ends with the test."""
    if find_spec("rclpy") is None:
        pytest.skip("rclpy is not installed here")
    path = tmp_path / "arm.yaml"
    path.write_text(SCENARIO.format(root=ROOT))
    # At this rate, a node on a busy machine may pause for seconds before its queue drops messages.
    options = ["--on", "ros", "--domain", str(DOMAIN), "--publish-rate", "200", "-o", tmp_path / "out"]
    command = [sys.executable, "-m", "asrsim", "live", path, *options]
    with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT) as process:
        assert process.stderr is not None
        line = process.stderr.readline()
        assert "node /asrsim" in line, line + process.stderr.read()
        yield process, tmp_path / "out"
        process.kill()


def ended(process):
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=120)
    assert process.returncode == 0, err
    return out


def watch(python, seconds, rate):
    done = subprocess.run(
        [python, PEER, str(seconds), str(DOMAIN), str(rate)],
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
        env=ALONE,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def listening(process):
    """Addresses (hexadecimal, as Linux lists them) of a process's UDP sockets."""
    owned = {str(path.readlink()) for path in Path(f"/proc/{process.pid}/fd").iterdir()}
    lines = [line.split() for line in Path("/proc/net/udp").read_text().splitlines()[1:]]
    return {line[1].split(":")[0] for line in lines if f"socket:[{line[9]}]" in owned}


@pytest.mark.slow
def test_waiting_messages_are_limited_by_their_bytes():
    """Messages of 1 MB while the simulation takes none, as in a long step."""
    rclpy = pytest.importorskip("rclpy")
    from rclpy.context import Context
    from std_msgs.msg import Float64MultiArray

    interface = Interface("/asrsim", (), (LiveTopic("/go", "std_msgs/Float64MultiArray"),))
    transport, context = RosTransport(interface, Access(domain=DOMAIN), lambda text: None), Context()
    with fast_dds(network=False):
        rclpy.init(context=context, domain_id=DOMAIN)
        node = rclpy.create_node("user", context=context, use_global_arguments=False)
    publisher = node.create_publisher(Float64MultiArray, "/go", 5)
    limit = time.monotonic() + 30
    while not publisher.get_subscription_count() and time.monotonic() < limit:
        time.sleep(0.05)
    transport.poll()
    size = LARGEST_MESSAGE // 8 - 100
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for number in range(400):
        publisher.publish(Float64MultiArray(data=[float(number)] * size))
        time.sleep(0.02)
    received = list(transport.poll())
    grown = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
    node.destroy_node()
    context.try_shutdown()
    transport.close()
    assert received[-1].values == [399.0] * size
    assert sum(not one.fault for one in received) <= WAITING_BYTES / (8 * size)
    assert {one.fault for one in received} == {"", "more messages than the run can process"}
    assert grown < 200e6


@pytest.mark.slow
@pytest.mark.parametrize("name", ["jazzy", "kilted"])
def test_ros_node_receives_every_topic_and_moves_the_arm(server, peers, name):
    process, folder = server
    assert listening(process) == {"0100007F"}
    seen = watch(peers(name), 4.0, 100)
    assert len(seen["outlets"]) >= 18
    assert set(seen["outlets"]) - {"/robot_description"} == set(seen["counts"])
    assert not seen["gaps"]
    assert seen["description"]["/robot_description"] > 1000
    assert seen["inlets"]
    assert max(map(abs, seen["positions"].values())) > 0.01
    assert [seen["applied"][f"joint_{i}.stiffness_preset"] for i in (1, 2)] == [0.25, 0.25]
    out = ended(process)
    assert "asrsim rerun" in out
    commands = list(open_log(folder / "log.mcap").commands())
    assert len(commands) > 50
    assert rerun(folder / "log.mcap").identical
