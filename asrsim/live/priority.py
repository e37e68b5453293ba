"""What keeps ticks from being held up: real-time priority, where the system grants it, and no search for garbage.

Controllers of robots take that priority too. The ordinary scheduler leaves two busy threads, such as a run and its listener, on
one processor for up to 90 ms while the other one has little to do, and lets others compute where a tick is due.
"""

from __future__ import annotations

import gc
import os
from collections.abc import Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import Self

_LEAST = 1
"""Of the real-time priorities: above all ordinary threads, below whatever else its user has put there."""


class RealTime:
    """In force for the thread that enters it, until it is left or given up, and for those that it starts meanwhile: threads of
    a transport hold locks for which this one waits."""

    def __init__(self, *, wanted: bool = True) -> None:
        self._wanted, self._taken = wanted, False

    def __enter__(self) -> Self:
        # Not every system has it; and who was given another policy, or was told to be nice, keeps to that.
        if (
            self._wanted
            and hasattr(os, "sched_setscheduler")
            and os.sched_getscheduler(0) == os.SCHED_OTHER
            and os.nice(0) <= 0
        ):
            try:
                os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(_LEAST))
                self._taken = True
            except OSError:  # not permitted, or not there in a container
                pass
        return self

    def give_up(self) -> bool:
        """Others come first again; whether it was in force."""
        if taken := self._taken:
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
            self._taken = False
        return taken

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.give_up()


@contextmanager
def quiet_collector() -> Iterator[None]:
    """What is there already is not searched for garbage while time counts."""
    gc.collect()
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()
