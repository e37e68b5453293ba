"""Peak memory of a run whose log is written: it must not grow with the duration."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

RUN = """
import sys
sys.path.insert(0, {here!r})
from pathlib import Path
from worlds import chain, scenario
from asrsim.log import LogWriter
from asrsim.simulation.run import simulate
folder = Path({folder!r})
robot = chain(folder, 5)
path = folder / "run.mcap"
writers = []
def sinks(info):
    writers.append(LogWriter(path, info))
    return writers
simulate(scenario(robot, duration={duration}, compiled={compiled}), robot, sinks=sinks, keep=False)
writers[0].close()
# Not ru_maxrss, which begins with the parent's.
status = Path("/proc/self/status").read_text().split("VmHWM:")[1]
print(status.split()[0], path.stat().st_size)
path.unlink()
"""


def peak(folder: Path, duration: float, *, compiled: bool = False) -> tuple[float, float]:
    """Peak resident memory of a fresh process that runs 5 joints for `duration` s, and the size of its log, both in MB."""
    source = RUN.format(here=str(Path(__file__).parent), folder=str(folder), duration=duration, compiled=compiled)
    result = subprocess.run([sys.executable, "-c", source], check=True, capture_output=True, text=True)
    kibibytes, size = map(int, result.stdout.split())
    return kibibytes * 1024 / 1e6, size / 1e6
