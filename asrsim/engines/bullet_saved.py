"""States of PyBullet's world, kept in memory by the client, and the client's end."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

from asrsim.engines.foreign import quiet


class SavedState:
    """A state that Bullet keeps in memory until nobody wants it, or its client is gone: numbers of clients come again."""

    def __init__(self, p: Any, client: int, number: int, alive: list[bool]) -> None:
        self._p, self._client, self.number, self._alive = p, client, number, alive

    def __del__(self) -> None:
        if self._alive[0]:
            with suppress(Exception):
                self._p.removeState(self.number, physicsClientId=self._client)


def disconnect(p: Any, client: int, alive: list[bool]) -> None:
    """End the client `client` of `p` (pybullet), and with it all that it keeps; `alive` tells the states."""
    alive[0] = False
    with suppress(p.error), quiet():
        p.disconnect(client)
