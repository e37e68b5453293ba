"""A WebSocket for Foxglove, Lichtblick and their clients: the same channels in CDR, parameters, services, client publish."""

from __future__ import annotations

import json
import secrets
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError, Future
from concurrent.futures import TimeoutError as Late
from contextlib import suppress
from functools import cache
from typing import Any

from asrsim import __version__
from asrsim.errors import InputError
from asrsim.live.origin import OriginCheck
from asrsim.live.transport import Access, Interface, Received
from asrsim.log.topics import schema_name, schema_text

WAITING = 5000
"""Messages from outside that wait for the simulation; beyond, the oldest are lost."""
MOST = 1000
"""Messages taken at once."""
MOST_CHANNELS = 1000
"""Channels that one client may advertise."""
PATIENCE = 5.0
"""s that a client waits for an answer."""
_FLAG = {"type": "object", "properties": {"data": {"type": "boolean"}}}
_ANSWER = {"type": "object", "properties": {"success": {"type": "boolean"}, "message": {"type": "string"}}}


class FoxgloveTransport:
    """A server; its threads only lay things into queues, which the simulation's thread empties."""

    def __init__(self, interface: Interface, access: Access) -> None:
        import foxglove
        from foxglove import Channel, Context, Schema
        from foxglove.websocket import Capability

        self._interface = interface
        self._context = Context()
        self._messages: deque[tuple[str, str, bytes]] = deque()
        self._errands: deque[tuple[Callable[[], Any], Future[Any]]] = deque()
        self._closed = False
        self.lost = 0
        self.notices: list[str] = []

        def channel(name: str, message: str) -> Any:
            schema = Schema(name=schema_name(message), encoding="ros2msg", data=schema_text(message).encode())
            return Channel(name, schema=schema, message_encoding="cdr", context=self._context)

        self._channels = [channel(outlet.name, outlet.message) for outlet in interface.outlets if not outlet.latched]
        self.wanted = [True] * len(self._channels)
        self._latched = {outlet.name: channel(outlet.name, outlet.message) for outlet in interface.outlets if outlet.latched}
        self._inlets = {inlet.name: (number, inlet.message) for number, inlet in enumerate(interface.inlets)}
        listener: Any = _Listener(self)
        host = "0.0.0.0" if access.network else "127.0.0.1"
        try:
            self._check = OriginCheck((host, access.port), access.origins, self.notices)
        except OSError as error:
            message = f"a WebSocket on {host}:{access.port} cannot be opened: {error.strerror or error}"
            raise InputError(message, hint="Choose another --port, or 0 for any", code="websocket") from error
        options: dict[str, Any] = {
            "name": f"asrsim {__version__}", "port": 0, "context": self._context,
            "capabilities": [Capability.ClientPublish, Capability.Parameters, Capability.Services, Capability.Time],
            "supported_encodings": ["cdr", "json"], "services": [self._service(name) for name in interface.services],
            "server_listener": listener,
        }  # fmt: skip
        # The server itself stands where no web page finds it: at an address of this machine that is drawn at random.
        behind = ".".join(["127", *(str(1 + secrets.randbelow(254)) for _ in range(3))])
        try:
            self._server = foxglove.start_server(host=behind, **options)
        except Exception:  # of foxglove's own kinds; some systems have no address but this
            behind = "127.0.0.1"
            self._server = foxglove.start_server(host=behind, **options)
        self._check.start((behind, self._server.port))
        self.port: int = self._check.port
        self.where = f"ws://{host}:{self.port}"

    def _service(self, name: str) -> Any:
        from foxglove import Schema
        from foxglove.websocket import MessageSchema, Service, ServiceSchema

        def schema(what: str, shape: Any) -> Any:
            return MessageSchema(
                encoding="json", schema=Schema(name=what, encoding="jsonschema", data=json.dumps(shape).encode())
            )  # fmt: skip

        def handler(request: Any) -> bytes:
            try:
                data = json.loads(bytes(request.payload) or b"{}")
            except ValueError:
                data = None
            flag = data.get("data", False) if isinstance(data, dict) else None
            if not isinstance(flag, bool):
                return json.dumps({"success": False, "message": 'expected {"data": true} or {"data": false}'}).encode()
            done, message = self.ask(lambda: self._interface.services[name].call(flag), (False, "the run does not answer"))
            return json.dumps({"success": done, "message": message}).encode()

        takes = _FLAG if self._interface.services[name].takes_flag else {"type": "object"}
        kind = ServiceSchema(name=name, request=schema(f"{name}_request", takes), response=schema("answer", _ANSWER))
        return Service(f"{self._interface.node}/{name}", schema=kind, handler=handler)

    # -- called by the server's threads -----------------------------------------------------------------------------

    def ask(self, errand: Callable[[], Any], otherwise: Any) -> Any:
        """What `errand` gives in the simulation's thread; `otherwise` if nobody does it in time."""
        answer: Future[Any] = Future()
        self._errands.append((errand, answer))
        if not self._closed:
            with suppress(Late, CancelledError):
                return answer.result(timeout=PATIENCE)
        answer.cancel()
        return otherwise

    def take(self, topic: str, encoding: str, data: bytes) -> None:
        """A client's message."""
        if len(self._messages) >= WAITING:
            self._messages.popleft()
            self.lost += 1
        self._messages.append((topic, encoding, data))

    def again(self, topic: str) -> None:
        """Somebody new listens to a topic that is said once."""
        if topic in self._latched:
            self._errands.append((lambda: self._latched[topic].log(self._interface.latched[topic]), Future()))

    def parameters(self, names: Sequence[str]) -> list[Any]:
        """Those of these names, or all."""
        from foxglove.websocket import Parameter, ParameterType

        known = self._interface.parameters
        # JSON has no infinity; and a whole number must not be taken for an integer.
        values = {name: min(known[name].get(), 1e300) for name in known if not names or name in names}
        return [Parameter(name, value=value, type=ParameterType.Float64) for name, value in values.items()]

    def set_parameters(self, given: Sequence[Any]) -> None:
        """Set those that are known, to numbers that are good."""
        for parameter in given:
            value, known = parameter.get_value(), self._interface.parameters.get(parameter.name)
            if known is not None and isinstance(value, int | float) and not isinstance(value, bool):
                known.set(float(value))

    # -- called by the simulation's thread --------------------------------------------------------------------------

    def publish(self, time: int, messages: Sequence[bytes]) -> None:
        """See :class:`asrsim.live.transport.Transport`."""
        for channel, message in zip(self._channels, messages, strict=True):
            if message:
                channel.log(message, log_time=time)

    def poll(self) -> Iterator[Received]:
        """See :class:`asrsim.live.transport.Transport`."""
        for _ in range(min(MOST, len(self._errands))):
            errand, answer = self._errands.popleft()
            if answer.set_running_or_notify_cancel():
                answer.set_result(errand())
        for _ in range(min(MOST, len(self._messages))):
            topic, encoding, data = self._messages.popleft()
            if topic in self._inlets:
                number, message = self._inlets[topic]
                yield read(number, message, encoding, data)

    def close(self) -> None:
        """See :class:`asrsim.live.transport.Transport`."""
        # Requests that wait are given up first, since the server answers all of them before it stops.
        self._closed = True
        while self._errands:
            self._errands.popleft()[1].cancel()
        self._check.close()
        self._server.stop()


class _Listener:
    """What the server calls."""

    def __init__(self, transport: FoxgloveTransport) -> None:
        self._transport = transport
        self._advertised: dict[tuple[int, int], tuple[str, str]] = {}

    def on_subscribe(self, client: Any, channel: Any) -> None:
        self._transport.again(channel.topic)

    def on_unsubscribe(self, client: Any, channel: Any) -> None:
        pass

    def on_client_advertise(self, client: Any, channel: Any) -> None:
        if len(self._advertised) < MOST_CHANNELS:
            self._advertised[client.id, channel.id] = channel.topic, channel.encoding

    def on_client_unadvertise(self, client: Any, client_channel_id: int) -> None:
        self._advertised.pop((client.id, client_channel_id), None)

    def on_message_data(self, client: Any, client_channel_id: int, data: bytes) -> None:
        known = self._advertised.get((client.id, client_channel_id))
        if known is not None:
            self._transport.take(*known, bytes(data))

    def on_get_parameters(self, client: Any, param_names: list[str], request_id: str | None = None) -> list[Any]:
        return self._transport.parameters(param_names)

    def on_set_parameters(self, client: Any, parameters: list[Any], request_id: str | None = None) -> list[Any]:
        self._transport.ask(lambda: self._transport.set_parameters(parameters), None)
        return self._transport.parameters([parameter.name for parameter in parameters])

    def on_parameters_subscribe(self, param_names: list[str]) -> None:
        pass

    def on_parameters_unsubscribe(self, param_names: list[str]) -> None:
        pass


@cache
def _types() -> Any:
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_HUMBLE)


def read(number: int, message: str, encoding: str, data: bytes) -> Received:
    """A client's message of a type, in CDR or JSON; one that cannot be read says so."""
    try:
        if encoding == "json":
            found = json.loads(data)
            if message == "sensor_msgs/JointState":
                values = found.get("position") or found.get("effort") or []
                return Received(number, _numbers(values), [str(name) for name in found["name"]])
            given = found["data"]
            return Received(number, _numbers([given] if message == "std_msgs/Float64" else given))
        if encoding != "cdr":
            return Received(number, (), fault=f"the encoding '{encoding[:20]}' is neither cdr nor json")
        decoded = _types().deserialize_cdr(data, schema_name(message))
    except Exception as error:  # whatever a stranger's bytes do to a decoder
        return Received(number, (), fault=f"a message that cannot be read ({type(error).__name__})")
    if message == "sensor_msgs/JointState":
        values = decoded.position if len(decoded.position) else decoded.effort
        return Received(number, [float(value) for value in values], list(decoded.name))
    return Received(number, [float(decoded.data)] if message == "std_msgs/Float64" else [float(v) for v in decoded.data])


def _numbers(values: Any) -> list[float]:
    # JSON's null is how it writes what is no number.
    return [float("nan") if value is None else float(value) for value in values]
