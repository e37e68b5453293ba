"""Messages that wait for the simulation, limited in number and bytes."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Iterator
from threading import Lock

from asrsim.live.transport import Received

WAITING, WAITING_BYTES = 5000, 1 << 24
"""WAITING: largest number of received messages that wait for the simulation; WAITING_BYTES: largest sum of their sizes in
bytes. If there are more messages, the oldest are dropped and counted.
"""
LARGEST_MESSAGE = 1 << 20
"""Largest size of a received message in bytes. Decoded, a message takes up to a hundred times as much memory."""


class Mailbox:
    """Queue between the threads that receive messages and the simulation's thread."""

    def __init__(self) -> None:
        self._messages: deque[tuple[int, bytes, float]] = deque()
        self._size = 0
        """Sum of the sizes of the waiting messages, bytes."""
        self._lost: Counter[tuple[int, str]] = Counter()
        """Number of dropped messages, by the number of their input topic and the reason."""
        self._lock = Lock()

    def put(self, inlet: int, data: bytes, *, sent: float = 0.0) -> None:
        """Queue a message of an input topic; sent: as in `Received`. Every thread may call this method."""
        with self._lock:
            if len(data) > LARGEST_MESSAGE:
                self._lost[inlet, f"a message of more than {LARGEST_MESSAGE} bytes"] += 1
                return
            self._messages.append((inlet, data, sent))
            self._size += len(data)
            while len(self._messages) > WAITING or self._size > WAITING_BYTES:
                oldest, dropped, _ = self._messages.popleft()
                self._size -= len(dropped)
                self._lost[oldest, "more messages than the run can process"] += 1

    def take(self, decoded: Callable[[int, bytes, float], Received]) -> Iterator[Received]:
        """The waiting messages, preceded by one fault for each dropped message. Each message is decoded when it is taken."""
        with self._lock:
            lost, self._lost = self._lost, Counter()
            messages, self._messages, self._size = self._messages, deque(), 0
        for (inlet, why), count in lost.items():
            for _ in range(count):
                yield Received(inlet, fault=why)
        while messages:
            yield decoded(*messages.popleft())
