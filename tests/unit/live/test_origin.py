"""Connections through the proxy that refuses web pages of other origins."""

import socket
import threading
import time
from contextlib import ExitStack, closing

import pytest

from asrsim.live.origin import OriginProxy

HEAD = "GET / HTTP/1.1\r\nHost: here\r\n{}\r\n"


@pytest.fixture
def port():
    """Port of a server that sends back what it receives."""

    def answer(client):
        with client:
            while data := client.recv(4096):
                client.sendall(data)

    def serve():
        while True:
            try:
                client, _ = server.accept()
            except OSError:
                return
            threading.Thread(target=answer, args=(client,), daemon=True).start()

    with socket.create_server(("127.0.0.1", 0)) as server:
        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        yield server.getsockname()[1]
        server.shutdown(socket.SHUT_RDWR)
    thread.join(5.0)


@pytest.fixture
def connect(port):
    """Function that connects through a proxy with a header, and returns the connection and the first bytes that come back."""
    with ExitStack() as stack:
        said = []
        proxy = OriginProxy(("127.0.0.1", 0), ["https://lab.example"], said.append)
        proxy.start("127.0.0.1", port)
        stack.callback(proxy.close)

        def call(header=""):
            client = stack.enter_context(closing(socket.create_connection(("127.0.0.1", proxy.port), timeout=5.0)))
            client.sendall(HEAD.format(header).encode())
            return client, client.recv(4096).decode()

        call.said = said
        yield call


@pytest.mark.parametrize(
    ("header", "passes"),
    [
        ("", True),
        ("Origin: https://lab.example\r\n", True),
        ("Origin: http://localhost:8080\r\n", True),
        ("origin: https://LAB.example\r\n", True),
        ("Origin: https://other.example\r\n", False),
        ("Origin: https://lab.example\r\nOrigin: https://other.example\r\n", False),
    ],
)
def test_a_page_of_a_foreign_origin_is_refused_and_told_of_once(connect, header, passes):
    answers = [connect(header)[1] for _ in range(2)]
    assert [answer.startswith("GET / ") for answer in answers] == [passes] * 2
    assert [answer.startswith("HTTP/1.1 403") for answer in answers] == [not passes] * 2
    assert len(connect.said) == (not passes)
    assert all("--allow-origin https://other.example" in text for text in connect.said)


def test_a_connection_passes_bytes_both_ways_until_it_ends(connect):
    client, _ = connect()
    for data in (b"first", b"\x00" * 100_000):
        client.sendall(data)
        got = b""
        while len(got) < len(data):
            got += client.recv(65536)
        assert got == data


def test_as_many_clients_are_served_as_permitted_and_a_place_becomes_free(connect, monkeypatch):
    monkeypatch.setattr("asrsim.live.origin.MOST_CLIENTS", 2)
    (first, one), (_, two), (_, three) = (connect() for _ in range(3))
    assert [answer.startswith("GET / ") for answer in (one, two, three)] == [True, True, False]
    first.close()
    end = time.monotonic() + 5.0
    while not connect()[1].startswith("GET / "):
        assert time.monotonic() < end
