"""A check in front of a WebSocket server: web pages may only connect if they are this machine's own or were named.

A browser lets every web page open a WebSocket to this machine, and tells the server which page it is in the header `Origin`.
foxglove-sdk's server does not read that header and has no hook for it, so this module accepts the connections, reads the head
of each request, and passes the connection on to the server if the origin is allowed.
"""

from __future__ import annotations

import re
import socket
import time
from collections.abc import Collection
from contextlib import suppress
from threading import Thread

from asrsim.errors import InputError

LONGEST_HEAD = 16384
"""Bytes of a request's head."""
PATIENCE = 5.0
"""s in which a client must have sent the head."""
MOST_CLIENTS = 64
"""Connections at a time."""
MOST_NOTICES = 20
"""Refused origins that are named; more are refused in silence."""
_OWN = re.compile(r"https?://(localhost|127\.0\.0\.1|\[::1\])(:\d+)?|(file|app|foxglove|lichtblick)://.*")
"""Pages of this machine's own servers, and desktop applications (Electron's send `file://`)."""
_REFUSAL = b"HTTP/1.1 403 Forbidden\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"


def origin_of(text: str) -> str:
    """An origin as browsers write it. Raises InputError for what is none."""
    origin = text.strip().rstrip("/").lower()
    if not re.fullmatch(r"[a-z][a-z0-9+.-]*://[^/\s]+", origin):
        hint = "An origin is a page's address without its path, such as https://app.foxglove.dev"
        raise InputError(f"'{text}' is no origin", key="--allow-origin", hint=hint, code="bad-origin")
    return origin


def is_allowed(head: bytes, named: Collection[str]) -> bool:
    """Whether a request with this head may pass: all its origins are allowed, or it has none, as that of no browser."""
    return all(origin in named or _OWN.fullmatch(origin) for origin in _origins(head))


def _origins(head: bytes) -> list[str]:
    lines = [line.partition(":") for line in head.decode("latin-1").split("\r\n")]
    return [value.strip().lower() for name, _, value in lines if name.strip().lower() == "origin"]


class OriginCheck:
    """Listens at an address and passes connections on to a server; its threads end with :meth:`close`."""

    def __init__(self, address: tuple[str, int], named: Collection[str], notices: list[str]) -> None:
        """named: origins that are allowed beside this machine's own; notices: takes a sentence for each refused origin.

        Raises OSError where the address is taken.
        """
        self._named, self._notices = frozenset(named), notices
        self._refused: set[str] = set()
        self._open: set[socket.socket] = set()
        self._server: tuple[str, int] = ("", 0)
        self._closed = False
        self._listening = socket.create_server(address)
        self.port: int = self._listening.getsockname()[1]

    def start(self, server: tuple[str, int]) -> None:
        """Pass connections on to the server at this address from now on."""
        self._server = server
        Thread(target=self._accept, daemon=True).start()

    def close(self) -> None:
        """End all connections."""
        self._closed = True
        for each in (self._listening, *tuple(self._open)):
            _shut(each)
        self._listening.close()

    def _accept(self) -> None:
        while not self._closed:
            try:
                client, _ = self._listening.accept()
            except OSError:
                # Closed; or there are too many open files for now.
                time.sleep(0.1)
                continue
            if self._closed or len(self._open) >= 2 * MOST_CLIENTS:
                client.close()
            else:
                self._open.add(client)
                Thread(target=self._serve, args=(client,), daemon=True).start()

    def _serve(self, client: socket.socket) -> None:
        with suppress(OSError), client:
            try:
                head = _head(client)
                if not is_allowed(head, self._named):
                    self._refuse(head)
                    client.sendall(_REFUSAL)
                    return
                with socket.create_connection(self._server) as server:
                    self._open.add(server)
                    try:
                        client.settimeout(None)
                        for each in (client, server):
                            each.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                        server.sendall(head)
                        back = Thread(target=_pass_on, args=(server, client), daemon=True)
                        back.start()
                        _pass_on(client, server)
                        back.join()
                    finally:
                        self._open.discard(server)
            finally:
                self._open.discard(client)

    def _refuse(self, head: bytes) -> None:
        for origin in _origins(head):
            if origin not in self._refused and len(self._refused) < MOST_NOTICES:
                self._refused.add(origin)
                name = "".join(each if each.isprintable() else "?" for each in origin[:80])
                self._notices.append(f"a web page of {name} was refused; to allow its commands: --allow-origin {name}")


def _head(client: socket.socket) -> bytes:
    """A request up to its empty line, and what has come after it. Raises OSError if there is none in time."""
    head, until = b"", time.monotonic() + PATIENCE
    while b"\r\n\r\n" not in head:
        client.settimeout(max(until - time.monotonic(), 1e-3))
        part = client.recv(4096)
        head += part
        if not part or len(head) > LONGEST_HEAD:
            raise ConnectionError("no request")
    return head


def _pass_on(source: socket.socket, target: socket.socket) -> None:
    with suppress(OSError):
        while data := source.recv(65536):
            target.sendall(data)
    for each in (source, target):
        _shut(each)


def _shut(one: socket.socket) -> None:
    """Both sides, and threads that wait for it, see its end."""
    with suppress(OSError):
        one.shutdown(socket.SHUT_RDWR)
