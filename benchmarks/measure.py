"""The rows of `run.py`, each measured in turns with its reference."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from versions import Version, new, old
from worlds import chain, humanoid, scenario

Figures = dict[str, list[float]]
SHARED = Path(__file__).parents[2] / "shared"
"""Real robots, where they are there."""
BESIDE = ("mujoco_", "bullet_", "check", "help", "start")
"""Rows that 0.1 is measured for."""


def measure(wanted: Sequence[str], repeats: int, folder: Path) -> dict[str, tuple[float, ...]]:
    """Name -> a figure a round, of the rows that can be measured here; what shares a reference is measured together."""
    here = new()
    before = old() if any(name.startswith(BESIDE) for name in wanted) else None
    found: Figures = {}
    cases: dict[str, Callable[[], tuple[Path, int, float]]] = {
        "1": lambda: (chain(folder, 1), 1, 10.0),
        "2": lambda: (chain(folder, 2), 1, 10.0),
        "5": lambda: (chain(folder, 5), 1, 10.0),
        "v2": lambda: (humanoid(folder, 14, 48), 5, 1.5),
        "v3": lambda: (humanoid(folder, 20, 55), 5, 1.5),
        "v3_stops": lambda: (humanoid(folder, 20, 55, reach=0.2), 5, 1.5),
    }

    def take(name: str, function: Callable[[], float]) -> None:
        if name in wanted:
            found.setdefault(name, []).append(function())

    try:
        for case, make in cases.items():
            kinds = ("mujoco", "bare", "loop", "worlds", "bullet", "bullet_plain")
            if any(f"{kind}_{case}" in wanted for kind in kinds):
                _case(case, make(), wanted, repeats, here, before, found)
        for _ in range(repeats):
            take("reset", lambda: _reset_ms(folder))
            take("blocks", lambda: _differing(folder))
            for engine in ("mujoco", "bullet"):
                take(f"joints_{engine}", lambda engine=engine: _over_joints(here, folder, engine))  # type: ignore[misc]
            _commands(take, here, before, folder)
        _logs(take, wanted, folder)
    finally:
        for version in (here, before):
            if version is not None:
                version.close()
    return {name: tuple(values) for name, values in found.items() if values}


def _case(
    case: str, made: tuple[Path, int, float], wanted: Sequence[str], repeats: int, here: Version, before: Version | None,
    found: Figures,
) -> None:  # fmt: skip
    """Whole runs and loops of one robot."""
    robot, substeps, duration = made
    files = {
        (engine, compiled): scenario(robot, engine=engine, compiled=compiled, duration=duration, substeps=substeps)
        for engine in ("mujoco", "bullet")
        for compiled in (True, False)
    }
    fast, bullet, plain = files["mujoco", True], files["bullet", True], files["bullet", False]
    for _ in range(repeats):
        times: dict[str, float] = {}

        def seconds(key: str, version: Version, what: str, path: str, times: dict[str, float] = times, **more: str) -> float:
            if key not in times:
                times[key] = version.ask(what, scenario=path, **more)
            return times[key]

        def whole() -> float:
            return seconds("whole", here, "whole", fast)

        def loop() -> float:
            return seconds("loop", here, "loop", fast)

        rows: dict[str, Callable[[], float]] = {
            "bare": lambda: whole() / substeps / seconds("step", here, "bare", bullet, engine="bullet"),
            "loop": lambda: loop() / substeps / seconds("mj_step", here, "bare", fast, engine="mujoco"),
            "worlds": lambda: here.ask("worlds", scenario=fast),
        }
        if before is not None:
            rows |= {
                "mujoco": lambda: whole() / seconds("old", before, "whole", bullet),
                "bullet": lambda: seconds("bullet", here, "whole", bullet) / seconds("old", before, "whole", bullet),
                "bullet_plain": lambda: seconds("plain", here, "whole", plain) / seconds("old_plain", before, "whole", plain),
            }
        for kind, function in rows.items():
            if f"{kind}_{case}" in wanted:
                found.setdefault(f"{kind}_{case}", []).append(function())


def _reset_ms(folder: Path) -> float:
    """CPU ms of a reset to other initial positions."""
    from asrsim.scenario import load_scenario
    from asrsim.simulation.simulation import Simulation

    (loaded,) = load_scenario(scenario(chain(folder, 2), engine="mujoco", duration=1.0))
    with Simulation(loaded) as simulation:
        simulation.reset({"joint_0": 0.1})
        begin = time.process_time()
        for _ in range(300):
            simulation.reset({"joint_0": 0.1})
        return (time.process_time() - begin) / 300 * 1e3


def _differing(folder: Path) -> float:
    """Quantities whose bits depend on how many steps are taken at a time."""
    from asrsim.samples import concatenate
    from asrsim.scenario import load_scenario
    from asrsim.simulation.simulation import Simulation

    (loaded,) = load_scenario(scenario(chain(folder, 2), engine="mujoco", duration=9.0))
    records = []
    for size in (1, 10, 8192):
        with Simulation(loaded, record=True) as simulation:
            while simulation.substep < simulation.total:
                simulation.advance_to(min(simulation.substep + size, simulation.total))
            simulation.flush()
            kept = getattr(simulation, "recording", simulation).kept
            records.append(concatenate(kept).values)
    return float(
        sum(not all(np.array_equal(records[0][n], other[n], equal_nan=True) for other in records[1:]) for n in records[0])
    )


def _over_joints(here: Version, folder: Path, engine: str) -> float:
    """80 joints over one, chains with Coulomb friction."""
    many, one = (
        here.ask(
            "whole", scenario=scenario(chain(folder, n, friction=0.01), engine=engine, duration=d, gravity=False, amplitude=a)
        )
        for n, d, a in ((80, 3.0, 0.02), (1, 10.0, 0.3))
    )
    return many / one


def _commands(take: Callable[[str, Callable[[], float]], None], here: Version, before: Version | None, folder: Path) -> None:
    """Whole processes of the command line."""
    short = scenario(chain(folder, 1), compiled=None, duration=0.001)
    second = scenario(chain(folder, 2), compiled=None, duration=1.0)
    alterego = SHARED / "robots" / "alterego" / "alterego_v2_fixedbase-true_fixedhands-true.urdf"
    robot = str(alterego if alterego.exists() else humanoid(folder, 14, 48))

    def run(version: Version, path: str, *more: str) -> float:
        # Neither version takes the other's results away.
        out = folder / ("out" if version is here else "out_before")
        return version.ask("command", arguments=["run", path, "--quiet", "--out", str(out), "--overwrite", *more])

    take("pictures", lambda: run(here, second) / run(here, second, "--no-plot"))
    if before is not None:
        older = before
        take(
            "check", lambda: here.ask("command", arguments=["check", robot]) / older.ask("command", arguments=["check", robot])
        )
        take("help", lambda: here.ask("command", arguments=["--help"]) / older.ask("command", arguments=["--help"]))
        take("start", lambda: run(here, short, "--no-plot") / run(older, short, "--no-plot"))


def _logs(take: Callable[[str, Callable[[], float]], None], wanted: Sequence[str], folder: Path) -> None:
    """What logs hold and cost, and the memory of long runs."""
    for name, extra in (("log", ""), ("log_compact", "log: compact\n")):
        take(name, lambda extra=extra: _cli(folder, scenario(chain(folder, 5), duration=10.0, extra=extra))[1] / 5 / 10_001)  # type: ignore[misc]
    path = scenario(chain(folder, 5), duration=1000.0) if "memory" in wanted or "memory_certify" in wanted else ""
    take("memory", lambda: _cli(folder, path)[0])
    take("memory_certify", lambda: _cli(folder, path, "--certify")[0])
    if "log_write" in wanted or "log_read" in wanted:
        from log import log_ratios

        written, read = log_ratios(3, folder)
        take("log_write", lambda: float(np.median(written)))
        take("log_read", lambda: float(np.median(read)))


def _cli(folder: Path, path: str, *more: str) -> tuple[float, int]:
    """Peak memory in MB of `asrsim run` without pictures, and bytes of its log."""
    code = (
        "import sys, resource\nfrom asrsim.cli.app import main\ntry:\n    main()\nexcept SystemExit:\n    pass\n"
        "sys.stderr.write(str(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss))"
    )
    out = folder / "log"
    command = [sys.executable, "-c", code, "run", path, "--no-plot", "--quiet", "--overwrite", "--out", str(out), *more]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    (log,) = out.rglob("log.mcap")
    size = log.stat().st_size
    log.unlink()
    return int(done.stderr.split()[-1]) * 1024 / 1e6, size
