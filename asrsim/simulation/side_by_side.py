"""Runs that go side by side, so that comparing them takes no memory that grows with their duration."""

from __future__ import annotations

import math
from collections.abc import Iterable
from contextlib import ExitStack

import numpy as np

from asrsim.robot.model import Robot
from asrsim.samples import Array, Samples
from asrsim.scenario.data import Scenario
from asrsim.simulation.prepare import prepare
from asrsim.simulation.simulation import Simulation

COMPARED = ("link_position", "link_torque")


class Track:
    """One of the runs, a chunk at a time; a sink that keeps what is not compared yet."""

    def __init__(self, stack: ExitStack, scenario: Scenario | None, robot: Robot | None) -> None:
        """scenario: None for a run that is there already."""
        self.waiting: list[Array] = []
        """(samples, quantities, joints) each."""
        self._simulation: Simulation | None = None
        if scenario is not None:
            self._simulation = stack.enter_context(Simulation(prepare(scenario, robot), sinks=[self]))

    @property
    def time(self) -> float:
        """s that are simulated."""
        return math.inf if self._simulation is None else self._simulation.time

    @property
    def running(self) -> bool:
        """Not at its end yet; one row beyond it completes the last velocity."""
        return self._simulation is not None and self._simulation.substep < self._simulation.total

    def advance(self) -> None:
        """Another chunk."""
        if self._simulation is not None:
            self._simulation.advance_to(self._simulation.next_chunk(self._simulation.total))
            self._simulation.flush()

    def write(self, samples: Samples) -> None:
        """Take samples."""
        self.waiting.append(np.stack([samples.values[name] for name in COMPARED], axis=1))

    def take(self, count: int) -> Array:
        """The next rows, which wait no longer."""
        rows = self.waiting[0] if len(self.waiting) == 1 else np.concatenate(self.waiting)
        self.waiting = [rows[count:]]
        return rows[:count]

    @property
    def count(self) -> int:
        """Rows that wait."""
        return sum(map(len, self.waiting))


def laggard(tracks: Iterable[Track]) -> Track:
    """Of those that are running the one that is furthest behind."""
    return min((track for track in tracks if track.running), key=lambda track: track.time)
