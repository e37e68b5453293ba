"""Measures what asrsim costs, as ratios: each against its own reference, in turns, in one run.

    python benchmarks/run.py                 the table
    python benchmarks/run.py --json          the same for programs
    python benchmarks/run.py --only loop     rows whose name begins so
    python benchmarks/run.py --figure        cost over joints and stiffness, docs/images/performance.png
    python benchmarks/run.py --docs          everything, into docs/performance.md

Times are CPU times of the process. Medians; a busy machine widens the spread more than it moves the middle.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))


@dataclass(frozen=True, kw_only=True)
class Row:
    """A measured ratio."""

    what: str
    goal: float
    """At most."""
    ratios: tuple[float, ...] = ()

    @property
    def median(self) -> float:
        """The ratio."""
        return statistics.median(self.ratios)

    @property
    def spread(self) -> tuple[float, float]:
        """Smallest and largest."""
        return min(self.ratios), max(self.ratios)


ROWS: Mapping[str, Row] = {
    "loop_plain_2dof": Row(what="whole loop, plain Python, 2 joints / bare stepSimulation", goal=4.5),
    "loop_fast_2dof": Row(what="whole loop, compiled, 2 joints / bare stepSimulation", goal=2.9),
    "loop_plain_5dof": Row(what="whole loop, plain Python, 5 joints / bare stepSimulation", goal=5.0),
    "loop_fast_5dof": Row(what="whole loop, compiled, 5 joints / bare stepSimulation", goal=2.5),
    "substeps_fast": Row(what="11 motor-and-spring substeps / 1, compiled, 5 joints", goal=1.6),
    "log_write": Row(what="writing the complete log, 5 joints, zstd / simulating in plain Python", goal=1.0),
    "log_read": Row(what="reading link and motor states in bulk / iter_messages", goal=0.1),
    "help": Row(what="asrsim --help / python -c pass", goal=6.0),
    "start": Row(what="asrsim run of 1 ms of 1 joint, no plots / import pybullet, numpy", goal=3.0),
    "processes": Row(what="CPU time of a step, two runs side by side / one", goal=1.05),
}


def measure(wanted: Callable[[str], bool], repeats: int, folder: Path) -> dict[str, Row]:
    """The rows that are wanted; what shares a reference is measured together."""
    from commands import help_ratios, process_ratios, start_ratios
    from log import log_ratios
    from loops import loop_ratios, substep_ratios

    groups: list[tuple[tuple[str, ...], Callable[[], tuple[list[float], ...]]]] = [
        (("loop_plain_2dof", "loop_fast_2dof"), lambda: loop_ratios(2, repeats, folder)),
        (("loop_plain_5dof", "loop_fast_5dof"), lambda: loop_ratios(5, repeats, folder)),
        (("substeps_fast",), lambda: (substep_ratios(repeats, folder),)),
        (("log_write", "log_read"), lambda: log_ratios(repeats, folder)),
        (("help",), lambda: (help_ratios(repeats, folder),)),
        (("start",), lambda: (start_ratios(repeats, folder),)),
        (("processes",), lambda: (process_ratios(repeats, folder),)),
    ]
    rows = {}
    for names, function in groups:
        if any(map(wanted, names)):
            for name, ratios in zip(names, function(), strict=True):
                rows[name] = Row(what=ROWS[name].what, goal=ROWS[name].goal, ratios=tuple(ratios))
    return {name: row for name, row in rows.items() if wanted(name)}


def table(rows: Mapping[str, Row]) -> str:
    """For people."""
    lines = [f"{'':16} {'ratio':>6} {'goal':>6}   {'from .. to':>13}"]
    for name, row in rows.items():
        low, high = row.spread
        mark = " " if row.median <= row.goal else "!"
        lines.append(f"{name:16} {row.median:6.2f} {row.goal:6.2f} {mark} {low:5.2f} .. {high:5.2f}   {row.what}")
    return "\n".join(lines)


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="one JSON document on stdout")
    parser.add_argument("--only", default="", metavar="NAME", help="rows whose name begins so")
    parser.add_argument("--repeats", type=int, default=7, metavar="N", help="rounds of each row (7)")
    parser.add_argument("--figure", action="store_true", help="draw docs/images/performance.png instead")
    parser.add_argument("--docs", action="store_true", help="write docs/performance.md, with memory and picture")
    arguments = parser.parse_args()
    if not any(name.startswith(arguments.only) for name in ROWS):
        parser.error(f"no row begins with '{arguments.only}'; there are {', '.join(ROWS)}")
    from machine import machine, others

    load = others()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if arguments.figure:
            from figure import draw

            print(draw(folder))
            return
        rows = measure(lambda row: row.startswith(arguments.only), max(1, arguments.repeats), folder)
        if arguments.docs:
            from document import write

            print(write(rows, folder, load))
            return
    if arguments.json:
        values = {name: {"ratio": row.median, "goal": row.goal, "spread": row.spread} for name, row in rows.items()}
        print(json.dumps({"machine": machine(), "rows": values}, indent=2))
        return
    print(", ".join(f"{key} {value}" for key, value in machine().items()))
    print(table(rows))


if __name__ == "__main__":
    main()
