"""CPU time of the simulation loop, by steps, beside that of Bullet's bare step."""

from __future__ import annotations

import time
from collections.abc import Sequence

from worlds import BareWorld

from asrsim.robot.model import Robot
from asrsim.samples import Samples
from asrsim.scenario import Scenario
from asrsim.simulation.run import simulate

SWING = 200
"""Steps of the bare world between resets."""


class Discard:
    """A sink that lets samples go: the recording itself is all done before it gets them."""

    def write(self, samples: Samples) -> None:
        """Nothing."""


def loop_seconds(scenario: Scenario, robot: Robot) -> float:
    """CPU time in s of a step of the whole loop: inputs, motors, springs, engine, complete record with energies.

    Building the world, and compiling or loading the kernel, end before the first block of steps does, which does not count.
    """
    marks: list[tuple[float, float]] = []
    simulate(scenario, robot, sinks=[Discard()], keep=False, progress=lambda t: marks.append((t, time.process_time())))
    (first, begin), (last, end) = marks[0], marks[-1]
    return (end - begin) / ((last - first) / scenario.step)


def bare_seconds(bare: BareWorld, steps: int = 6000) -> float:
    """CPU time in s of a bare `stepSimulation`."""
    advance = bare.engine.advance
    taken = 0.0
    for _ in range(0, steps, SWING):
        bare.reset()
        begin = time.process_time()
        for _ in range(SWING):
            advance()
        taken += time.process_time() - begin
    return taken / steps


def interleaved(bare: BareWorld, robot: Robot, scenarios: Sequence[Scenario], repeats: int) -> list[list[float]]:
    """Rounds of [bare, scenario, scenario, ...], CPU time in s of a step, after one round that warms up."""
    rounds = []
    for index in range(repeats + 1):
        row = [bare_seconds(bare), *(loop_seconds(scenario, robot) for scenario in scenarios)]
        if index:
            rounds.append(row)
    return rounds
