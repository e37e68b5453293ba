"""CPU time of fits: an SEA, two joints and a qbMove, 4 s at 1 kHz, alone or in turns with another version of asrsim.

    git worktree add ../asrsim_0.2 fe78cf55
    python benchmarks/identify.py                       CPU time, evaluations and errors of the estimates
    python benchmarks/identify.py ../asrsim_0.2         ratios now / then of medians over --rounds

The recordings are from the integrator of the tests. Times exclude imports and compilation: each process fits twice, and the
second fit counts.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
CASES = ("sea", "two joints", "qbmove")


def write_case(case: str, folder: Path) -> tuple[Path, Path, dict[str, float], list[str]]:
    """Scenario, recording, true values of the free parameters, and ties, of a case."""
    sys.path.insert(0, str(ROOT / "tests"))
    from support.soft_arm import QBMOVE, SEA, command, record

    if case != "two joints":
        nominal, draw = {"sea": SEA, "qbmove": QBMOVE}[case], np.random.default_rng(1)
        true = nominal.scaled(lambda _: math.exp(draw.uniform(-0.25, 0.25)))
        recording = record(true, folder / "a.csv", seed=1, duration=4.0)
        return nominal.write(folder), recording, dict(true.keys), list(true.ties)
    from dataclasses import replace

    draw = np.random.default_rng(2)
    (joint,) = SEA.joints
    nominal = replace(SEA, joints=(joint, joint))
    true = nominal.scaled(lambda _: math.exp(draw.uniform(-0.25, 0.25)))
    step = 1e-3 * np.arange(4001)

    def goals(at: np.ndarray) -> np.ndarray:
        return np.column_stack([command(at, 4.0)[:, 0], -0.8 * command(0.9 * at, 4.0)[:, 0]])

    moved = true.move(step, goals) + 1e-3 * np.random.default_rng(3).normal(size=(4001, 2, 2))
    names = [f"joint_{j}.{name} [rad]" for name in ("reference_1", "link_position", "motor_1_position") for j in (1, 2)]
    table = np.column_stack([step, goals(step), moved[:, :, 0], moved[:, :, 1]])
    np.savetxt(folder / "a.csv", table, delimiter=",", header=",".join(["time [s]", *names]), comments="")
    keys = {
        f"{'link' if name == 'iyy' else 'joint'}_{j}.{name}": value
        for j, numbers in enumerate(true.joints, 1)
        for name, value in numbers.items()
    }
    return nominal.write(folder), folder / "a.csv", keys, []


def fit(case: str) -> dict[str, float]:
    """CPU time of the second of two fits, number of evaluations, and largest error relative to the interval's half width."""
    from asrsim import identify

    with tempfile.TemporaryDirectory() as folder:
        scenario, recording, truth, ties = write_case(case, Path(folder))
        for _ in range(2):
            began = time.process_time()
            result = identify(scenario, [recording], free=list(truth), ties=ties)
            seconds = time.process_time() - began
    off = [abs(one.value - truth[one.key]) / (0.5 * (one.high - one.low)) for one in result.estimates if one.key in truth]
    worst = max((value for value in off if math.isfinite(value)), default=math.nan)
    return {"seconds": seconds, "evaluations": result.evaluations, "fits": bool(result.fits), "worst": worst}


def measured(root: Path, case: str) -> dict[str, float]:
    """Result of `fit` with the asrsim in a folder, in a process of its own."""
    command = [sys.executable, __file__, "--fit", case]
    done = subprocess.run(command, env={**os.environ, "PYTHONPATH": str(root)}, capture_output=True, text=True, check=True)
    found: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return found


def main() -> None:
    """Print a row for each case."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("other", nargs="?", type=Path, help="folder of another version")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--fit", choices=CASES, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.fit:
        print(json.dumps(fit(options.fit)))
        return
    for case in CASES:
        roots = [ROOT] + ([options.other.resolve()] if options.other else [])
        rounds = [[measured(root, case) for root in roots] for _ in range(options.rounds)]
        medians = [statistics.median(one[i]["seconds"] for one in rounds) for i in range(len(roots))]
        text = f"{case:12} {medians[0]:6.2f} s CPU, {rounds[0][0]['evaluations']} evaluations"
        if options.other:
            text += f"; other {medians[1]:6.2f} s, {rounds[0][1]['evaluations']}; ratio {medians[0] / medians[1]:.2f}"
        print(f"{text}; worst error {rounds[0][0]['worst']:.2f} half widths")


if __name__ == "__main__":
    main()
