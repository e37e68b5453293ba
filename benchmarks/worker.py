"""Measures one version of asrsim, in its own environment, when told: a request a line of JSON on stdin, an answer on stdout.

Runs under 0.1 as well as under the version beside it, so it takes robots and scenarios as files.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import time
from typing import Any


class Discard:
    """A sink that lets samples go: the recording itself is all done before it gets them."""

    def write(self, samples: Any) -> None:
        """Nothing."""


def whole(request: dict[str, Any]) -> float:
    """CPU s of a step of the whole run: inputs, motors, springs, engine, complete record with energies.

    Building the world, and compiling or loading the kernel, end before the first block of steps does, which does not count.
    """
    from asrsim.scenario import load_scenario
    from asrsim.simulation.run import simulate

    (scenario,) = load_scenario(request["scenario"])
    marks: list[tuple[float, float]] = []
    simulate(scenario, sinks=[Discard()], keep=False, progress=lambda t: marks.append((t, time.process_time())))
    (first, begin), (last, end) = marks[0], marks[-1]
    return (end - begin) / ((last - first) / scenario.step)


def loop(request: dict[str, Any]) -> float:
    """CPU s of a step of the loop alone: inputs, motors, springs, engine; nothing is kept of the record."""
    from asrsim.scenario import load_scenario
    from asrsim.simulation.simulation import Simulation

    (scenario,) = load_scenario(request["scenario"])
    with Simulation(scenario) as simulation:
        simulation.advance(500)
        steps = round(scenario.duration / scenario.step) - 500
        begin = time.process_time()
        simulation.advance(steps)
        return (time.process_time() - begin) / steps


def worlds(request: dict[str, Any]) -> float:
    """CPU s of a world and step of 64 worlds that are stepped together, as for learning, over that of 64 simulations, in
    turns."""
    from contextlib import ExitStack

    from asrsim import Simulation, Worlds
    from asrsim.scenario import load_scenario

    (scenario,) = load_scenario(request["scenario"])
    with ExitStack() as stack:
        together = stack.enter_context(Worlds(scenario, 64, names=["link_position"], watched=False))
        alone = [stack.enter_context(Simulation(scenario)) for _ in range(64)]

        def seconds(*those: Any) -> float:
            begin = time.process_time()
            for one in those:
                one.advance(20)
            return time.process_time() - begin

        seconds(together, *alone)
        taken = [(seconds(together), seconds(*alone)) for _ in range(9)]
    return sum(many for many, _ in taken) / sum(each for _, each in taken)


def bare(request: dict[str, Any]) -> float:
    """CPU s of a step of the engine alone: the same robot swings, without springs, reset now and then.

    Joints that have swung to their stops cost more, which would flatter us.
    """
    from worlds import BARE

    world = BARE[request["engine"]](request["scenario"])
    taken, steps = 0.0, 0
    while taken < request.get("seconds", 0.3):
        world.reset()
        begin = time.process_time()
        for _ in range(200):
            world.step()
        taken += time.process_time() - begin
        steps += 200
    world.close()
    return taken / steps


def command(request: dict[str, Any]) -> float:
    """CPU s of the command line with these arguments, with the Python that asks."""
    code = "from asrsim.cli.app import main; main()"
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    # -P: the folder that the benchmark was started in may be the other version's.
    subprocess.run([sys.executable, "-P", "-c", code, *request["arguments"]], check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    """Answer until the requests end."""
    measures = {"whole": whole, "loop": loop, "worlds": worlds, "bare": bare, "command": command}
    for line in sys.stdin:
        request = json.loads(line)
        sys.stdout.write(json.dumps(measures[request["what"]](request)) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
