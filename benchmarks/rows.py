"""Functions that measure one value of the benchmark table each. Times are CPU times of a process."""

from __future__ import annotations

import resource
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from robots import chain, humanoid, scenario

from asrsim import Simulation, Worlds, make_env, make_vec_env
from asrsim.log import LogWriter, read_log
from asrsim.samples import Samples, concatenate
from asrsim.scenario import load_scenario
from asrsim.simulation.run import simulate

Measure = Callable[[], float]
STATES = ("link_position", "link_velocity", "link_torque")
"""Topics whose reading time is measured."""


class Discard:
    """Sink that discards the samples."""

    def write(self, samples: Samples) -> None:
        """Discard the samples."""


def cpu(function: Callable[[], Any]) -> float:
    """CPU time of a call, s."""
    begin = time.process_time()
    function()
    return time.process_time() - begin


def whole(path: str) -> float:
    """CPU time per step of a run that records every quantity, without its start, s."""
    (loaded,) = load_scenario(path)
    marks: list[tuple[float, float]] = []
    simulate(loaded, sinks=[Discard()], keep=False, progress=lambda now: marks.append((now.time, time.process_time())))
    (first, begin), (last, end) = marks[0], marks[-1]
    return (end - begin) / ((last - first) / loaded.step)


def loop(path: str) -> float:
    """CPU time per step of the simulation loop without recording, s."""
    with Simulation(path) as simulation:
        simulation.advance(500)
        steps = simulation.scenario.steps - 500
        return cpu(lambda: simulation.advance(steps)) / steps


def calls(path: str, *, set_reference: bool) -> float:
    """CPU time of `advance(1)`, with or without setting a reference before each step, us."""
    with Simulation(path) as simulation:

        def steps(count: int) -> None:
            for k in range(count):
                if set_reference:
                    simulation.set_reference("joint_0", "equilibrium_position", 1e-6 * k)
                simulation.advance(1)

        steps(100)
        return cpu(lambda: steps(3000)) / 3000 * 1e6


def together(path: str) -> float:
    """CPU time per step of 64 worlds in one simulation, divided by the time of 64 separate simulations."""
    simulations = [Simulation(path) for _ in range(64)]
    worlds = Worlds(path, 64, names=["link_position"], watched=False)

    def apart() -> None:
        for simulation in simulations:
            simulation.advance(20)

    pairs = [(cpu(lambda: worlds.advance(20)), cpu(apart)) for _ in range(10)][1:]
    for each in (worlds, *simulations):
        each.close()
    return sum(many for many, _ in pairs) / sum(single for _, single in pairs)


def environments(path: str) -> float:
    """CPU time per step of 64 vectorised environments, divided by the time of 64 separate environments."""
    many, single = make_vec_env(path, 64), make_env(path)
    actions = np.zeros(many.action_space.shape)
    many.reset(seed=0)
    single.reset(seed=0)

    def apart() -> None:
        for _ in range(64):
            single.step(actions[0])

    pairs = [(cpu(lambda: many.step(actions)), cpu(apart)) for _ in range(7)][1:]
    many.close()
    single.close()
    return sum(both for both, _ in pairs) / sum(each for _, each in pairs)


def bare(robot: Path, engine: str, steps: int = 2000) -> float:
    """CPU time per step of the physics engine alone, s. The robot swings without springs and is reset every 200 steps."""
    if engine == "mujoco":
        import mujoco

        model = mujoco.MjModel.from_xml_path(str(robot))
        model.opt.timestep = 1e-3
        data = mujoco.MjData(model)

        def reset() -> None:
            mujoco.mj_resetData(model, data)
            data.qpos[:] = 0.3

        step = partial(mujoco.mj_step, model, data)
    else:
        import pybullet
        from pybullet_utils.bullet_client import BulletClient

        client: Any = BulletClient(pybullet.DIRECT)
        body = client.loadURDF(str(robot), useFixedBase=True)
        joints = [j for j in range(client.getNumJoints(body)) if client.getJointInfo(body, j)[2] != client.JOINT_FIXED]
        client.setGravity(0, 0, -9.81)
        client.setTimeStep(1e-3)
        for j in joints:
            client.setJointMotorControl2(body, j, client.VELOCITY_CONTROL, force=0.0)

        def reset() -> None:
            for j in joints:
                client.resetJointState(body, j, 0.3)

        step = client.stepSimulation
    taken = 0.0
    for _ in range(steps // 200):
        reset()
        taken += cpu(lambda: [step() for _ in range(200)])
    return taken / steps


def reset_ms(path: str) -> float:
    """CPU time of a reset to new start positions, ms."""
    with Simulation(path) as simulation:

        def resets(count: int) -> None:
            for _ in range(count):
                simulation.reset({"joint_0": 0.1})

        resets(5)
        return cpu(lambda: resets(300)) / 300 * 1e3


def differing(path: str) -> float:
    """Number of quantities whose values differ in any bit if the number of steps per call changes."""
    records = []
    for size in (1, 10, 8192):
        with Simulation(path, record=True) as simulation:
            while simulation.substep < simulation.total:
                simulation.advance_to(min(simulation.substep + size, simulation.total))
            records.append(simulation.samples.values)
    return float(
        sum(not all(np.array_equal(records[0][name], other[name], equal_nan=True) for other in records) for name in records[0])
    )


def command(*arguments: str) -> float:
    """CPU time of an asrsim command, s."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-m", "asrsim", *arguments], check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def run_command(folder: Path, path: str, *options: str) -> float:
    """CPU time of `asrsim run`, s."""
    return command("run", path, "--quiet", "--out", str(folder / "out"), "--overwrite", *options)


def logged(folder: Path, path: str, *options: str) -> tuple[float, float]:
    """Peak memory of `asrsim run` without pictures (MB), and size of its log per joint and step (bytes), for 5 joints."""
    code = (
        "import re, sys\nfrom asrsim.cli.app import main\ntry:\n    main()\nexcept SystemExit:\n    pass\n"
        # The peak that getrusage gives contains the memory of the process that started this one.
        "sys.stderr.write(re.search(r'VmHWM:\\s+(\\d+)', open('/proc/self/status').read())[1])"
    )
    out = folder / "log"
    command = [sys.executable, "-c", code, "run", path, "--no-plot", "--quiet", "--overwrite", "--out", str(out), *options]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    (log,) = out.rglob("log.mcap")
    (loaded,) = load_scenario(path)
    return int(done.stderr.split()[-1]) * 1024 / 1e6, log.stat().st_size / 5 / (loaded.steps + 1)


def writing(folder: Path, path: str) -> float:
    """CPU time of writing a complete log, divided by the time of the simulation."""
    chunks: list[Samples] = []

    class Keep:
        def write(self, samples: Samples) -> None:
            chunks.append(samples)

    (loaded,) = load_scenario(path)
    simulated = cpu(lambda: simulate(loaded, keep=False))
    done = simulate(loaded, sinks=[Keep()], keep=False)

    def write() -> None:
        with LogWriter(folder / "run.mcap", done.info) as writer:
            for chunk in chunks:
                writer.write(chunk)

    assert len(concatenate(chunks).time) == loaded.steps + 1
    return cpu(write) / simulated


def reading(folder: Path, path: str) -> float:
    """CPU time of reading link states into arrays, divided by the time in which the official reader lists the raw messages."""
    from mcap.reader import make_reader

    run_command(folder, path, "--no-plot")
    (log,) = (folder / "out").rglob("log.mcap")

    def official() -> None:
        with log.open("rb") as file:
            reader = make_reader(file)
            summary = reader.get_summary()
            assert summary is not None
            topics = [channel.topic for channel in summary.channels.values() if channel.topic.endswith("/link_state")]
            assert sum(1 for _ in reader.iter_messages(topics))

    return cpu(lambda: read_log(log, quantities=STATES)) / cpu(official)


def measures(folder: Path) -> dict[str, Measure]:
    """Functions that measure the rows of the table, by row name."""
    found: dict[str, Measure] = {}
    cases: dict[str, tuple[Path, int, float]] = {
        **{str(n): (chain(folder, n), 1, 10.0) for n in (1, 2, 5)},
        "v2": (humanoid(folder, 14, 48), 5, 1.5),
        "v3": (humanoid(folder, 20, 55), 5, 1.5),
        "v3_stops": (humanoid(folder, 20, 55, reach=0.2), 5, 1.5),
    }
    for name, (robot, substeps, duration) in cases.items():
        # With `auto`, short runs are compiled only if an earlier row has loaded Numba.
        options: Any = {"duration": duration, "substeps": substeps, "extra": "compiled: true\n"}
        fast, bullet = (scenario(robot, engine=engine, **options) for engine in ("mujoco", "bullet"))
        found |= {
            f"loop_{name}": lambda r=robot, f=fast, n=substeps: loop(f) / n / bare(r, "mujoco"),
            f"record_{name}": lambda f=fast: whole(f) / loop(f),
            f"bullet_{name}": lambda r=robot, f=bullet, n=substeps: whole(f) / n / bare(r, "bullet"),
            f"worlds_{name}": partial(together, fast),
        }  # type: ignore[dict-item]
    two, five = cases["2"][0], cases["5"][0]
    short = scenario(two, duration=1.0)
    fast = scenario(two, duration=1.0, extra="compiled: true\n")
    many, one = (
        [
            scenario(chain(folder, n, friction=0.01), engine=engine, duration=d, amplitude=a, extra="gravity: [0, 0, 0]\n")
            for engine in ("mujoco", "bullet")
        ]
        for n, d, a in ((80, 3.0, 0.02), (1, 10.0, 0.3))
    )
    found |= {
        f"joints_{engine}": lambda i=i: whole(many[i]) / whole(one[i])  # type: ignore[misc]
        for i, engine in enumerate(("mujoco", "bullet"))
    }
    alterego = Path(__file__).parents[2] / "shared/robots/alterego/alterego_v2_fixedbase-true_fixedhands-true.urdf"
    model = str(alterego if alterego.exists() else cases["v2"][0])
    long = scenario(five, duration=1000.0)
    found |= {
        "advance": partial(calls, fast, set_reference=False),
        "advance_set": partial(calls, fast, set_reference=True),
        "environments": partial(environments, short),
        "reset": partial(reset_ms, fast),
        "blocks": partial(differing, scenario(two, duration=9.0)),
        "pictures": lambda: run_command(folder, short) / run_command(folder, short, "--no-plot"),
        "check": lambda: command("check", model),
        "help": lambda: command("--help"),
        "start": lambda: run_command(folder, scenario(two, duration=0.001), "--no-plot"),
        "log": lambda: logged(folder, scenario(five))[1],
        "log_compact": lambda: logged(folder, scenario(five, extra="log: compact\n"))[1],
        "memory": lambda: logged(folder, long)[0],
        "memory_certify": lambda: logged(folder, long, "--certify")[0],
        "log_write": lambda: writing(folder, scenario(five, duration=20.0, extra="compiled: false\n")),
        "log_read": lambda: reading(folder, scenario(five, duration=20.0)),
    }
    return found
