"""What starting costs: CPU time of whole processes, beside that of Python and of the libraries that nobody can do without."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from worlds import chain

SCENARIO = """robot: {robot}
duration: 0.001
references:
  joint_0: {{equilibrium_position: 0.1, stiffness_preset: 0.1}}
"""


def process_seconds(command: Sequence[str], **environment: str) -> float:
    """CPU time in s of a process and its children; raises CalledProcessError if it fails."""
    # As an installed program starts: with the bytecode of its modules kept from the start before.
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env={**kept, **environment})
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def _ratios(command: Sequence[str], reference: Sequence[str], repeats: int) -> list[float]:
    ratios = []
    for index in range(repeats + 1):
        ratio = process_seconds(command) / process_seconds(reference)
        # The first round fills the caches of files and of compiled modules.
        if index:
            ratios.append(ratio)
    return ratios


def help_ratios(repeats: int, folder: Path) -> list[float]:
    """`asrsim --help` over `python -c pass`."""
    return _ratios([*asrsim(), "--help"], [sys.executable, "-c", "pass"], repeats)


def start_ratios(repeats: int, folder: Path) -> list[float]:
    """`asrsim run` of 1 ms of 1 joint, no plots, over importing PyBullet and NumPy."""
    robot = chain(folder, 1)
    path = folder / "start.yaml"
    path.write_text(SCENARIO.format(robot=robot.path), encoding="utf-8")
    command = [*asrsim(), "run", str(path), "--no-plot", "--quiet", "--out", str(folder / "out")]
    return _ratios(command, [sys.executable, "-c", "import pybullet, numpy"], repeats)


def asrsim() -> list[str]:
    """The command, with this Python."""
    return [sys.executable, "-c", "from asrsim.cli.app import main; main()"]


LOOP = """
import sys, time
sys.path.insert(0, {here!r})
from pathlib import Path
from loops import loop_seconds
from worlds import chain, scenario
robot = chain(Path({folder!r}), 5)
run = scenario(robot, duration={duration})
loop_seconds(run, robot)
print(loop_seconds(run, robot))
"""


def process_ratios(repeats: int, folder: Path) -> list[float]:
    """CPU time of a step with two runs side by side over that of one run alone."""

    def loop(name: str) -> subprocess.Popen[str]:
        place = folder / name
        place.mkdir(exist_ok=True)
        source = LOOP.format(here=str(Path(__file__).parent), folder=str(place), duration=20.0)
        return subprocess.Popen([sys.executable, "-c", source], stdout=subprocess.PIPE, text=True)

    ratios = []
    for _ in range(repeats):
        alone = float(loop("a").communicate()[0])
        both = [loop("a"), loop("b")]
        together = [float(process.communicate()[0]) for process in both]
        ratios.append(sum(together) / len(together) / alone)
    return ratios
