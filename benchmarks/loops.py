"""CPU time of the simulation loop, by steps, beside that of Bullet's bare step."""

from __future__ import annotations

import time
from pathlib import Path

from worlds import BareWorld, chain, scenario

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


def loop_ratios(joints: int, repeats: int, folder: Path) -> tuple[list[float], list[float]]:
    """Plain and compiled loop over the bare step, of a chain of `joints`, one ratio a round."""
    robot = chain(folder, joints)
    bare = BareWorld(robot)
    runs = [scenario(robot, duration=20.0, compiled=compiled) for compiled in (False, True)]
    plain, fast = [], []
    for index in range(repeats + 1):
        one = bare_seconds(bare)
        seconds = [loop_seconds(run, robot) for run in runs]
        one = 0.5 * (one + bare_seconds(bare))
        # The first round warms up.
        if index:
            plain.append(seconds[0] / one)
            fast.append(seconds[1] / one)
    bare.engine.close()
    return plain, fast


def substep_ratios(repeats: int, folder: Path) -> list[float]:
    """11 motor-and-spring substeps (numbers of them are odd) over 1, 5 joints, compiled."""
    robot = chain(folder, 5)
    runs = [scenario(robot, duration=20.0, compiled=True, motor_substeps=substeps) for substeps in (1, 11)]
    ratios = []
    for index in range(repeats + 1):
        one, many = (loop_seconds(run, robot) for run in runs)
        if index:
            ratios.append(many / one)
    return ratios
