"""WebSocket server for Foxglove, Lichtblick and similar clients: channels in CDR, messages from clients in JSON."""

from __future__ import annotations

import json
import secrets
import sys
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import suppress
from types import SimpleNamespace
from typing import Any

from asrsim import __version__
from asrsim.errors import InputError
from asrsim.live.mailbox import Mailbox
from asrsim.live.origin import OriginProxy
from asrsim.live.transport import Access, Interface, LiveTopic, Received, TellUser, received
from asrsim.log.topics import message_definition, schema_name

MOST = 1000
"""Largest number of channels that clients may advertise, and of latched topics that wait to be sent again."""


class FoxgloveTransport:
    """WebSocket server. The server's threads only fill queues, which the simulation's thread empties."""

    def __init__(self, interface: Interface, access: Access, tell: TellUser) -> None:
        import foxglove
        from foxglove import Channel, Context, Schema
        from foxglove.websocket import Capability

        # Keep a reference to the context, since the channels exist only as long as their context.
        self._context = context = Context()
        self._mailbox = Mailbox()
        self._subscribed: deque[str] = deque(maxlen=MOST)
        """Latched topics with new subscribers."""
        self._advertised: dict[tuple[int, int], int] = {}

        def channel(topic: LiveTopic) -> Any:
            schema = Schema(
                name=schema_name(topic.message), encoding="ros2msg", data=message_definition(topic.message).encode()
            )
            return Channel(topic.name, schema=schema, message_encoding="cdr", context=context)

        self._channels = [channel(outlet) for outlet in interface.outlets if not outlet.latched]
        self._latched = {outlet.name: (channel(outlet), outlet.latched) for outlet in interface.outlets if outlet.latched}
        self.wanted: Sequence[bool] = [True] * len(self._channels)
        self._inlets = {inlet.name: number for number, inlet in enumerate(interface.inlets)}
        host = "0.0.0.0" if access.network else "127.0.0.1"
        try:
            self._proxy = OriginProxy((host, access.port), access.origins, tell)
        except OSError as error:
            message = f"a WebSocket on {host}:{access.port} cannot be opened: {error.strerror or error}"
            raise InputError(message, hint="Choose another --port, or 0 for any", code="websocket") from error
        # The server listens at a random local address, so that web pages cannot find it and bypass the proxy.
        behind = "127.0.0.1"
        if sys.platform == "linux":
            behind = ".".join(["127", *(str(1 + secrets.randbelow(254)) for _ in range(3))])
        listener: Any = self  # the library's type of a listener has optional methods that this class lacks
        self._server = foxglove.start_server(
            name=f"asrsim {__version__}",
            host=behind,
            port=0,
            context=context,
            server_listener=listener,
            capabilities=[Capability.ClientPublish, Capability.Time],
            supported_encodings=["json"],
        )
        self._proxy.start(behind, self._server.port)
        self.port = self._proxy.port
        tell(f"foxglove: ws://{host}:{self.port}")

    # -- called by the server's threads -----------------------------------------------------------------------------

    def on_subscribe(self, client: Any, channel: Any) -> None:
        """Queue the message of a latched topic for the new subscriber."""
        if channel.topic in self._latched:
            self._subscribed.append(channel.topic)

    def on_unsubscribe(self, *_: Any) -> None:
        """Do nothing when a client unsubscribes."""

    def on_client_advertise(self, client: Any, channel: Any) -> None:
        """Register a client's channel, if the run reads its topic."""
        if channel.topic in self._inlets and len(self._advertised) < MOST:
            self._advertised[client.id, channel.id] = self._inlets[channel.topic]

    def on_client_unadvertise(self, client: Any, client_channel_id: int) -> None:
        """Remove a client's channel."""
        self._advertised.pop((client.id, client_channel_id), None)

    def on_message_data(self, client: Any, client_channel_id: int, data: bytes) -> None:
        """Queue a client's message."""
        number = self._advertised.get((client.id, client_channel_id))
        if number is not None:
            self._mailbox.put(number, bytes(data))

    # -- called by the simulation's thread --------------------------------------------------------------------------

    def publish(self, time: int, messages: Sequence[bytes]) -> None:
        """Publish messages; see `Transport.publish`."""
        for channel, message in zip(self._channels, messages, strict=True):
            if message:
                channel.log(message, log_time=time)

    def poll(self) -> Iterator[Received]:
        """Received messages; see `Transport.poll`. The method also sends the latched topics to their new subscribers."""
        while self._subscribed:
            channel, message = self._latched[self._subscribed.popleft()]
            channel.log(message)
        return self._mailbox.take(decoded)

    def close(self) -> None:
        """Close the server; see `Transport.close`."""
        self._proxy.close()
        self._server.stop()


def decoded(inlet: int, data: bytes, sent: float = 0.0) -> Received:
    """Content of a message in JSON; invalid JSON gives a message with a fault."""
    message, missing = None, {"position": (), "effort": (), "velocities": ()}
    with suppress(ValueError, TypeError, RecursionError):
        message = json.loads(data, object_hook=lambda fields: SimpleNamespace(**{**missing, **fields}))
    return received(inlet, message, sent=sent)
