"""Runs that go side by side, so that comparing them takes no memory that grows with their duration."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack
from typing import Any

import numpy as np

from asrsim.errors import DivergenceError
from asrsim.robot.model import Robot
from asrsim.samples import Array, Samples
from asrsim.scenario.data import Scenario
from asrsim.simulation.prepare import prepare
from asrsim.simulation.simulation import Simulation

COMPARED = ("link_position", "link_torque")


class Track:
    """One of the runs, a chunk at a time; a sink that keeps what is not compared yet."""

    def __init__(self, stack: ExitStack, run: Scenario | Iterable[Samples], robot: Robot | None = None) -> None:
        """run: a scenario, to be simulated, or the samples of a run that is there already, in their order."""
        self.running = True
        self._waiting: list[Array] = []
        """(samples, quantities, joints) each."""
        self._given: Iterator[Samples] = iter(()) if isinstance(run, Scenario) else iter(run)
        self._end = 0.0
        self._simulation: Simulation | None = None
        if isinstance(run, Scenario):
            self._simulation = stack.enter_context(Simulation(prepare(run, robot), sinks=[self]))

    @property
    def time(self) -> float:
        """s that are simulated, or read."""
        return self._end if self._simulation is None else self._simulation.time

    @property
    def version(self) -> str:
        """Of the engine's library, of a run that is simulated."""
        return "" if self._simulation is None else self._simulation.prepared.info.metadata["engine_version"]

    @property
    def count(self) -> int:
        """Rows that wait."""
        return sum(map(len, self._waiting))

    def advance(self) -> None:
        """Another chunk."""
        if self._simulation is not None:
            self._simulation.advance_to(self._simulation.next_chunk(self._simulation.total))
            self._simulation.flush()
            self.running = self._simulation.substep < self._simulation.total
            return
        samples = next(self._given, None)
        self.running = samples is not None
        if samples is not None:
            self.write(samples)
            self._end = float(samples.time[-1])

    def write(self, samples: Samples) -> None:
        """Take samples."""
        self._waiting.append(np.stack([samples.values[name] for name in COMPARED], axis=1))

    def take(self, count: int) -> Array:
        """The next rows, which wait no longer."""
        rows = self._waiting[0] if len(self._waiting) == 1 else np.concatenate(self._waiting)
        self._waiting = [rows[count:]]
        return rows[:count]


def rows_of_all(tracks: Sequence[Track]) -> Iterator[list[Array]]:
    """The rows (samples, quantities, joints) of the runs at the same times, a chunk at a time.

    Where a run diverges, what all have until then comes before its DivergenceError is raised.
    """
    error: DivergenceError | None = None
    end = math.inf
    while running := [track for track in tracks if track.running and track.time < end]:
        behind = min(running, key=lambda track: track.time)
        try:
            behind.advance()
        except DivergenceError as caught:
            error, end, behind.running = caught, behind.time, False
        count = min(track.count for track in tracks)
        if count:
            yield [track.take(count) for track in tracks]
    if error is not None:
        raise error


class Differences:
    """What two runs differ by, summed up as they go; NaN where nothing was compared."""

    def __init__(self, joints: int) -> None:
        self._largest: Any = np.full((len(COMPARED), joints), np.nan)
        self._squares, self._seen = np.zeros((2, len(COMPARED), joints))

    def add(self, first: Array, second: Array) -> None:
        """Rows (samples, quantities, joints) of both."""
        difference = np.abs(first - second)
        self._largest = np.fmax(self._largest, np.fmax.reduce(difference, axis=0))
        self._squares += np.nansum(difference**2, axis=0)
        self._seen += np.sum(np.isfinite(difference), axis=0)

    def of(self, quantity: str, joint: int) -> tuple[float, float]:
        """The largest, and the root of their mean square."""
        entry = COMPARED.index(quantity), joint
        seen = self._seen[entry]
        return float(self._largest[entry]), math.sqrt(self._squares[entry] / seen) if seen else math.nan
