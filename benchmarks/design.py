"""Measure the quality of `asrsim design` on five robots: each row of the table in docs/design.md.

python benchmarks/design.py tighter [ROBOT ...]   intervals of a design and of the best chirp, staircase, chirp + preset steps
python benchmarks/design.py gains [ROBOT ...]     intervals of a design with chosen gains and of one step
python benchmarks/design.py fits [ROBOT]          predicted intervals and the scatter of fits to simulated recordings
python benchmarks/design.py limits [ROBOT ...]    number of motions that exceed limits if parameters are wrong by a factor of 2
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import yaml
from scipy.ndimage import uniform_filter1d

import asrsim
from asrsim.designs import design
from asrsim.designs.limits import read_limits
from asrsim.designs.plant import DesignPlant
from asrsim.designs.run import altered, design_task, read_task
from asrsim.designs.search import SMALL, Search
from asrsim.designs.write import write_design

URDF = Path(__file__).parent.parent / "examples" / "urdf"
MOTOR = ["motor_1_inertia", "motor_1_damping", "motor_1_friction_torque"]
PRESET = "stiffness_preset"
LOSSES = ["damping", "friction"]
ROBOTS = {
    "sea": (["spring_stiffness"], {"spring_stiffness": 8.0}, {"deflection": 0.6}, {}),
    "qbmove": (["spring_a_1", "spring_k_1"], {}, {"deflection": 0.5, PRESET: [0.1, 0.45]}, {PRESET: 0.25}),
    "bavs": (["spring_k", "spring_exponent"], {}, {"deflection": 0.2, PRESET: [0.02, 0.2]}, {PRESET: 0.08}),
    "awas_ii": (["spring_stiffness"], {}, {"deflection": 0.28, PRESET: [0.004, 0.02]}, {PRESET: 0.01}),
}
"""Robots by name: free spring parameters, fixed parameters, limits in addition to the common ones, references."""
SECONDS = 4.0
"""Duration of the motions, s."""


def laboratory(name: str, folder: Path, choose: dict | None = None) -> tuple[Path, Path, dict]:
    """Scenario file, limits file and options of `design` for a robot."""
    two = name == "two"
    springs, parameters, limits, references = ROBOTS["qbmove" if two else name]
    joints = ["joint_1", "joint_2"] if two else ["joint_1"]
    kind = "qbmove" if two else name
    own = [*springs, *LOSSES, *MOTOR] if not two else [*springs, *LOSSES, MOTOR[2]]
    free = [f"{joint}.{key}" for joint in joints for key in own]
    free += ["link_2.mass", "link_1.mass", "link_2.iyy"] if two else ["link_1.mass", "link_1.iyy"]
    ties = []
    if kind in ("qbmove", "bavs"):
        keys = [key for key in own if "_1" in key]
        ties = [f"{joint}.{key.replace('_1', '_2', 1)}={joint}.{key}" for joint in joints for key in keys]
    scenario = {
        "robot": str(URDF / ("dof2_vertical.urdf" if two else "dof1_qbmove_cube.urdf")),
        "duration": SECONDS,
        "actuators": {joint: {"type": kind, "mode": 6} for joint in joints},
        "parameters": dict.fromkeys(joints, parameters),
        "references": dict.fromkeys(joints, references),
        "initial": "equilibrium",
        "engine": "mujoco",
    }
    if two:
        del scenario["actuators"]
    bounds = {"link_position": [-1.2, 1.2], "link_velocity": 10, "motor_torque": 5.5, **limits}
    data = {"limits": dict.fromkeys(joints, bounds)} | ({"choose": choose} if choose else {})
    paths = folder / f"{name}.yaml", folder / f"{name}.limits.yaml"
    for path, content in zip(paths, (scenario, data), strict=True):
        path.write_text(yaml.safe_dump(yaml.safe_load(yaml.safe_dump(content))))
    return *paths, {"free": free, "ties": ties}


def searcher(scenario: Path, limits: Path, options: dict, stack: ExitStack, seconds: float = SECONDS) -> Search:
    """Design search for motions of the robot within its limits."""
    read = read_limits(limits)
    ready, given, layout, _ = read_task(design_task(scenario, (), options))
    plant = DesignPlant(ready, given, layout, read, seconds, [np.zeros(len(layout))])
    stack.callback(plant.close)
    return Search(plant.under({}), 1, np.zeros((len(layout), len(layout))), np.random.default_rng(99))


def plain(plant: DesignPlant) -> Iterator[tuple[str, np.ndarray]]:
    """Yield simple motions: name, and references (references, rows) as fractions of their ranges."""
    t = plant.step * np.arange(plant.rows)
    whole = t[-1]
    slots = [one.slot for one in plant.references]
    gentle = np.clip(t / 0.2, 0, 1) * np.clip((whole - 0.1 - t) / 0.2, 0, 1)
    first = next((i for i, slot in enumerate(slots) if slot == 1), None)

    def chirp(low: float, high: float, phase: float) -> np.ndarray:
        return gentle * np.sin(2 * np.pi * (low * t + 0.5 * (high - low) / whole * t**2) + phase)

    def stairs(levels: int, rise: float, turn: int) -> np.ndarray:
        heights = np.sin(2.399963 * (turn + 1) * np.arange(1, levels + 1))
        steps = np.diff(np.append(heights, 0.0), prepend=0.0)
        edges = whole * np.linspace(0.02, 0.9, levels + 1)
        return sum(h * np.clip((t - e) / rise, 0, 1) for h, e in zip(steps, edges, strict=True))

    for low in (0.2, 1.0):
        for high in (2.0, 4.0, 7.0, 12.0, 20.0):
            for phase in (0.0, 1.5):
                rows = np.array([chirp(low, high * (1.0 if i < 2 else 0.7), phase * i) * (s == 0) for i, s in enumerate(slots)])
                yield "chirp", rows
                if first is not None and phase == 0.0:
                    for preset in (np.sign(np.sin(2 * np.pi * t / whole)), 0.99 * (t > 0.5 * whole), -0.99 * (t > 0.5 * whole)):
                        preset = uniform_filter1d(np.where(t > whole - 0.3, 0.0, preset), round(0.2 / plant.step))
                        yield "chirp and preset step", rows + np.array([preset * (s == 1) for s in slots])
    for levels in (3, 6, 12, 20):
        for rise in (0.005, 0.05, 0.15):
            yield "staircase", np.array([stairs(levels, rise, i) * (s == 0) for i, s in enumerate(slots)])
    yield "one step", np.array([np.clip((t - 0.1) / 0.005, 0, 1) * (t < whole) * (s == 0) for s in slots])


def fitting(search: Search, shares: np.ndarray) -> float:
    """Score of a simple motion whose amplitude is as large as the limits allow.

    Bisection finds the amplitude, first for all joints together, then for each joint. The information is computed with small
    and with larger parameter changes, and the worst score counts, as for a design.
    """
    plant = search.plant
    slots = np.array([one.slot for one in plant.references])
    size, best, largest = np.zeros(len(shares)), np.inf, None
    joints = [slots == 0, *(np.eye(len(slots), dtype=bool)[slots == 0] if np.sum(slots == 0) > 1 else [])]
    for mine in joints:
        low, high = float(size[mine][0]), 1.0
        for _ in range(8):
            middle = 0.5 * (low + high)
            there = np.where(slots == 1, 1.0, np.where(mine, middle, size))
            motion = np.array(
                [p.values(np.clip(f * s, -1, 1)) for p, f, s in zip(plant.references, there, shares, strict=True)]
            )
            found = plant.play(motion, 1, changes=SMALL)
            if found is not None and found.use.max() <= 1.0 and found.information is not None:
                low, size = middle, there
                if float(search.score(found.information)) < best:
                    best, largest = float(search.score(found.information)), motion
            else:
                high = middle
    changes = [(h, -h) for h in (1e-4, 1e-3) if largest is not None]
    outcomes = [plant.play(largest, 1, changes=both) for both in changes]
    scores = [float(search.score(one.information)) for one in outcomes if one is not None and one.information is not None]
    return max([best, *scores])


def tighter(names: list[str]) -> None:
    """Compare the intervals of a design with those of simple motions, with equal gains, equal limits and 4 s."""
    for name in names:
        with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
            scenario, limits, options = laboratory(name, Path(folder))
            search = searcher(scenario, limits, options, stack)
            best: dict[str, float] = {}
            for kind, shares in plain(search.plant):
                best[kind] = min(best.get(kind, np.inf), fitting(search, shares))
            began = time.perf_counter()
            found = design(scenario, limits, duration=SECONDS, **options)
            took = time.perf_counter() - began
            percent = {kind: 196 * np.exp(value) for kind, value in best.items()}
            own = 196 * np.exp(search.rank(found.found))
            others = min(value for kind, value in percent.items() if kind != "one step")
            text = ", ".join(f"{kind} {value:.3g} %" for kind, value in percent.items())
            gain, step = others / own, percent["one step"] / own
            print(f"{name}: design {own:.3g} %, {text}: {gain:.2f} x, one step {step:.1f} x; {took:.0f} s", flush=True)


def gains(names: list[str]) -> None:
    """Compare a design that chooses the gain of the first controller from three values with one step at the robot's gain."""
    for name in names:
        with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
            scenario, within, options = laboratory(name, Path(folder))
            search = searcher(scenario, within, options, stack)
            step = next(fitting(search, shares) for kind, shares in plain(search.plant) if kind == "one step")
            choose = {"joint_1.controller_1_proportional": [12, 40, 125]}
            scenario, within, options = laboratory(name, Path(folder), choose)
            found = design(scenario, within, duration=SECONDS, **options)
            mean = 1.96 * np.exp(search.rank(found.found))
            print(
                f"{name}: design {100 * mean:.3g} % with {dict(found.gains)}, one step "
                f"{196 * np.exp(step):.3g} %: {1.96 * np.exp(step) / mean:.1f} x",
                flush=True,
            )


def recorded(folder: Path, scenario: Path, joints: int) -> tuple[np.ndarray, list[str], np.ndarray]:
    """Noise-free recording of the designed scenario: columns, headings, and mask of the measured columns."""
    result = asrsim.run(scenario)
    headings, columns = ["time [s]"], [result.time]
    table = np.genfromtxt(folder / "excite.csv", delimiter=",", names=None, skip_header=2)
    heads = (folder / "excite.csv").read_text().splitlines()[1].split(",")
    headings += heads[1:]
    columns += list(table.T[1:])
    measured = len(columns)
    for j in range(1, joints + 1):
        for name in ("link_position", "motor_1_position", "motor_2_position"):
            values = result[f"joint_{j}"].get(name) if hasattr(result[f"joint_{j}"], "get") else None
            if values is not None and np.isfinite(values).all():
                headings.append(f"joint_{j}.{name} [rad]")
                columns.append(values)
    return np.column_stack(columns), headings, np.arange(len(columns)) >= measured


def fits(names: list[str], count: int = 40) -> None:
    """Compare predicted intervals with the scatter of fits to simulated recordings with 1 mrad of noise."""
    for name in names:
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place)
            scenario, limits, options = laboratory(name, folder)
            found = design(scenario, limits, duration=SECONDS, **options)
            write_design(found, folder / "excite.csv", plot=False)
            clean, headings, measured = recorded(folder, folder / "excite.yaml", 2 if name == "two" else 1)
            promised, errors, own = found.intervals["design"], [], []
            for number in range(count):
                noise = np.random.default_rng(number).normal(0.0, 1e-3, clean.shape) * measured
                path = folder / f"trial_{number}.csv"
                np.savetxt(path, clean + noise, delimiter=",", header=",".join(headings), comments="", fmt="%.9g")
                fit = asrsim.identify(scenario, [path], hold_out=0.0, **options)
                values = [fit.find(key) for key in found.keys]
                truth = [entry.value(0.0) for entry in fit.layout.entries]
                errors.append([one.value / true - 1.0 for one, true in zip(values, truth, strict=True)])
                own.append([one.low <= true <= one.high for one, true in zip(values, truth, strict=True)])
            scatter = 1.96 * np.std(errors, axis=0) / promised
            inside = np.mean(np.abs(errors) <= promised)
            text = " ".join(f"{key.rpartition('.')[2]} {v:.2f}" for key, v in zip(found.keys, scatter, strict=True))
            print(
                f"{name}: scatter / promised {text}, mean {np.exp(np.log(scatter).mean()):.2f}; promised intervals hold "
                f"{100 * inside:.1f} % of truths, the fits' own {100 * np.mean(own):.1f} %",
                flush=True,
            )


def limits(names: list[str], count: int = 50) -> None:
    """Play robust designs on robots whose parameters are wrong by up to a factor of 2."""
    for name in names:
        with tempfile.TemporaryDirectory() as place, ExitStack() as stack:
            scenario, within, options = laboratory(name, Path(place))
            began = time.perf_counter()
            motion = design(scenario, within, duration=SECONDS, robust=2, **options).found.motion
            took = time.perf_counter() - began
            plant = searcher(scenario, within, options, stack).plant
            uses = []
            for number in range(count):
                plant.robots = [altered(plant.layout, np.random.default_rng([77, number]))]
                outcome = plant.under({}).play(motion, 1)
                uses.append(np.inf if outcome is None else float(outcome.use.max()))
            said = f"exceeded {np.sum(np.array(uses) > 1.0)} of {count}; largest shares {np.sort(uses)[-5:].round(3)}"
            print(f"{name}: {said}; {took:.0f} s", flush=True)


if __name__ == "__main__":
    what, *rest = sys.argv[1:]
    {"tighter": tighter, "gains": gains, "fits": fits, "limits": limits}[what](rest or [*ROBOTS, "two"])
