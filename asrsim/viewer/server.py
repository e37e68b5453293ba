"""Server of the page: viser's server behind a proxy that refuses requests of web pages from other origins."""

from __future__ import annotations

import io
import os
import secrets
import socket
import sys
import webbrowser
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout
from typing import TYPE_CHECKING, Any

from asrsim.errors import InputError
from asrsim.extras import library
from asrsim.live.origin import OriginProxy

if TYPE_CHECKING:
    import viser


class PageServer:
    """Server of a page at an address of this machine. It is a context manager, which ends the server even if browsers are still
    connected."""

    def __init__(self, port: int, *, tell: Callable[[str], None] = lambda text: None) -> None:
        """port: port of the page; 0: any free port. tell: receives a message for each origin that was refused. Raises
        InputError if viser is missing or the port is taken.
        """
        server: Any = library("viser", "view").ViserServer
        if not 0 <= port <= 65535:
            raise InputError("must be from 0 to 65535", key="port", value=port, code="port")

        class Local(server):  # type: ignore[misc]
            """viser's server, which does not share its page at a public address, so that the page stays on this machine."""

            def request_share_url(self, verbose: bool = True) -> None:
                return None

        try:
            self._proxy = OriginProxy(("127.0.0.1", port), (), tell)
        except OSError as error:
            message = f"a page at 127.0.0.1:{port} cannot be opened: {error.strerror or error}"
            raise InputError(message, hint="Choose another --port, or 0 for any", code="port") from error
        # Let viser's server listen at a random local address, so that foreign web pages cannot find it and bypass the proxy.
        behind = "127.0.0.1"
        if sys.platform == "linux":
            behind = ".".join(["127", *(str(1 + secrets.randbelow(254)) for _ in range(3))])
        # Hide the address that viser prints. It belongs to viser's server, but the page has the address of the proxy.
        with redirect_stdout(io.StringIO()):
            self.viser: viser.ViserServer = Local(host=behind, port=0, label="asrsim", verbose=False)
        self._proxy.start(behind, self.viser.get_port())
        self.port, self._closed = self._proxy.port, False

    @property
    def address(self) -> str:
        """Address of the page."""
        return f"http://localhost:{self.port}"

    def __enter__(self) -> PageServer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the server of the page; further calls do nothing."""
        if self._closed:
            return
        self._closed = True
        self._proxy.close()
        # Hide the line that viser prints when it ends.
        with redirect_stdout(io.StringIO()):
            self.viser.stop()


def has_display() -> bool:
    """Whether a browser of this machine can show a page to the user."""
    remote = "SSH_CONNECTION" in os.environ
    return not remote and (sys.platform in ("darwin", "win32") or bool({"DISPLAY", "WAYLAND_DISPLAY"} & {*os.environ}))


def announcement(server: PageServer) -> Sequence[str]:
    """Lines that tell the user the address of the page and, on a machine without a display, how to forward its port."""
    lines = [f"view: {server.address} (Ctrl-C ends it)"]
    if not has_display():
        forward = f"ssh -N -L {server.port}:localhost:{server.port} {_user()}{socket.gethostname()}"
        lines.append(f"from another machine: {forward}, then open the same address there")
    return lines


def open_browser(server: PageServer) -> None:
    """Open the page in the user's browser, if the machine has a display."""
    if has_display():
        webbrowser.open(server.address)


def _user() -> str:
    name: Any = os.environ.get("USER") or os.environ.get("USERNAME")
    return f"{name}@" if name else ""
