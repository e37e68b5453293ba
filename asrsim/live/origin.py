"""Proxy for a WebSocket server that accepts only web pages of this machine or of origins that the user names.

A browser allows every web page to open a WebSocket to this machine, and names the page in the header `Origin`. The server of
foxglove-sdk ignores the header `Origin`, so this module reads the headers of each request and forwards permitted connections.
"""

from __future__ import annotations

import asyncio
import re
import socket
from collections.abc import Callable, Collection
from contextlib import suppress
from threading import Thread

from asrsim.errors import InputError

LONGEST_HEAD = 16384
"""Largest size of a request's headers, bytes."""
PATIENCE = 5.0
"""Time in which a client must send the headers, s."""
MOST_CLIENTS = 64
"""Largest number of simultaneous connections."""
MOST_NOTICES = 20
"""Largest number of refused origins that are reported."""
_OWN = re.compile(r"https?://(localhost|127\.0\.0\.1|\[::1\])(:\d+)?|(file|app|foxglove|lichtblick)://.*")
"""Pattern of permitted origins, which are servers of this machine and desktop applications (Electron applications send
`file://`)."""
_ORIGIN = re.compile(r"^origin[ \t]*:[ \t]*(.*?)[ \t\r]*$", re.IGNORECASE | re.MULTILINE)
_REFUSAL = b"HTTP/1.1 403 Forbidden\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"


def origin_of(text: str) -> str:
    """Origin in the form that browsers send. Raises InputError for a text that is not an origin."""
    origin = text.strip().rstrip("/").lower()
    if not re.fullmatch(r"[a-z][a-z0-9+.-]*://[^/\s]+", origin):
        hint = "An origin is a page's address without its path, such as https://app.foxglove.dev"
        raise InputError(f"'{text}' is not an origin", key="--allow-origin", hint=hint, code="bad-origin")
    return origin


class OriginProxy:
    """Proxy that listens at an address and forwards permitted connections to a server. `close` ends the proxy's thread."""

    def __init__(self, address: tuple[str, int], allowed: Collection[str], tell: Callable[[str], None]) -> None:
        """allowed: permitted origins besides the origins of this machine; tell: function that receives one sentence per refused
        origin, in the proxy's thread. Raises OSError if the address is in use.
        """
        self._allowed, self._tell, self._clients = allowed, tell, 0
        self._refused: set[str] = set()
        self._socket = socket.create_server(address)
        self.port: int = self._socket.getsockname()[1]
        self._loop, self._stopped = asyncio.new_event_loop(), asyncio.Event()
        self._thread = Thread(target=self._run, daemon=True)

    def start(self, host: str, port: int) -> None:
        """Start to forward connections to the server at this address."""
        self._server = host, port
        self._thread.start()

    def close(self) -> None:
        """End all connections."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._stopped.set)
            self._thread.join()

    def _run(self) -> None:
        # Use a runner, since it cancels the tasks of all connections when it closes.
        with asyncio.Runner(loop_factory=lambda: self._loop) as runner:
            runner.run(self._listen())

    async def _listen(self) -> None:
        server = await asyncio.start_server(self._serve, sock=self._socket, limit=LONGEST_HEAD)
        await self._stopped.wait()
        server.close()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._clients += 1
        try:
            head = await asyncio.wait_for(reader.readuntil(b"\r\n\r\n"), PATIENCE)
            origins = [value.lower() for value in _ORIGIN.findall(head.decode("latin-1"))]
            foreign = [origin for origin in origins if not (origin in self._allowed or _OWN.fullmatch(origin))]
            if foreign or self._clients > MOST_CLIENTS:
                self._refuse(foreign)
                writer.write(_REFUSAL)
                await writer.drain()
                return
            back, forth = await asyncio.open_connection(*self._server)
            forth.write(head)
            pumps = [asyncio.ensure_future(_pass_on(*pair)) for pair in ((reader, forth), (back, writer))]
            await asyncio.wait(pumps, return_when=asyncio.FIRST_COMPLETED)
            forth.close()
        except (OSError, EOFError, asyncio.LimitOverrunError, asyncio.CancelledError):
            pass
        finally:
            self._clients -= 1
            writer.close()

    def _refuse(self, foreign: Collection[str]) -> None:
        for origin in foreign:
            if origin not in self._refused and len(self._refused) < MOST_NOTICES:
                self._refused.add(origin)
                name = ascii(origin[:80]).strip("'")
                self._tell(f"a web page of {name} was refused; to allow its commands: --allow-origin {name}")


async def _pass_on(source: asyncio.StreamReader, target: asyncio.StreamWriter) -> None:
    with suppress(OSError):
        while data := await source.read(65536):
            target.write(data)
            await target.drain()
