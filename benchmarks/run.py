"""Measures what asrsim costs: each row against its own reference, in turns, in one run.

    python benchmarks/run.py                 the table
    python benchmarks/run.py --json          the same for programs
    python benchmarks/run.py --only mujoco   rows whose name begins so
    python benchmarks/run.py --figure        cost over joints and stiffness, docs/images/performance.png
    python benchmarks/run.py --docs          everything, into docs/performance.md

Times are CPU times of processes; medians of rounds in which both sides take turns. 0.1 is measured beside this version, in an
environment of its own that is made once in the cache; its rows are left out where git's history or CPython 3.11 is not there.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))


@dataclass(frozen=True, kw_only=True)
class Row:
    """A measured figure, a ratio unless `what` names a unit."""

    what: str
    goal: float
    """At most."""
    ratios: tuple[float, ...] = ()

    @property
    def median(self) -> float:
        """The figure."""
        return statistics.median(self.ratios)

    @property
    def spread(self) -> tuple[float, float]:
        """Smallest and largest."""
        return min(self.ratios), max(self.ratios)


def _rows() -> dict[str, Row]:
    goals: dict[str, tuple[str, float]] = {}
    for name, faster in (("1", 4), ("2", 4), ("5", 4), ("v2", 12), ("v3", 14), ("v3_stops", 30)):
        goals[f"mujoco_{name}"] = (f"whole run, MuJoCo compiled / 0.1 compiled (PyBullet), {name}", round(1 / faster, 3))
    for name in ("2", "5"):
        goals[f"bare_{name}"] = (f"whole run, MuJoCo compiled / bare PyBullet step, {name} joints", 0.6)
    for name, goal in (("1", 0.6), ("2", 0.6), ("5", 0.85), ("v2", 0.85), ("v3", 0.85), ("v3_stops", 0.85)):
        goals[f"loop_{name}"] = (f"loop, MuJoCo compiled / bare mj_step, {name}", goal)
        goals[f"worlds_{name}"] = (f"64 worlds together / 64 simulations, by world and step, {name}", 0.5)
    goals |= {"bullet_v2": ("PyBullet compiled / 0.1, v2", 0.5), "bullet_v3": ("PyBullet compiled / 0.1, v3", 0.667)}
    for name in ("1", "2", "5"):
        goals[f"bullet_{name}"] = (f"PyBullet compiled / 0.1, {name} joints", 1.0)
        goals[f"bullet_plain_{name}"] = (f"PyBullet in plain Python / 0.1, {name} joints", 1.0)
    goals |= {
        "reset": ("reset of a two-joint arm, ms", 0.1),
        "blocks": ("quantities that differ where a run is cut in 1, 10 or 8192 steps", 0.0),
        "joints_mujoco": ("80 joints with Coulomb friction / one joint, MuJoCo", 120.0),
        "joints_bullet": ("the same, PyBullet", 250.0),
        "pictures": ("asrsim run of 1 s, 2 joints, pictures included / without", 2.5),
        "check": ("asrsim check of AlterEgo v2 (of its size where it is not there) / 0.1", 0.333),
        "log": ("log of 5 joints, bytes per joint and step", 300.0),
        "log_compact": ("the same, log: compact", 190.0),
        "memory": ("memory of a run of 1000 s, 5 joints, MB", 200.0),
        "memory_certify": ("the same certified, MB", 400.0),
        "help": ("asrsim --help / 0.1", 1.0),
        "start": ("asrsim run of 1 ms of 1 joint, no pictures / 0.1", 1.0),
        "log_write": ("writing the complete log, 5 joints, zstd / simulating in plain Python", 1.0),
        "log_read": ("reading link and motor states in bulk / iter_messages", 0.1),
    }
    return {name: Row(what=what, goal=goal) for name, (what, goal) in goals.items()}


ROWS: Mapping[str, Row] = _rows()


def table(rows: Mapping[str, Row]) -> str:
    """For people."""
    lines = [f"{'':16} {'figure':>8} {'goal':>8}   {'from .. to':>17}"]
    for name, row in rows.items():
        low, high = row.spread
        mark = " " if row.median <= row.goal else "!"
        lines.append(f"{name:16} {row.median:8.3f} {row.goal:8.3f} {mark} {low:7.3f} .. {high:7.3f}   {row.what}")
    return "\n".join(lines)


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="one JSON document on stdout")
    parser.add_argument("--only", default="", metavar="NAME", help="rows whose name begins so")
    parser.add_argument("--repeats", type=int, default=5, metavar="N", help="rounds of each row (5)")
    parser.add_argument("--figure", action="store_true", help="draw docs/images/performance.png instead")
    parser.add_argument("--docs", action="store_true", help="write docs/performance.md, with picture")
    arguments = parser.parse_args()
    wanted = [name for name in ROWS if name.startswith(arguments.only)]
    if not wanted:
        parser.error(f"no row begins with '{arguments.only}'; there are {', '.join(ROWS)}")
    from machine import machine, others

    load = others()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if arguments.figure:
            from figure import draw

            print(draw(folder))
            return
        from measure import measure

        figures = measure(wanted, max(1, arguments.repeats), folder)
        rows = {name: Row(what=row.what, goal=row.goal, ratios=figures[name]) for name, row in ROWS.items() if name in figures}
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
