"""What a transport is: it carries messages of a live run to the outside, and what comes from there back. A file each."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

from asrsim.errors import InputError
from asrsim.extras import install
from asrsim.registry import Registry


@dataclass(frozen=True)
class Outlet:
    """A topic that a run publishes."""

    name: str
    message: str
    """Short type, such as `sensor_msgs/JointState`."""
    latched: bool = False
    """Said once, and to everybody who comes later."""


@dataclass(frozen=True)
class Inlet:
    """A topic that a run listens to."""

    name: str
    message: str
    """`std_msgs/Float64`, `std_msgs/Float64MultiArray` or `sensor_msgs/JointState`."""


@dataclass(frozen=True)
class Received:
    """A message from outside, not checked yet."""

    inlet: int
    """Number in :attr:`Interface.inlets`."""
    values: Sequence[float]
    """Of a Float64 one."""
    names: Sequence[str] | None = None
    """Of a JointState: names of the values, which are its positions, or its efforts where it has no positions."""
    fault: str = ""
    """Why it could not even be read."""


@dataclass(frozen=True)
class Service:
    """What a run does when it is asked to."""

    doc: str
    call: Callable[[bool], tuple[bool, str]]
    """call(flag) -> success and a message; the flag counts where `takes_flag`."""
    takes_flag: bool = False


@dataclass(frozen=True)
class Parameter:
    """A number of a run that may be read and set while it runs."""

    doc: str
    get: Callable[[], float]
    set: Callable[[float], str]
    """set(value) -> why not; empty: it is set."""


@dataclass(frozen=True)
class Interface:
    """All that a run offers to the outside."""

    node: str
    """Name under which services and parameters stand, with its namespace."""
    outlets: tuple[Outlet, ...]
    inlets: tuple[Inlet, ...]
    latched: Mapping[str, bytes]
    """Name of a latched topic -> its message (CDR)."""
    services: Mapping[str, Service] = field(default_factory=dict)
    parameters: Mapping[str, Parameter] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Access:
    """Who may listen and where; transports take what concerns them."""

    network: bool = False
    """Also other machines; else this one only."""
    port: int = 8765
    """Of a WebSocket; 0: any that is free."""
    origins: tuple[str, ...] = ()
    """Of web pages that may use a WebSocket, beside those of this machine."""
    domain: int | None = None
    """ROS domain; None: ROS_DOMAIN_ID, else 0."""


class Transport(Protocol):
    """Carries messages; all calls come from the simulation's thread, and none of them may wait."""

    where: str
    """For people: where it is to be found."""
    wanted: Sequence[bool]
    """Whether anybody listens to the outlets that are not latched, in their order; another sequence when that changes."""
    notices: list[str]
    """Sentences to be said; whoever says them takes them away."""
    lost: int
    """Commands that were lost on the way, as far as one can tell."""

    def publish(self, time: int, messages: Sequence[bytes]) -> None:
        """Messages (CDR) of the outlets that are not latched, in their order, empty where there is none; time in ns."""

    def poll(self) -> Iterable[Received]:
        """What has come since the last call, at most some hundred messages; answers services on the way."""

    def close(self) -> None:
        """Go."""


@dataclass(frozen=True, kw_only=True)
class TransportEntry:
    """A registered transport."""

    make: Callable[[Interface, Access], Transport]
    """Raises InputError where it cannot be had, saying what to do."""
    doc: str
    module: str
    """What must be importable for it."""
    extra: str = ""
    """asrsim's extra that brings it."""

    @property
    def available(self) -> bool:
        """Whether what it needs is installed."""
        from importlib.util import find_spec

        return find_spec(self.module) is not None


TRANSPORTS: Registry[TransportEntry] = Registry(
    "transport", entry_point_group="asrsim.transports", instance=TransportEntry
)  # fmt: skip


def _ros(interface: Interface, access: Access) -> Any:
    from asrsim.live.ros import RosTransport

    return RosTransport(interface, access)


def _foxglove(interface: Interface, access: Access) -> Any:
    from asrsim.live.foxglove import FoxgloveTransport

    return FoxgloveTransport(interface, access)


TRANSPORTS.add("ros", TransportEntry(make=_ros, doc="ROS 2 topics, by rclpy", module="rclpy", extra="ros"))
TRANSPORTS.add(
    "foxglove",
    TransportEntry(make=_foxglove, doc="a WebSocket for Foxglove and Lichtblick", module="foxglove", extra="foxglove"),
)


def available(names: Sequence[str]) -> tuple[str, ...]:
    """The transports of these names. Raises InputError where one is not installed, saying how to get it."""
    for name in names:
        entry = TRANSPORTS.get(name)
        if not entry.available:
            message = f"the transport '{name}' needs '{entry.module}', which is not installed"
            hint = install(entry.extra) if entry.extra else None
            raise InputError(message, hint=hint, code="no-library")
    return tuple(names)
