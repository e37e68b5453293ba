"""ROS 2 by rclpy: raw CDR out, messages taken without an executor, so that nothing but the simulation's thread is at work."""

from __future__ import annotations

import math
import os
import struct
import sys
import time as clock
from collections.abc import Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from asrsim.errors import InputError
from asrsim.extras import install
from asrsim.live.departed import dismiss
from asrsim.live.fastdds import folders_with, settings
from asrsim.live.transport import Access, Interface, Received

DEPTH = 300
"""Messages that a publisher keeps for subscribers that are behind. It looks through all of them for each that it sends: with
1000 a reliable subscriber that keeps all and takes none slows a run tenfold."""
MOST = 1000
"""Messages that a subscription keeps for us, and that are taken at once; what waits too long is overtaken."""
SERVICES_EVERY = 0.05
"""s between looks at services, parameters, and who listens and speaks."""
MOST_PUBLISHERS = 1000
"""Publishers whose numbers are kept, so that lost commands are counted."""
_FLOAT64 = struct.Struct("<4xd")
"""Most commands, little-endian as the second byte tells: read in a fifth of what rclpy takes."""
SLOW, SLOW_TIMES = 50e-6, 20
"""s a message and times in a row that make one look for peers that no longer read."""
SUSPICIONS_EVERY = 1.0
"""s between such looks, which take milliseconds."""


class RosTransport:
    """A node with the run's topics, services and parameters."""

    def __init__(self, interface: Interface, access: Access) -> None:
        self.lost = 0
        self.notices: list[str] = []
        self._slow, self._suspected = 0, 0.0
        self._unsent = 0
        self._interface = interface
        with settings(network=access.network):
            self._context, self._node = self._begin(load_rclpy(), access)
        from rclpy.serialization import deserialize_message

        self._deserialize = deserialize_message
        skipped = self._publish_all()
        self._subscriptions = [self._subscribe(number) for number in range(len(interface.inlets))]
        self._spoken_to = self._subscriptions
        """Those that have publishers."""
        self._numbers: dict[tuple[int, bytes], int] = {}
        self._serve()
        self.wanted = self._listened_to()
        self._looked = clock.monotonic()
        domain = self._context.get_domain_id()
        reach = "the network" if access.network else "this machine"
        self.where = f"node {self._node.get_fully_qualified_name()}, domain {domain}, {reach}"
        if skipped:
            names = ", ".join(sorted(skipped))
            self.where += f" (without topics of {names}, which are not installed here)"

    # -- setting up -------------------------------------------------------------------------------------------------

    def _begin(self, rclpy: Any, access: Access) -> tuple[Any, Any]:
        """Context and node."""
        from rclpy.context import Context
        from rclpy.signals import SignalHandlerOptions

        context = Context()
        namespace, _, name = self._interface.node.strip("/").rpartition("/")
        try:
            rclpy.init(context=context, domain_id=access.domain, signal_handler_options=SignalHandlerOptions.NO)
            return context, rclpy.create_node(
                name, namespace=namespace or None, context=context, use_global_arguments=False, enable_rosout=False
            )  # fmt: skip
        except Exception as error:  # of rclpy's own kinds
            context.try_shutdown()
            message = f"ROS 2 cannot be started: {type(error).__name__}: {error}"
            raise InputError(message, hint=_cure(), code="ros") from error

    def _publish_all(self) -> set[str]:
        from rclpy.qos import DurabilityPolicy, QoSProfile

        stream = QoSProfile(depth=DEPTH)
        once = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        skipped: set[str] = set()
        self._publishers: list[Any] = []
        """Of the outlets that are not latched, None where the type is not there."""
        self._raw: list[Any] = []
        """What they send CDR with."""
        self._latched: list[Any] = []
        for outlet in self._interface.outlets:
            kind = message_type(outlet.message)
            publisher = None
            if kind is None:
                skipped.add(outlet.message.split("/")[0])
            else:
                publisher = self._node.create_publisher(kind, outlet.name, once if outlet.latched else stream)
            if not outlet.latched:
                self._publishers.append(publisher)
                self._raw.append(publisher and publisher.handle.publish_raw)
            elif publisher is not None:
                publisher.publish(self._interface.latched[outlet.name])
                self._latched.append(publisher)
        return skipped

    def _subscribe(self, number: int) -> tuple[int, Any, Any, Any]:
        from rclpy.qos import QoSProfile

        inlet = self._interface.inlets[number]
        kind = message_type(inlet.message)
        subscription = self._node.create_subscription(kind, inlet.name, lambda message: None, QoSProfile(depth=MOST))
        return number, subscription.handle.take_message, kind, subscription

    def _serve(self) -> None:
        from std_srvs.srv import SetBool, Trigger

        for name, service in self._interface.services.items():

            def answer(request: Any, response: Any, service: Any = service) -> Any:
                response.success, response.message = service.call(bool(getattr(request, "data", False)))
                return response

            self._node.create_service(SetBool if service.takes_flag else Trigger, f"~/{name}", answer)
        for name, parameter in self._interface.parameters.items():
            value = parameter.get()
            # An endless speed has no number that others could set.
            self._node.declare_parameter(name, value if value < 1e300 else 1.0)
        self._node.add_on_set_parameters_callback(self._set_parameters)

    def _set_parameters(self, parameters: Sequence[Any]) -> Any:
        from rcl_interfaces.msg import SetParametersResult

        for given in parameters:
            parameter = self._interface.parameters.get(given.name)
            if parameter is not None:
                number = isinstance(given.value, float | int) and not isinstance(given.value, bool)
                fault = parameter.set(float(given.value)) if number else "must be a number"
                if fault:
                    return SetParametersResult(successful=False, reason=fault)
        return SetParametersResult(successful=True)

    # -- running ----------------------------------------------------------------------------------------------------

    def publish(self, time: int, messages: Sequence[bytes]) -> None:
        """See :class:`asrsim.live.transport.Transport`."""
        begun = clock.perf_counter()
        for send, message, wanted in zip(self._raw, messages, self.wanted, strict=True):
            if wanted and message:
                try:
                    send(message)
                except RuntimeError:  # rclpy's: it waited for a subscriber that does not keep up
                    self._give_up_message()
        slow = clock.perf_counter() - begun > SLOW * max(sum(self.wanted), 1)
        self._slow = self._slow + 1 if slow else 0

    def _give_up_message(self) -> None:
        self._unsent += 1
        if math.log10(self._unsent).is_integer():
            self.notices.append(f"{self._unsent} messages given up so far: a subscriber does not keep up")

    def poll(self) -> Iterator[Received]:
        """See :class:`asrsim.live.transport.Transport`."""
        left, now = MOST, clock.monotonic()
        look = now - self._looked > SERVICES_EVERY
        for number, take, kind, _ in self._subscriptions if look else self._spoken_to:
            # Taken as bytes, an empty place is seen in half the time.
            while left and (taken := take(kind, True)) is not None:
                left -= 1
                data, about = taken
                self._count(number, about)
                yield self._read(number, kind, data)
        if look:
            self._looked = now
            self._answer()
            self.wanted = self._listened_to()
            # Who spoke and went is heard at the next look.
            self._spoken_to = [one for one in self._subscriptions if one[3].get_publisher_count()]
            if self._slow >= SLOW_TIMES and now - self._suspected > SUSPICIONS_EVERY:
                self._suspected = now
                names = ", ".join(dismiss(self._node, [outlet.name for outlet in self._interface.outlets]))
                if names:
                    self.notices.append(f"killed or stopped, and forgotten until they come back: {names}")

    def _read(self, number: int, kind: Any, data: bytes) -> Received:
        name = self._interface.inlets[number].message
        try:
            if name == "std_msgs/Float64" and data[1] == 1:
                return Received(number, _FLOAT64.unpack(data))
            message = self._deserialize(data, kind)
        except Exception as error:  # of rclpy's own kinds
            return Received(number, (), fault=f"a message that cannot be read ({type(error).__name__})")
        if name == "sensor_msgs/JointState":
            return Received(number, list(message.position or message.effort), list(message.name))
        return Received(number, [message.data] if name == "std_msgs/Float64" else list(message.data))

    def _listened_to(self) -> list[bool]:
        """Which topics have subscribers: what nobody hears need not be said."""
        return [publisher is not None and publisher.get_subscription_count() > 0 for publisher in self._publishers]

    def _count(self, number: int, about: Any) -> None:
        """Publishers number their messages: where numbers are left out, some were lost."""
        gid = about.get("publisher_gid")
        key = (number, bytes(gid["data"]) if gid else b"")
        place = about.get("publication_sequence_number") or 0
        before = self._numbers.get(key)
        if before is not None and place > before + 1:
            self.lost += place - before - 1
        if before is not None or len(self._numbers) < MOST_PUBLISHERS:
            self._numbers[key] = place

    def _answer(self) -> None:
        for service in self._node.services:
            with service.handle:
                taken = service.handle.service_take_request(service.srv_type.Request)
            if taken is None or taken[1] is None:
                continue
            request, header = taken
            service.send_response(service.callback(request, service.srv_type.Response()), header)

    def close(self) -> None:
        """See :class:`asrsim.live.transport.Transport`."""
        self._node.destroy_node()
        self._context.try_shutdown()


def message_type(name: str) -> Any:
    """The class of a message such as `std_msgs/Float64`; None where its package is not installed."""
    package, _, kind = name.partition("/")
    try:
        return getattr(import_module(f"{package}.msg"), kind, None)
    except ImportError:
        return None


def load_rclpy() -> Any:
    """rclpy, ours or that of a ROS environment that fits this Python. Raises InputError where two get into each other's way."""
    folders = folders_with("librcl.so")
    # The wheels set the variable themselves, to folders of this environment.
    foreign = [folder for folder in folders if not folder.resolve().is_relative_to(Path(sys.prefix).resolve())]
    from importlib.util import find_spec

    spec = find_spec("rclpy")
    ours = spec is not None and "site-packages" in (spec.origin or "")
    if ours and foreign:
        message = f"a ROS environment is sourced: its libraries in {foreign[0]} stand before those of this Python's own rclpy"
        raise InputError(message, hint=_cure(), code="ros-sourced")
    wanted = os.environ.get("RMW_IMPLEMENTATION", "")
    # ROS would end the process over it.
    if wanted and folders and not folders_with(f"lib{wanted}.so"):
        message = f"RMW_IMPLEMENTATION asks for '{wanted}', which is not installed here"
        hint = "Start with: env -u RMW_IMPLEMENTATION asrsim live ..."
        raise InputError(message, hint=hint, code="ros-rmw")
    try:
        return import_module("rclpy")
    except Exception as error:  # a library of another build may fail on import in any way
        where = f" of {spec.origin}" if spec is not None and spec.origin else ""
        message = f"rclpy{where} cannot be loaded: {str(error).strip().splitlines()[0] if str(error) else type(error).__name__}"
        raise InputError(message, hint=_cure(), code="ros-sourced") from error


def _cure() -> str:
    if os.environ.get("AMENT_PREFIX_PATH") or os.environ.get("ROS_DISTRO"):
        return (
            "A ROS environment is sourced in this shell; use a new one, or start with: env -u PYTHONPATH -u LD_LIBRARY_PATH "
            "-u AMENT_PREFIX_PATH -u RMW_IMPLEMENTATION asrsim live ..."
        )
    return install("ros")
