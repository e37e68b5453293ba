"""What writing and reading a log costs: functions for `run.py`, and a table of their own when run as a script."""

from __future__ import annotations

import argparse
import json
import statistics
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from worker import whole
from worlds import chain, scenario

from asrsim.log import LogWriter, read_log
from asrsim.quantities import QUANTITIES
from asrsim.samples import JointInfo, RunInfo, Samples
from asrsim.scenario import load_scenario
from asrsim.simulation.run import simulate

STATES = (
    "link_position", "link_velocity", "link_torque",
    *(f"motor_{index}_{what}" for index in (1, 2) for what in ("position", "velocity", "torque")),
)  # fmt: skip
"""Link and motor states: what the two readers read."""


def log_write_seconds(samples: Samples, info: RunInfo, path: Path | None = None) -> float:
    """CPU time of writing a complete log, handed over in chunks as the simulation does, index and closing included."""
    size = 1000
    parts = [
        replace(
            samples,
            time=samples.time[start : start + size],
            values={name: table[start : start + size] for name, table in samples.values.items()},
            bodies={name: table[start : start + size] for name, table in samples.bodies.items()},
            contacts={name: table[start : start + size] for name, table in samples.contacts.items()},
        )
        for start in range(0, len(samples.time), size)
    ]
    with tempfile.TemporaryDirectory() as folder:
        target = path or Path(folder) / "run.mcap"
        target.unlink(missing_ok=True)
        begin = time.process_time()
        with LogWriter(target, info) as writer:
            for part in parts:
                writer.write(part)
        return time.process_time() - begin


def official_read_seconds(path: Path) -> float:
    """CPU time of the same as :func:`bulk_read_seconds` with the official reader's `iter_messages`, not decoded."""
    from mcap.reader import make_reader

    begin = time.process_time()
    with path.open("rb") as file:
        reader = make_reader(file)
        summary = reader.get_summary()
        assert summary is not None
        endings = ("/link_state", "/motor_1_state", "/motor_2_state")
        names = [channel.topic for channel in summary.channels.values()]
        # Per-joint topics; the robot-level arrays have the same endings, one level up.
        joints = {name.rsplit("/", 1)[0] for name in names if name.endswith("/link_state")}
        topics = [name for name in names if name.endswith(endings) and name.rsplit("/", 1)[0] in joints]
        count = sum(1 for _ in reader.iter_messages(topics))
    assert count
    return time.process_time() - begin


def bulk_read_seconds(path: Path) -> float:
    """CPU time of reading link and motor states of all joints into arrays."""
    begin = time.process_time()
    read_log(path, quantities=STATES)
    return time.process_time() - begin


def example(count: int = 20_000, joints: int = 5, quantities: tuple[str, ...] = tuple(QUANTITIES)) -> tuple[Samples, RunInfo]:
    """20 s at 1 kHz of smooth motion with full mantissas, every quantity recorded: the worst case for the compressor."""
    rng = np.random.default_rng(0)
    names = tuple(f"joint_{index}" for index in range(1, joints + 1))
    infos = tuple(
        JointInfo(name=name, actuator="qbmove", mode=6, namespace="arm", motors=2, quantities=quantities) for name in names
    )
    t = np.arange(count) * 1e-3
    values = {
        quantity: np.sin(t[:, None] * rng.uniform(1, 20, joints) + rng.uniform(0, 6, joints)) * rng.uniform(0.1, 5)
        for quantity in quantities
    }
    return Samples(time=t, joints=names, values=values), RunInfo(robot="arm", joints=infos, step=1e-3, urdf="<robot/>")


def log_ratios(repeats: int, folder: Path) -> tuple[list[float], list[float]]:
    """Writing the complete log of 5 joints over simulating them in plain Python; reading it in bulk over `iter_messages`."""
    path = scenario(chain(folder, 5), duration=20.0, compiled=False)
    (run,) = load_scenario(path)
    done = simulate(run)
    assert done.samples is not None
    steps = len(done.samples.time) - 1
    log = folder / "run.mcap"
    written, read = [], []
    for index in range(repeats + 1):
        write = log_write_seconds(done.samples, done.info, log) / (steps * whole({"scenario": path}))
        ratio = bulk_read_seconds(log) / official_read_seconds(log)
        if index:
            written.append(write)
            read.append(ratio)
    return written, read


def main() -> None:
    """Prints medians of interleaved rounds, and the ratio of the readers."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--rounds", type=int, default=5)
    arguments = parser.parse_args()
    samples, info = example()
    taken: dict[str, list[float]] = {"write": [], "read_bulk": [], "read_official": []}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.mcap"
        for _ in range(arguments.rounds):
            taken["write"].append(log_write_seconds(samples, info, path))
            taken["read_bulk"].append(bulk_read_seconds(path))
            taken["read_official"].append(official_read_seconds(path))
        size = path.stat().st_size
    result = {name: statistics.median(seconds) for name, seconds in taken.items()}
    result["log_read"] = result["read_bulk"] / result["read_official"]
    result["megabytes"] = size / 1e6
    if arguments.json:
        print(json.dumps(result))
        return
    for name, value in result.items():
        print(f"{name:14} {value:8.4f}")


if __name__ == "__main__":
    main()
