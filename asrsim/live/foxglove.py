"""WebSocket server for Foxglove, Lichtblick and similar clients: channels in CDR, services, messages from clients."""

from __future__ import annotations

import json
import secrets
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError, Future
from concurrent.futures import TimeoutError as Late
from contextlib import suppress
from functools import cache
from types import SimpleNamespace
from typing import Any

from asrsim import __version__
from asrsim.errors import InputError
from asrsim.live.origin import OriginProxy
from asrsim.live.transport import Access, Interface, Received, received
from asrsim.log.topics import schema_name, schema_text

WAITING = 5000
"""Largest number of received messages that wait for the simulation; when more messages wait, the oldest messages are dropped.
"""
MOST = 1000
"""Largest number of messages processed in one call, and largest number of channels that clients may advertise."""
PATIENCE = 5.0
"""Time that a client waits for an answer, s."""


class FoxgloveTransport:
    """WebSocket server. The server's threads only fill queues, which the simulation's thread empties."""

    def __init__(self, interface: Interface, access: Access) -> None:
        import foxglove
        from foxglove import Channel, Context, Schema
        from foxglove.websocket import Capability

        self._interface = interface
        # Keep a reference to the context: the channels exist only as long as their context.
        self._context = context = Context()
        self._messages: deque[tuple[str, str, bytes]] = deque()
        self._requests: deque[tuple[Callable[[], Any], Future[Any]]] = deque()
        self._advertised: dict[tuple[int, int], tuple[str, str]] = {}
        self._closed = False
        self.lost = 0
        self.notices: list[str] = []

        def channel(name: str, message: str) -> Any:
            schema = Schema(name=schema_name(message), encoding="ros2msg", data=schema_text(message).encode())
            return Channel(name, schema=schema, message_encoding="cdr", context=context)

        self._channels = [channel(outlet.name, outlet.message) for outlet in interface.outlets if not outlet.latched]
        self.wanted = [True] * len(self._channels)
        self._latched = {outlet.name: channel(outlet.name, outlet.message) for outlet in interface.outlets if outlet.latched}
        self._inlets = {inlet.name: (number, inlet.message) for number, inlet in enumerate(interface.inlets)}
        host = "0.0.0.0" if access.network else "127.0.0.1"
        try:
            self._proxy = OriginProxy((host, access.port), access.origins, self.notices)
        except OSError as error:
            message = f"a WebSocket on {host}:{access.port} cannot be opened: {error.strerror or error}"
            raise InputError(message, hint="Choose another --port, or 0 for any", code="websocket") from error
        options: dict[str, Any] = {
            "name": f"asrsim {__version__}", "port": 0, "context": context, "server_listener": self,
            "capabilities": [Capability.ClientPublish, Capability.Services, Capability.Time],
            "supported_encodings": ["cdr", "json"], "services": [self._service(name) for name in interface.services],
        }  # fmt: skip
        # The server listens at a random local address, so that web pages cannot find it directly.
        behind = ".".join(["127", *(str(1 + secrets.randbelow(254)) for _ in range(3))])
        try:
            self._server = foxglove.start_server(host=behind, **options)
        except Exception:  # foxglove raises errors of many types; some systems have no local address but 127.0.0.1
            behind = "127.0.0.1"
            self._server = foxglove.start_server(host=behind, **options)
        self._proxy.start(behind, self._server.port)
        self.port = self._proxy.port
        self.where = f"ws://{host}:{self.port}"

    def _service(self, name: str) -> Any:
        from foxglove import Schema
        from foxglove.websocket import MessageSchema, Service, ServiceSchema

        service = self._interface.services[name]

        def handler(request: Any) -> bytes:
            message, fault = None, 'expected {"data": true} or {"data": false}'
            with suppress(ValueError, AttributeError):
                flag = json.loads(bytes(request.payload) or b"{}").get("data", False)
                if isinstance(flag, bool):
                    message, fault = self._ask(lambda: service.call(flag)), "the run does not answer"
            return json.dumps({"success": message is not None, "message": message or fault}).encode()

        schema = Schema(name=name, encoding="jsonschema", data=b'{"type": "object"}')
        data = MessageSchema(encoding="json", schema=schema)
        kind = ServiceSchema(name=name, request=data, response=data)
        return Service(f"{self._interface.node}/{name}", schema=kind, handler=handler)

    # -- called by the server's threads -----------------------------------------------------------------------------

    def _ask(self, request: Callable[[], Any]) -> Any:
        """Answer of the simulation's thread to a request; None if the answer does not arrive in time."""
        answer: Future[Any] = Future()
        self._requests.append((request, answer))
        if not self._closed:
            with suppress(Late, CancelledError):
                return answer.result(timeout=PATIENCE)
        answer.cancel()
        return None

    def on_subscribe(self, client: Any, channel: Any) -> None:
        """Send the message of a latched topic again."""
        topic = channel.topic
        if topic in self._latched:
            self._requests.append((lambda: self._latched[topic].log(self._interface.latched[topic]), Future()))

    def on_client_advertise(self, client: Any, channel: Any) -> None:
        """Register a client's channel."""
        if len(self._advertised) < MOST:
            self._advertised[client.id, channel.id] = channel.topic, channel.encoding

    def on_client_unadvertise(self, client: Any, client_channel_id: int) -> None:
        """Remove a client's channel."""
        self._advertised.pop((client.id, client_channel_id), None)

    def on_message_data(self, client: Any, client_channel_id: int, data: bytes) -> None:
        """Queue a client's message."""
        known = self._advertised.get((client.id, client_channel_id))
        if known is not None:
            if len(self._messages) >= WAITING:
                self._messages.popleft()
                self.lost += 1
            self._messages.append((*known, bytes(data)))

    def on_unsubscribe(self, *_: Any) -> None:
        """Do nothing when a client unsubscribes."""

    # -- called by the simulation's thread --------------------------------------------------------------------------

    def publish(self, time: int, messages: Sequence[bytes]) -> None:
        """Implements `Transport.publish`."""
        for channel, message in zip(self._channels, messages, strict=True):
            if message:
                channel.log(message, log_time=time)

    def poll(self) -> Iterator[Received]:
        """Implements `Transport.poll`."""
        for _ in range(min(MOST, len(self._requests))):
            request, answer = self._requests.popleft()
            if answer.set_running_or_notify_cancel():
                answer.set_result(request())
        for _ in range(min(MOST, len(self._messages))):
            topic, encoding, data = self._messages.popleft()
            if topic in self._inlets:
                number, message = self._inlets[topic]
                yield received(number, decoded, message, encoding, data)

    def close(self) -> None:
        """Implements `Transport.close`."""
        # Cancel waiting requests first: the server answers all of them before it stops.
        self._closed = True
        while self._requests:
            self._requests.popleft()[1].cancel()
        self._proxy.close()
        self._server.stop()


@cache
def _types() -> Any:
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_HUMBLE)


def decoded(message: str, encoding: str, data: bytes) -> Any:
    """Message object decoded from the bytes of a client's message in CDR or JSON. Raises the errors of the decoders."""
    if encoding == "json":
        missing = {"position": (), "effort": (), "velocities": ()}
        return json.loads(data, object_hook=lambda fields: SimpleNamespace(**{**missing, **fields}))
    if encoding != "cdr":
        raise ValueError(f"the encoding '{encoding[:20]}' is neither cdr nor json")
    return _types().deserialize_cdr(data, schema_name(message))
