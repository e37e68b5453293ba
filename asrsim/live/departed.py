"""Peers that were killed or stopped: the farewell that they could not say is said for them.

Fast DDS reaches a peer on this machine through shared memory. Where nobody reads there any more it opens and closes that memory
for every message, at .2 ms each, until the peer's lease ends after 20 s. Told that the peer has left it forgets it at once. A
peer that was only stopped announces itself again when it goes on, and is found again as a new one.
"""

from __future__ import annotations

import os
import socket
import struct
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

_PARTICIPANT, _WRITER, _READER = (bytes.fromhex(entity) for entity in ("000001c1", "000100c2", "000100c7"))
"""A participant, and the two ends of what participants announce."""
_KEY_HASH, _STATUS, _GUID, _END = 0x70, 0x71, 0x50, 0x01
"""Parameters of RTPS: key, status, participant, and the last of a list (OMG DDSI-RTPS 2.5, 9.6)."""
_GONE = bytes((0, 0, 0, 3))
"""Disposed and unregistered."""
_STOPPED = "Tt"
"""States of a process, as Linux lists them: by a signal, by a debugger."""


def dismiss(node: Any, topics: Iterable[str]) -> list[str]:
    """Forget the subscribers of a node's topics that were killed or stopped; returns their nodes' names."""
    mine = next(filter(_own, (prefix for prefix, _ in _ends(node.get_publishers_info_by_topic, topics))), b"")
    found = dict(_ends(node.get_subscriptions_info_by_topic, topics))
    # The prefix begins with the maker and the host.
    gone = [prefix for prefix in found if prefix[:4] == mine[:4] and not awake(prefix)]
    for prefix in gone:
        say_farewell(prefix)
    return [found[prefix] for prefix in gone]


def _ends(ask: Callable[[str], Any], topics: Iterable[str]) -> Iterator[tuple[bytes, str]]:
    """Prefix and node of the publishers or subscribers of topics."""
    return ((bytes(end.endpoint_gid)[:12], end.node_name) for topic in topics for end in ask(topic))


def _own(prefix: bytes) -> bool:
    return int.from_bytes(prefix[4:6], "little") == os.getpid() % 2**16


def awake(prefix: bytes) -> bool:
    """Whether the process of a participant runs, of which Fast DDS puts the number into the prefix of its GUID (12 bytes)."""
    number = int.from_bytes(prefix[4:6], "little")
    for folder in Path("/proc").iterdir():
        if folder.name.isdecimal() and int(folder.name) % 2**16 == number:
            try:
                state = (folder / "stat").read_text().rpartition(") ")[2]
            except OSError:  # it ended just now
                continue
            if state[0] not in _STOPPED:
                return True
    return False


def farewell(prefix: bytes) -> bytes:
    """The message by which a participant leaves: its data, disposed (RTPS 2.3, 8.5.3.2, 9.4.5.3, 9.6.3)."""
    guid = prefix + _PARTICIPANT
    end = struct.pack("<HH", _END, 0)
    status = struct.pack("<HH16sHH4s", _KEY_HASH, 16, guid, _STATUS, 4, _GONE) + end
    key = bytes((0, 3, 0, 0)) + struct.pack("<HH16s", _GUID, 16, guid) + end
    # Announcements have the number 1.
    body = struct.pack("<HH4s4siI", 0, 16, _READER, _WRITER, 0, 2) + status + key
    data, little_endian, with_status, with_key = 0x15, 1, 2, 8
    return (
        b"RTPS\x02\x03\x01\x0f" + prefix + struct.pack("<BBH", data, little_endian | with_status | with_key, len(body)) + body
    )


def say_farewell(prefix: bytes) -> None:
    """Tell this process's participants that another one has left."""
    owned = set()
    for path in Path("/proc/self/fd").iterdir():
        try:
            owned.add(str(path.readlink()))
        except OSError:  # closed just now
            continue
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for line in Path("/proc/self/net/udp").read_text().splitlines()[1:]:
            fields = line.split()
            if f"socket:[{fields[9]}]" in owned:
                sender.sendto(farewell(prefix), ("127.0.0.1", int(fields[1].partition(":")[2], 16)))
