"""Compare speed and motion with another version of asrsim, such as 0.2, in turns on the same machine.

    git worktree add ../asrsim_0.2 45e5169
    python benchmarks/against.py ../asrsim_0.2                  all rows, as ratios now / then
    python benchmarks/against.py ../asrsim_0.2 --only loop      only rows whose name begins with "loop"

Ratios compare CPU times of processes that run one after the other; each value is a median of several rounds.
Both versions run with the packages of this environment.
"""

from __future__ import annotations

import argparse
import os
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from robots import chain, humanoid, scenario

ROOT = Path(__file__).resolve().parents[1]
EXAMPLES = ROOT / "examples" / "scenarios"
SHARED = ROOT.parent / "shared" / "robots" / "alterego"
COMMANDS: Mapping[str, tuple[str, ...]] = {
    "help": ("--help",),
    "ilc_paper": ("ilc", str(EXAMPLES / "ilc_2dof.yaml"), "--no-plot"),
    "ilc_auto": ("ilc", str(EXAMPLES / "ilc_2dof.yaml"), "--set", "ilc.law=auto", "--no-plot"),
    "sweep": (
        "sweep",
        str(EXAMPLES / "step_2dof.yaml"),
        "--variant",
        "soft",
        "--over",
        "references.joint_1.stiffness_preset=0.2:0.6:200",
        "--workers",
        "2",
    ),
}
"""Command lines whose whole CPU time is compared, by row."""


class Marks:
    """Sink that discards the samples of a run, and keeps the CPU times at which its parts end."""

    def __init__(self) -> None:
        self.times: list[tuple[float, float]] = []
        """Pairs (simulated time, CPU time), s."""

    def add(self, told: object) -> None:
        """Add the end of a part at the simulated time, s. told: `Progress`; in versions before 0.2 the time itself."""
        self.times.append((getattr(told, "time", told), time.process_time()))

    def write(self, samples: object) -> None:
        """Discard the samples."""


def loop(path: str) -> float:
    """CPU time of a step of a run that records every quantity, without its start, s."""
    from asrsim.scenario import load_scenario
    from asrsim.simulation.run import simulate

    (loaded,) = load_scenario(path)
    times = []
    for _ in range(5):
        marks = Marks()
        simulate(loaded, sinks=[marks], keep=False, progress=marks.add)
        (first, begin), (last, end) = marks.times[0], marks.times[-1]
        times.append((end - begin) / ((last - first) / loaded.step))
    return statistics.median(times)


def outside(path: str) -> float:
    """CPU time of all but the loop of a run with a log (examine, build, log, summary), after a first run, s."""
    from asrsim.api import run
    from asrsim.scenario import load_scenario

    (loaded,) = load_scenario(path)
    with tempfile.TemporaryDirectory() as folder:
        whole = _median(lambda: run(path, out=folder, keep=False))
    return whole - loop(path) * loaded.duration / loaded.step


def plain(path: str) -> float:
    """CPU time of a step of a simulation in plain Python, in calls of 20 steps, s."""
    import asrsim

    with asrsim.Simulation(path, overrides={"compiled": False}) as simulation:
        return _median(lambda: [simulation.advance(20) for _ in range(10)]) / 200


def worlds(path: str) -> float:
    """CPU time of a step of one of 64 worlds, in calls of 20 steps, s; versions without `Worlds` use 64 simulations."""
    import asrsim

    with ExitStack() as stack:
        if hasattr(asrsim, "Worlds"):
            parts: list[Any] = [stack.enter_context(asrsim.Worlds(path, 64, names=["link_position"], watched=False))]
        else:
            parts = [stack.enter_context(asrsim.Simulation(path)) for _ in range(64)]
        return _median(lambda: [part.advance(20) for part in parts]) / (64 * 20)


def environments(count: int, path: str) -> float:
    """CPU time of a physics step of 1 ms of one of `count` environments with a reward, in control steps of 20 ms with random
    actions, s. Versions that know rewards of all environments at once, and substeps as needed, use them."""
    import asrsim
    from asrsim.environment.options import Options

    def reward(state: Any) -> Any:
        return -np.abs(state.values["link_position"] - 0.5).sum(axis=-1)

    more: dict[str, Any] = dict.fromkeys({"batched", "adaptive"} & Options.__annotations__.keys(), True)
    many = asrsim.make_vec_env(path, count, reward=reward, **more)
    many.reset(seed=0)
    actions = iter(np.random.default_rng(0).uniform(-1.0, 1.0, (21, *many.action_space.shape)).astype(np.float32))
    return _median(lambda: many.step(next(actions))) / (count * round(0.02 / many.worlds.prepared.scenario.step))


def environment(path: str) -> float:
    """CPU time of a step of 20 ms of one environment with a reward, s."""
    import asrsim

    one = asrsim.make_env(path, reward=lambda state: -float(np.abs(state.values["link_position"] - 0.5).sum()))
    one.reset(seed=0)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (50, *one.action_space.shape)).astype(np.float32)
    return _median(lambda: [one.step(action) for action in actions]) / len(actions)


def twin(path: str) -> float:
    """CPU time of a step of a twin whose robot follows a sine, s."""
    import asrsim

    with asrsim.Twin(path, compiled=True) as own:
        goals = (0.3 * np.sin(0.006 * np.arange(5000))).tolist()

        def steps(count: int = 200) -> None:
            for goal in [goals.pop() for _ in range(count)]:
                own.step(dict.fromkeys(own.joints, 0.9 * goal), {name: {"equilibrium_position": goal} for name in own.joints})

        return _median(steps) / 200


def motion(path: str) -> Any:
    """Link positions of a run, rad."""
    from asrsim.scenario import load_scenario
    from asrsim.simulation.run import simulate

    samples = simulate(load_scenario(path)[0]).samples
    assert samples is not None
    return samples.values["link_position"]


def _median(function: Callable[[], object]) -> float:
    """Median CPU time of 20 calls after a first call, s."""
    function()
    times = []
    for _ in range(20):
        begin = time.process_time()
        function()
        times.append(time.process_time() - begin)
    return statistics.median(times)


def _cases(folder: Path) -> dict[str, tuple[Callable[[str], Any], str]]:
    """Measure and scenario of every row that is measured inside a process."""
    found: dict[str, tuple[Callable[[str], Any], str]] = {}
    files = {"v2": "alterego_v2_fixedbase-true_fixedhands-true.urdf", "v3": "alterego_v3_fixedbase-true_fixedhands-true.urdf"}
    for name, joints, links, substeps in (("v2", 14, 48, 5), ("v3", 20, 55, 4)):
        real = SHARED / files[name]
        robot = real if real.exists() else humanoid(folder, joints, links)
        found[f"loop_{name}"] = (loop, _scenario(folder, robot, duration=5.0, substeps=substeps))
        found[f"outside_{name}"] = (outside, _scenario(folder, robot, duration=2.0, substeps=substeps))
    for joints in (1, 2, 5):
        robot = chain(folder, joints)
        found[f"loop_{joints}"] = (loop, _scenario(folder, robot, duration=50.0))
        found[f"outside_{joints}"] = (outside, _scenario(folder, robot, duration=2.0))
        found[f"bullet_{joints}"] = (loop, _scenario(folder, robot, duration=2.0, engine="bullet"))
        found[f"plain_{joints}"] = (plain, _scenario(folder, robot, duration=50.0))
        found[f"worlds_{joints}"] = (worlds, _scenario(folder, robot, duration=50.0))
        for engine in ("mujoco", "bullet"):
            found[f"motion_{engine}_{joints}"] = (motion, _scenario(folder, robot, duration=1.0, engine=engine))
    two = EXAMPLES.parent / "urdf" / "dof2_horizontal.urdf"
    ranges = '{"*": {equilibrium_position: [-1, 1], stiffness_preset: [0.05, 0.4]}}'
    free = _scenario(folder, two, duration=60.0, substeps=None, extra=f"reference_ranges: {ranges}\n")
    for count in (64, 1024):
        found[f"environments_{count}"] = (partial(environments, count), free)
    found["one_environment"] = (environment, _scenario(folder, chain(folder, 2), duration=60.0))
    found["twin"] = (twin, _scenario(folder, chain(folder, 2), duration=60.0))
    return found


def _scenario(folder: Path, robot: Path, *, extra: str = "", **options: Any) -> str:
    """Compiled scenario of a robot in `folder`, with all actuators in mode 6. extra: additional lines of YAML."""
    copy = folder / robot.name
    if robot != copy:
        shutil.copy(robot, copy)
    return scenario(copy, extra=f"compiled: true\nmodes: 6\n{extra}", **options)


def _run(tree: Path, command: list[str]) -> float:
    """CPU time of a process that runs `command` with the package in `tree`, s."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    environment = {**os.environ, "PYTHONPATH": str(tree)}
    subprocess.run([sys.executable, "-P", *command], check=True, env=environment, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    """Print one line for each row."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tree", type=Path, help="folder with the other version")
    parser.add_argument("--only", default="", help="beginning of the names of rows")
    parser.add_argument("--repeats", type=int, default=3, help="number of rounds")
    parser.add_argument("--measure", nargs=3, metavar=("ROW", "FOLDER", "FILE"), help="measure one row in this process")
    given = parser.parse_args()
    if given.measure:
        row, folder, file = given.measure
        function, path = _cases(Path(folder))[row]
        np.save(file, function(path))
        return
    trees = (given.tree.resolve(), ROOT)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        result = folder / "result.npy"
        for row in (row for row in (*_cases(folder), *COMMANDS) if row.startswith(given.only)):
            rounds = []
            for _ in range(given.repeats if not row.startswith("motion") else 1):
                pair = []
                for tree in trees:
                    if row in COMMANDS:
                        written = () if row == "help" else ("--out", str(folder / "out"), "--overwrite")
                        pair.append(_run(tree, ["-m", "asrsim", *COMMANDS[row], *written]))
                        continue
                    _run(tree, [__file__, str(given.tree), "--measure", row, name, str(result)])
                    pair.append(np.load(result))
                rounds.append(pair)
            if row.startswith("motion"):
                print(f"{row:18} largest difference {np.abs(rounds[0][0] - rounds[0][1]).max():.1e} rad", flush=True)
            else:
                then, now = (statistics.median(float(pair[i]) for pair in rounds) for i in (0, 1))
                ratios = statistics.median(float(new) / float(old) for old, new in rounds)
                print(f"{row:18} {ratios:.2f}   ({then:.3g} s then, {now:.3g} s now)", flush=True)


if __name__ == "__main__":
    main()
