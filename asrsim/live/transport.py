"""Interface between a live run and the transports, which exchange messages with other programs."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any, Protocol

from asrsim.errors import InputError
from asrsim.extras import install
from asrsim.registry import Registry

LATEST = 2.0**32
"""Bound of time stamps in messages, s since 1970. ROS stores the seconds of a stamp in 32 bits."""


@dataclass(frozen=True)
class LiveTopic:
    """Topic that a run publishes or subscribes to."""

    name: str
    message: str
    """Message type, such as `sensor_msgs/JointState`."""
    latched: bytes = b""
    """Message (CDR) of a latched topic, which is published once and is also sent to later subscribers; empty for other
    topics."""


@dataclass(frozen=True)
class Received:
    """Message received from another program and not checked yet."""

    inlet: int
    """Index in `Interface.inlets`."""
    values: Sequence[float] = ()
    """Values of a Float64 or an array; for a JointState, the positions, or the efforts if the message has no positions."""
    names: Sequence[str] | None = None
    """Names of the joints to which the values or the points belong; None for a Float64 or an array."""
    points: Sequence[tuple[float, Sequence[float], Sequence[float]]] = ()
    """Points of a JointTrajectory, each with the time in s after the arrival of the message, the positions, and the velocities
    (may be empty)."""
    stamp: float = 0.0
    """Time stamp in the header of a JointState, s; 0 if there is no time stamp."""
    sent: float = 0.0
    """Time at which the sender published the message, s since 1970; 0 if the transport does not provide it."""
    fault: str = ""
    """Reason why the message cannot be decoded; empty if it was decoded."""


def received(inlet: int, message: Any, *, sent: float = 0.0) -> Received:
    """Content of a message object of any library. A message has a fault if it is None or if its content is not a command."""
    try:
        if hasattr(message, "points"):
            points = [
                (p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec, _numbers(p.positions), _numbers(p.velocities))
                for p in message.points
            ]
            return Received(inlet, names=list(map(str, message.joint_names)), points=points, sent=sent)
        if hasattr(message, "name"):
            values = message.position if len(message.position) else message.effort
            stamp = getattr(getattr(message, "header", None), "stamp", None)
            seconds = float(getattr(stamp, "sec", 0) + 1e-9 * getattr(stamp, "nanosec", 0))
            if not abs(seconds) < LATEST:
                raise ValueError("the time stamp is out of range")
            return Received(inlet, _numbers(values), list(map(str, message.name)), stamp=seconds, sent=sent)
        return Received(inlet, _numbers(message.data if hasattr(message.data, "__len__") else [message.data]), sent=sent)
    except (AttributeError, TypeError, ValueError, OverflowError, RecursionError) as error:
        return Received(inlet, fault=f"a message that cannot be read ({type(error).__name__})")


def _numbers(values: Iterable[Any]) -> list[float]:
    # JSON represents NaN by null.
    return [math.nan if value is None else float(value) for value in values]


@dataclass(frozen=True)
class Interface:
    """Topics of a run."""

    node: str
    """Name of the node, including its namespace."""
    outlets: tuple[LiveTopic, ...]
    inlets: tuple[LiveTopic, ...]
    """Topics that the run subscribes to, in order. A transport takes the waiting messages of the last topic first. So if a run
    has received a message of a topic, it has also received the earlier messages of all topics that precede this topic in the
    order.
    """


@dataclass(frozen=True, kw_only=True)
class Access:
    """Address of the transports, and the clients that may connect."""

    network: bool = False
    """Whether other machines may connect."""
    port: int = 8765
    """Port of the WebSocket; 0: any free port."""
    origins: tuple[str, ...] = ()
    """Origins of web pages that may use the WebSocket, besides the origins of this machine."""
    domain: int | None = None
    """Number of the ROS domain; None: the environment variable ROS_DOMAIN_ID, else 0."""


class Transport(Protocol):
    """Exchanges messages with clients. All calls come from the simulation's thread and must not block."""

    wanted: Sequence[bool]
    """Whether each outlet that is not latched has a subscriber; a change replaces the sequence by a new object."""

    def publish(self, time: int, messages: Sequence[bytes]) -> None:
        """Publish one message (CDR) for each outlet that is not latched, in order; an empty message is not published. time:
        time of the messages in ns.
        """

    def poll(self) -> Iterable[Received]:
        """Messages received since the previous call, at most a few thousand per topic."""

    def close(self) -> None:
        """Close the transport."""


TellUser = Callable[[str], None]
"""Function that shows a sentence to the user; a transport may call it from any thread."""
Make = Callable[[Interface, Access, TellUser], Transport]
"""Function that opens a transport and tells the user its address. Raises InputError with advice if it is unavailable."""


@dataclass(frozen=True, kw_only=True)
class TransportEntry:
    """Entry of the registry of transports."""

    make: Make
    doc: str
    module: str
    """Python module that the transport needs."""
    extra: str = ""
    """Optional dependency group (extra) of asrsim that installs the module."""

    @property
    def available(self) -> bool:
        """Whether the transport's module is installed."""
        return find_spec(self.module) is not None


TRANSPORTS: Registry[TransportEntry] = Registry("transport", "asrsim.transports", instance=TransportEntry)


def prefix_of(namespace: str) -> str:
    """Prefix of topic names for a namespace."""
    return f"/{namespace.strip('/')}".rstrip("/")


@contextmanager
def opened(names: Sequence[str], interface: Interface, access: Access, tell: TellUser) -> Iterator[list[Transport]]:
    """Context manager that opens the transports. Raises InputError, with the command that installs a missing library."""
    transports: list[Transport] = []
    with ExitStack() as stack:
        for name in names:
            entry = TRANSPORTS.get(name)
            if not entry.available:
                message = f"the transport '{name}' needs '{entry.module}', which is not installed"
                raise InputError(message, hint=install(entry.extra) if entry.extra else None, code="no-library")
            transports.append(entry.make(interface, access, tell))
            stack.callback(transports[-1].close)
        yield transports
