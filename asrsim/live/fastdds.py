"""Fast DDS's settings for a live run, which ROS's own interface does not reach: where it listens, and how it sends."""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_LOCAL = "<interfaceWhiteList><address>127.0.0.1</address></interfaceWhiteList>"
_PROFILES = """\
<?xml version="1.0" encoding="UTF-8" ?>
<dds><profiles xmlns="http://www.eprosima.com">
  <transport_descriptors><transport_descriptor>
    <transport_id>memory</transport_id><type>SHM</type>
  </transport_descriptor><transport_descriptor>
    <transport_id>udp</transport_id><type>UDPv4</type><maxInitialPeersRange>32</maxInitialPeersRange>{whitelist}
  </transport_descriptor></transport_descriptors>
  <participant profile_name="asrsim" is_default_profile="true"><rtps>
    <builtin>{discovery}</builtin>
    <userTransports>{memory}<transport_id>udp</transport_id></userTransports>
    <useBuiltinTransports>false</useBuiltinTransports>
  </rtps></participant>
  <data_writer profile_name="asrsim" is_default_profile="true"><qos><reliability>
    <kind>RELIABLE</kind><max_blocking_time><sec>0</sec><nanosec>1000000</nanosec></max_blocking_time>
  </reliability></qos><times>
    <heartbeat_period><sec>0</sec><nanosec>100000000</nanosec></heartbeat_period>
    <nack_supression_duration><sec>0</sec><nanosec>20000000</nanosec></nack_supression_duration>
  </times></data_writer>
</profiles></dds>
"""
"""Shared memory to peers of this machine and of Fast DDS's own version, UDP to others: it takes a quarter less. Publishers
ask every 100 ms, not every 3 s, what has come, or what nobody has confirmed piles up; they wait 20 ms before they send
again, or every message sets a timer of its own, which wakes a thread; and where that goes on a message waits for 1 ms, not
for 100, before it is given up."""
_LOCAL_PEERS = (
    "<metatrafficUnicastLocatorList><locator/></metatrafficUnicastLocatorList>"
    "<initialPeersList><locator><udpv4><address>127.0.0.1</address></udpv4></locator></initialPeersList>"
)


_MEMORY, _ROOM = Path("/dev/shm"), 2**24
"""Where shared memory is, and bytes that must be free there: Fast DDS does not ask, and a bus error would end the process."""


@contextmanager
def settings(*, network: bool) -> Iterator[None]:
    """In force for the participant that is made within; what the user has set stands above them.

    network: also other machines; else the sockets are bound to 127.0.0.1. Fast DDS reads its settings once: where rclpy is at
    work already, ROS's own way to be local remains, which listens on all interfaces and takes no part of what comes there.
    """
    # Before its third version, which came with Kilted, library and variable had another name.
    variable = "FASTRTPS_DEFAULT_PROFILES_FILE" if folders_with("libfastrtps.so") else "FASTDDS_DEFAULT_PROFILES_FILE"
    changes = {} if network else {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    with tempfile.TemporaryDirectory(prefix="asrsim-") as folder:
        if variable not in os.environ and "rclpy" not in sys.modules:
            path = Path(folder) / "fastdds.xml"
            local = {"whitelist": "", "discovery": ""} if network else {"whitelist": _LOCAL, "discovery": _LOCAL_PEERS}
            memory = "<transport_id>memory</transport_id>" if _memory_is_there() else ""
            path.write_text(_PROFILES.format(memory=memory, **local))
            changes[variable] = str(path)
            if not network:
                # ROS's own way to be local would listen on all interfaces.
                changes["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "SYSTEM_DEFAULT"
        before = {name: os.environ.get(name) for name in changes}
        os.environ.update(changes)
        try:
            yield
        finally:
            for name, value in before.items():
                if value is None:
                    del os.environ[name]
                else:
                    os.environ[name] = value


def _memory_is_there() -> bool:
    return os.access(_MEMORY, os.W_OK) and shutil.disk_usage(_MEMORY).free > _ROOM


def folders_with(library: str) -> list[Path]:
    """Those of LD_LIBRARY_PATH, which ROS environments and the wheels set, that hold a library."""
    folders = os.environ.get("LD_LIBRARY_PATH", "").split(os.pathsep)
    return [Path(folder) for folder in folders if folder and (Path(folder) / library).exists()]
