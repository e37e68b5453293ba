"""ROS 2 transport with rclpy. The transport publishes CDR and takes messages without an executor, so that all work is done in
the simulation's thread.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time as clock
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from threading import Event, Lock, Thread
from typing import Any

from asrsim.errors import InputError, counted
from asrsim.extras import install
from asrsim.live.mailbox import Mailbox
from asrsim.live.transport import Access, Interface, Received, TellUser, received

DEPTH = 300
"""Number of messages that a publisher keeps for slow subscribers. For each new message, the publisher searches all kept
messages. With 1000 kept messages, a reliable subscriber that takes no messages slows a run tenfold.
"""
MOST = 1000
"""Largest number of messages that a subscription keeps, and that one call reads."""
UNREAD = 0.02
"""Time in s for which the simulation may leave waiting messages unread; then a thread moves the messages to the mailbox. A
subscription limits only the number of its messages; the mailbox also limits their bytes.
"""
LOOK = 0.05
"""Time between two checks for new subscribers and new publishers, s."""
LOCAL = (
    "<interfaceWhiteList><address>127.0.0.1</address></interfaceWhiteList>",
    (
        "<metatrafficUnicastLocatorList><locator/></metatrafficUnicastLocatorList>"
        "<initialPeersList><locator><udpv4><address>127.0.0.1</address></udpv4></locator></initialPeersList>"
    ),
)
"""Settings of transport and discovery that bind Fast DDS's sockets to this machine."""
PROFILES = """\
<?xml version="1.0" encoding="UTF-8" ?>
<dds><profiles xmlns="http://www.eprosima.com">
  <transport_descriptors><transport_descriptor>
    <transport_id>udp</transport_id><type>UDPv4</type><maxInitialPeersRange>32</maxInitialPeersRange>{}
  </transport_descriptor></transport_descriptors>
  <participant profile_name="asrsim" is_default_profile="true"><rtps>
    <builtin>{}</builtin>
    <userTransports><transport_id>udp</transport_id></userTransports>
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
"""Settings of Fast DDS that ROS does not offer. Only UDP is used: shared memory is a quarter faster, but becomes slow for 20 s
after a subscriber was killed. Publishers ask for acknowledgements every 100 ms instead of 3 s, and wait 20 ms before sending
again. A message blocked by a subscriber is dropped after 1 ms instead of 100 ms.
"""


class Outbox:
    """Sends messages, and tells the user if a subscriber does not receive them in time."""

    def __init__(self, publishers: Sequence[Any], tell: TellUser) -> None:
        """publishers: rclpy's publisher of each outlet that is not latched; None if the package of its message is not
        installed.
        """
        self._publishers, self._tell, self._unsent = publishers, tell, 0

    def send(self, messages: Sequence[bytes], wanted: Sequence[bool]) -> None:
        """Send one message to each topic that is wanted; an empty message is left out. The user is told of the first and the
        thousandth lost message.
        """
        for publisher, message, one_wanted in zip(self._publishers, messages, wanted, strict=True):
            if one_wanted and message:
                try:
                    publisher.handle.publish_raw(message)
                except RuntimeError:  # rclpy raises it when a subscriber does not take the message in time
                    self._unsent += 1
                    if self._unsent in (1, 1000):
                        self._tell(f"{counted(self._unsent, 'message')} dropped so far: a subscriber does not keep up")


class RosTransport:
    """ROS node with the topics of a run."""

    def __init__(self, interface: Interface, access: Access, tell: TellUser) -> None:
        rclpy = load_rclpy()
        from rclpy.context import Context
        from rclpy.qos import DurabilityPolicy, QoSProfile
        from rclpy.signals import SignalHandlerOptions

        self._context = Context()
        namespace, _, name = interface.node.strip("/").rpartition("/")
        try:
            with fast_dds(network=access.network):
                rclpy.init(context=self._context, domain_id=access.domain, signal_handler_options=SignalHandlerOptions.NO)
                options = {"namespace": namespace or None, "use_global_arguments": False, "enable_rosout": False}
                self._node = rclpy.create_node(name, context=self._context, **options)
        except Exception as error:  # rclpy raises errors of many types
            self._context.try_shutdown()
            raise InputError(f"ROS 2 cannot be started: {type(error).__name__}: {error}", hint=_cure(), code="ros") from error
        once = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        missing = set[str]()
        self._publishers: list[Any] = []
        """Publishers of the outlets; see `Outbox`."""
        for outlet in interface.outlets:
            kind = message_type(outlet.message)
            quality = once if outlet.latched else QoSProfile(depth=DEPTH)
            publisher = kind and self._node.create_publisher(kind, outlet.name, quality)
            if not publisher:
                missing.add(outlet.message.partition("/")[0])
            elif outlet.latched:
                publisher.publish(outlet.latched)
            if not outlet.latched:
                self._publishers.append(publisher)
        self._subscriptions = [
            (number, kind, self._node.create_subscription(kind, inlet.name, lambda message: None, QoSProfile(depth=MOST)))
            for number, inlet in enumerate(interface.inlets)
            if (kind := message_type(inlet.message))
        ]
        self._kinds = {number: kind for number, kind, _ in self._subscriptions}
        self._outbox = Outbox(self._publishers, tell)
        self._mailbox, self._lock, self._closed = Mailbox(), Lock(), Event()
        self._look()
        self._taken = clock.monotonic()
        self._thread = Thread(target=self._empty, daemon=True)
        self._thread.start()
        reach = "the network" if access.network else "this machine"
        left = f" (without topics of {', '.join(sorted(missing))}, which are not installed here)" if missing else ""
        tell(f"ros: node {self._node.get_fully_qualified_name()}, domain {self._context.get_domain_id()}, {reach}{left}")

    def publish(self, time: int, messages: Sequence[bytes]) -> None:
        """Publish messages; see `Transport.publish`."""
        self._outbox.send(messages, self.wanted)

    def poll(self) -> Iterator[Received]:
        """Received messages; see `Transport.poll`."""
        if clock.monotonic() - self._looked > LOOK:
            self._look()
        self._take()
        return self._mailbox.take(self._decoded)

    def _take(self) -> None:
        """Move the waiting messages of all subscriptions to the mailbox."""
        with self._lock:
            for number, kind, subscription in self._spoken_to:
                for _ in range(MOST):
                    taken = subscription.handle.take_message(kind, True)
                    if taken is None:
                        break
                    data, about = taken
                    self._mailbox.put(number, data, sent=1e-9 * about["source_timestamp"])
            self._taken = clock.monotonic()

    def _empty(self) -> None:
        """Move messages to the mailbox while the simulation reads none, such as during a long step."""
        while not self._closed.wait(UNREAD):
            if clock.monotonic() - self._taken > UNREAD:
                self._take()

    def _decoded(self, inlet: int, data: bytes, sent: float) -> Received:
        from rclpy.serialization import deserialize_message

        try:
            message = deserialize_message(data, self._kinds[inlet])
        except Exception:  # rclpy raises errors of many types
            message = None
        return received(inlet, message, sent=sent)

    def _look(self) -> None:
        """Find the topics with subscribers, and the topics with publishers."""
        self._looked = clock.monotonic()
        self.wanted: Sequence[bool] = [each is not None and each.get_subscription_count() > 0 for each in self._publishers]
        self._spoken_to = [one for one in reversed(self._subscriptions) if one[2].get_publisher_count()]

    def close(self) -> None:
        """Close the node; see `Transport.close`."""
        self._closed.set()
        self._thread.join()
        self._node.destroy_node()
        self._context.try_shutdown()


def message_type(name: str) -> Any:
    """Class of a message such as `std_msgs/Float64`; None if its package is not installed."""
    package, _, kind = name.partition("/")
    try:
        return getattr(import_module(f"{package}.msg"), kind, None)
    except ImportError:
        return None


@contextmanager
def fast_dds(*, network: bool) -> Iterator[None]:
    """Context manager that applies Fast DDS's settings to the participant created inside; settings of the user have priority.

    network: whether other machines are also reached; if not, the sockets are bound to 127.0.0.1. If the user has settings,
    ROS's range `LOCALHOST` is used instead, which listens on all interfaces but accepts nothing from other machines.
    """
    # Fast DDS 3 (since ROS Kilted) has different names for the library and the variable.
    variable = "FASTRTPS_DEFAULT_PROFILES_FILE" if _folders_with("libfastrtps.so") else "FASTDDS_DEFAULT_PROFILES_FILE"
    before = dict(os.environ)
    with tempfile.TemporaryDirectory(prefix="asrsim-") as folder:
        if variable not in os.environ:
            path = Path(folder) / "fastdds.xml"
            path.write_text(PROFILES.format(*(("", "") if network else LOCAL)))
            os.environ[variable] = str(path)
        if not network:
            os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST" if variable in before else "SYSTEM_DEFAULT"
        try:
            yield
        finally:
            os.environ.clear()
            os.environ.update(before)


def load_rclpy() -> Any:
    """The module rclpy of this Python environment, or of a sourced ROS for this Python version. Raises InputError if these two
    conflict.
    """
    # The rclpy wheels set this environment variable to folders of this Python environment.
    foreign = [
        folder for folder in _folders_with("librcl.so") if not folder.resolve().is_relative_to(Path(sys.prefix).resolve())
    ]
    spec = find_spec("rclpy")
    origin = (spec and spec.origin) or ""
    if "site-packages" in origin and foreign:
        message = (
            f"a ROS environment is sourced: its libraries in {foreign[0]} take precedence over the libraries of this Python's "
            "rclpy"
        )
        raise InputError(message, hint=_cure(), code="ros-sourced")
    wanted = os.environ.get("RMW_IMPLEMENTATION", "")
    # Look for the library of the chosen middleware. Without this library, ROS would end the process.
    if wanted and _folders_with("librcl.so") and not _folders_with(f"lib{wanted}.so"):
        message = f"RMW_IMPLEMENTATION names '{wanted}', which is not installed here"
        raise InputError(message, hint="Start with: env -u RMW_IMPLEMENTATION asrsim live ...", code="ros-rmw")
    try:
        return import_module("rclpy")
    except Exception as error:  # a ROS library built for another system may raise any error
        message = f"rclpy of {origin} cannot be loaded: {(str(error).strip().splitlines() or [type(error).__name__])[0]}"
        raise InputError(message, hint=_cure(), code="ros-sourced") from error


def _folders_with(library: str) -> list[Path]:
    """Folders of LD_LIBRARY_PATH that contain the library with this name."""
    folders = os.environ.get("LD_LIBRARY_PATH", "").split(os.pathsep)
    return [Path(folder) for folder in folders if folder and (Path(folder) / library).exists()]


def _cure() -> str:
    if os.environ.get("AMENT_PREFIX_PATH") or os.environ.get("ROS_DISTRO"):
        return (
            "A ROS environment is sourced in this shell; use a new one, or start with: env -u PYTHONPATH -u LD_LIBRARY_PATH "
            "-u AMENT_PREFIX_PATH -u RMW_IMPLEMENTATION asrsim live ..."
        )
    return install("ros")
