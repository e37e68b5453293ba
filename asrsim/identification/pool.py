"""Derivatives by several processes: each has the task set up for itself, and evaluates what it is given; results are the same
bits as here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from asrsim.errors import AsrsimError
from asrsim.identification.task import Task
from asrsim.samples import Array
from asrsim.workers import Executor, in_order

if TYPE_CHECKING:
    from asrsim.identification.residuals import Residuals

LONG = 12.0
"""s of evaluations after which a fit is so long that it pays to make processes ready."""


@dataclass
class _Elsewhere:
    """What a worker does: weighted residuals of one recording at one place. Items: (:meth:`Residuals.state`, x, recording)."""

    task: Task
    _residuals: Residuals | None = field(default=None, init=False)
    _stack: ExitStack | None = field(default=None, init=False)

    def __call__(self, item: tuple[Mapping[str, object], Array, int]) -> Array:
        from asrsim.identification.residuals import Counter, Residuals
        from asrsim.identification.setup import set_up

        state, x, track = item
        if self._residuals is None:
            self._stack = ExitStack()
            setup = set_up(self.task, self._stack)
            self._residuals = Residuals(setup.fitted, setup.layout, [], setup.ends, Counter())
        self._residuals.take(state)
        return self._residuals.of_track(x, track)

    def close(self) -> None:
        """Release the engines."""
        if self._stack is not None:
            self._stack.close()


class Pool:
    """Processes that evaluate residuals."""

    def __init__(self, task: Task, workers: Executor | None) -> None:
        """workers: None evaluates here."""
        self._workers, self._task = workers, _Elsewhere(task)

    def pays(self, seconds: float) -> bool:
        """Whether evaluations that took so long are worth processes."""
        return self._workers is not None and seconds > LONG

    def of_tracks(self, residuals: Residuals, places: Sequence[tuple[Array, int]]) -> list[Array] | None:
        """Weighted residuals at each place (vector, recording); None where no process can, as one without an actuator that was
        only registered here.
        """
        assert self._workers is not None  # pays() has looked
        state = residuals.state()
        try:
            return in_order(self._workers, self._task, [(state, x, track) for x, track in places])
        except AsrsimError:
            self._workers = None
            return None
