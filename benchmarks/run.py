"""Measure the speed and memory of asrsim.

    python benchmarks/run.py                 the table
    python benchmarks/run.py --json          the table as JSON
    python benchmarks/run.py --only loop     only rows whose name begins with "loop"
    python benchmarks/run.py --docs          write the table into docs/performance.md

Each value is the median of several rounds of CPU times. Ratios compare two times of the same round.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import re
import statistics
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
DOCUMENT = Path(__file__).parents[1] / "docs" / "performance.md"
LIBRARIES = ("pybullet", "mujoco-core", "numpy", "numba")


@dataclass(frozen=True, kw_only=True)
class Row:
    """A row of the table: a ratio, or a value in the unit that `what` names."""

    what: str
    goal: float
    """Largest value that meets the requirement."""
    values: tuple[float, ...] = ()
    """Measured value of each round."""

    @property
    def median(self) -> float:
        """Median of the values."""
        return statistics.median(self.values)


def _rows() -> dict[str, Row]:
    goals: dict[str, tuple[str, float]] = {}
    for name, loop in (("1", 0.6), ("2", 0.6), ("5", 0.85), ("v2", 0.85), ("v3", 0.85), ("v3_stops", 0.85)):
        goals[f"loop_{name}"] = (f"substep of the loop / mj_step without springs, robot {name}", loop)
        goals[f"record_{name}"] = (f"step with complete record / step without record, robot {name}", 1.5)
        goals[f"bullet_{name}"] = (
            f"substep in PyBullet with complete record / PyBullet's step without springs, robot {name}",
            3.0,
        )
        goals[f"worlds_{name}"] = (f"64 worlds / 64 simulations, robot {name}", 0.33)
    goals |= {
        "joints_mujoco": ("80 joints with Coulomb friction / one joint, MuJoCo", 120.0),
        "joints_bullet": ("80 joints with Coulomb friction / one joint, PyBullet", 250.0),
        "advance": ("advance(1) of two joints, us", 10.0),
        "advance_set": ("set_reference and advance(1) of two joints, us", 28.0),
        "environments": ("64 environments in one VectorEnv / 64 separate environments, steps of 20 ms", 0.3),
        "reset": ("reset of two joints, ms", 0.1),
        "blocks": ("quantities that differ if a run is advanced by 1, 10 or 8192 substeps a call", 0.0),
        "pictures": ("asrsim run of 1 s, 2 joints, with pictures / without", 2.5),
        "check": ("asrsim check of AlterEgo v2 (or a robot of its size), s", 2.0),
        "help": ("asrsim --help, s", 0.3),
        "start": ("asrsim run of 1 ms of 2 joints without pictures, s", 1.0),
        "log": ("log of 5 joints, bytes per joint and step", 300.0),
        "log_compact": ("log of 5 joints with log: compact, bytes per joint and step", 190.0),
        "memory": ("memory of a run of 1000 s, 5 joints, MB", 250.0),
        "memory_certify": ("memory of the same run with --certify, MB", 400.0),
        "log_write": ("writing the complete log of 5 joints / simulating in plain Python", 1.0),
        "log_read": ("reading link states into arrays / messages of the official reader", 0.1),
    }
    return {name: Row(what=what, goal=goal) for name, (what, goal) in goals.items()}


ROWS: Mapping[str, Row] = _rows()


def machine() -> dict[str, str]:
    """Processor, number of cores, and versions of Python and of the libraries."""
    cpus = re.findall(r"model name\s*: (.*)", Path("/proc/cpuinfo").read_text()) if Path("/proc/cpuinfo").exists() else []
    about = {"CPU": (cpus or [platform.machine()])[0], "cores": str(os.cpu_count()), "Python": platform.python_version()}
    return about | {library: version(library) for library in LIBRARIES}


def table(rows: Mapping[str, Row]) -> str:
    """Table of the rows as text; `!` marks a missed goal."""
    lines = [f"{'':16} {'median':>8} {'goal':>8}   {'from .. to':>17}"]
    for name, row in rows.items():
        mark = " " if row.median <= row.goal else "!"
        spread = f"{min(row.values):7.3f} .. {max(row.values):7.3f}"
        lines.append(f"{name:16} {row.median:8.3f} {row.goal:8.3f} {mark} {spread}   {row.what}")
    return "\n".join(lines)


def document(rows: Mapping[str, Row]) -> None:
    """Write the rows into docs/performance.md."""
    lines = ["| | measured | goal | |", "|---|---|---|---|"]
    lines += [f"| `{name}` | **{row.median:.3g}** | {row.goal:g} | {row.what} |" for name, row in rows.items()]
    missed = ", ".join(f"`{name}`" for name, row in rows.items() if row.median > row.goal) or "none"
    about = ", ".join(f"{key} {value}" for key, value in machine().items())
    text = "\n".join([*lines, "", f"Measured on: {about}. Missed goals: {missed}."])
    old = DOCUMENT.read_text(encoding="utf-8")
    new = re.sub(r"(?s)(?<=<!-- measured -->\n).*?(?=\n<!-- measured end -->)", lambda _: text, old)
    DOCUMENT.write_text(new, encoding="utf-8")


def main() -> None:
    """Measure the rows that the arguments name."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    parser.add_argument("--only", default="", metavar="NAME", help="measure only rows whose name begins with NAME")
    parser.add_argument("--repeats", type=int, default=5, metavar="N", help="number of rounds (5)")
    parser.add_argument("--docs", action="store_true", help="write docs/performance.md")
    arguments = parser.parse_args()
    wanted = [name for name in ROWS if name.startswith(arguments.only)]
    if not wanted:
        parser.error(f"no row begins with '{arguments.only}'; there are {', '.join(ROWS)}")
    from rows import measures

    with tempfile.TemporaryDirectory() as folder:
        functions = measures(Path(folder))
        rounds = [{name: functions[name]() for name in wanted} for _ in range(max(1, arguments.repeats))]
    rows = {name: replace(ROWS[name], values=tuple(one[name] for one in rounds)) for name in wanted}
    if arguments.docs:
        document(rows)
    elif arguments.json:
        values = {name: {"median": row.median, "goal": row.goal, "values": row.values} for name, row in rows.items()}
        print(json.dumps({"machine": machine(), "rows": values}, indent=2))
    else:
        print(", ".join(f"{key} {value}" for key, value in machine().items()))
        print(table(rows))


if __name__ == "__main__":
    main()
