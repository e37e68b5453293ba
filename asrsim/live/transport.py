"""The interface between a live run and its transports, which carry messages to the outside and back."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from importlib.util import find_spec
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
    """Published once; later subscribers get it too."""


@dataclass(frozen=True)
class Inlet:
    """A topic that a run subscribes to."""

    name: str
    message: str
    """`std_msgs/Float64`, `std_msgs/Float64MultiArray`, `sensor_msgs/JointState` or `trajectory_msgs/JointTrajectory`."""


@dataclass(frozen=True)
class Received:
    """A message from outside, not checked yet."""

    inlet: int
    """Number in :attr:`Interface.inlets`."""
    values: Sequence[float] = ()
    """Values of a Float64 or an array; of a JointState its positions, or its efforts where it has no positions."""
    names: Sequence[str] | None = None
    """Joints of the values, or of the points."""
    points: Sequence[tuple[float, Sequence[float], Sequence[float]]] = ()
    """Of a JointTrajectory: s from now on, positions, velocities (or none)."""
    fault: str = ""
    """Why the message cannot be read."""


def received(inlet: int, decode: Callable[..., Any], *data: Any) -> Received:
    """The content of a message object of any library, `decode(*data)`. An error becomes the fault of the message."""
    try:
        message = decode(*data)
        if hasattr(message, "points"):
            points = [
                (p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec, _numbers(p.positions), _numbers(p.velocities))
                for p in message.points
            ]
            return Received(inlet, names=list(map(str, message.joint_names)), points=points)
        if hasattr(message, "name"):
            values = message.position if len(message.position) else message.effort
            return Received(inlet, _numbers(values), list(map(str, message.name)))
        return Received(inlet, _numbers(message.data if hasattr(message.data, "__len__") else [message.data]))
    except Exception as error:  # foreign bytes make decoders fail in any way
        return Received(inlet, fault=f"a message that cannot be read ({type(error).__name__})")


def _numbers(values: Iterable[Any]) -> list[float]:
    # JSON writes NaN as null.
    return [math.nan if value is None else float(value) for value in values]


@dataclass(frozen=True)
class Service:
    """An action of a run that a client may ask for."""

    call: Callable[[bool], str]
    """call(flag) -> the new state in words; the flag counts where `takes_flag`."""
    takes_flag: bool = False


@dataclass(frozen=True)
class Interface:
    """All that a run offers to the outside."""

    node: str
    """Name of the node, with its namespace, under which services stand."""
    outlets: tuple[Outlet, ...]
    inlets: tuple[Inlet, ...]
    latched: Mapping[str, bytes]
    """Name of a latched topic -> its message (CDR)."""
    services: Mapping[str, Service] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Access:
    """Who may connect, and where."""

    network: bool = False
    """Other machines, too."""
    port: int = 8765
    """Port of a WebSocket; 0: any that is free."""
    origins: tuple[str, ...] = ()
    """Origins of web pages that may use a WebSocket, beside those of this machine."""
    domain: int | None = None
    """ROS domain; None: ROS_DOMAIN_ID, else 0."""


class Transport(Protocol):
    """Carries messages. All calls come from the simulation's thread, and none of them may wait."""

    where: str
    """Where clients find it, for people."""
    wanted: Sequence[bool]
    """Whether somebody subscribes to the outlets that are not latched, in their order; another sequence when that changes."""
    notices: list[str]
    """Sentences for the user; the reader takes them away."""
    lost: int
    """Commands that the transport dropped."""

    def publish(self, time: int, messages: Sequence[bytes]) -> None:
        """Messages (CDR) of the outlets that are not latched, in their order, empty where there is none; time in ns."""

    def poll(self) -> Iterable[Received]:
        """Messages since the last call, some hundred at most. Services are answered on the way."""

    def close(self) -> None:
        """End."""


@dataclass(frozen=True, kw_only=True)
class TransportEntry:
    """A registered transport."""

    make: Callable[[Interface, Access], Transport]
    """Raises InputError where it cannot be had, with what to do."""
    doc: str
    module: str
    """Module that must be importable."""
    extra: str = ""
    """asrsim's extra that brings it."""

    @property
    def available(self) -> bool:
        """Whether its module is installed."""
        return find_spec(self.module) is not None


TRANSPORTS: Registry[TransportEntry] = Registry("transport", entry_point_group="asrsim.transports", instance=TransportEntry)


def _lazily(module: str, name: str) -> Callable[[Interface, Access], Transport]:
    def make(interface: Interface, access: Access) -> Transport:
        made: Transport = getattr(import_module(module), name)(interface, access)
        return made

    return make


ROS, FOXGLOVE = _lazily("asrsim.live.ros", "RosTransport"), _lazily("asrsim.live.foxglove", "FoxgloveTransport")
TRANSPORTS.add("ros", TransportEntry(make=ROS, doc="ROS 2 topics, by rclpy", module="rclpy", extra="ros"))
TRANSPORTS.add(
    "foxglove",
    TransportEntry(make=FOXGLOVE, doc="a WebSocket for Foxglove and Lichtblick", module="foxglove", extra="foxglove"),
)


def available(names: Sequence[str]) -> tuple[str, ...]:
    """The transports of these names. Raises InputError where one is not installed, with how to get it."""
    for name in names:
        entry = TRANSPORTS.get(name)
        if not entry.available:
            message = f"the transport '{name}' needs '{entry.module}', which is not installed"
            raise InputError(message, hint=install(entry.extra) if entry.extra else None, code="no-library")
    return tuple(names)
