"""What a twin finds at several rates of measurement and kinds of noise: the table of docs/twin.md.

An independent simulator (tests/support/soft_arm.py) moves; springs of the twin are 10 % off, its friction 50 %, its damping
20 %.
"""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import asrsim

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from support.soft_arm import QBMOVE, SEA

SECONDS, PUSH, FIRST, EVERY = 16.0, 0.15, 6.0, 1.2
COUNTS = 4096
"""Steps of the encoder in a turn."""


def motion(time: np.ndarray) -> np.ndarray:
    """Goal of the link, rad."""
    generator = np.random.default_rng(1)
    waves = zip(generator.uniform(0.2, 2.5, 8), generator.uniform(0.0, 6.0, 8), strict=True)
    return sum(0.16 * np.sin(2.0 * np.pi * rate * time + phase) for rate, phase in waves) * np.minimum(time / 0.5, 1.0)


def wrong(joint):
    """The twin's joint."""
    factors = {"spring_k": 1.1, "spring_stiffness": 1.1, "friction": 0.5, "damping": 0.8}
    return joint.scaled(lambda name: next((factor for part, factor in factors.items() if part in name), 1.0))


def row(joint, rate: int, noise: str) -> str:
    """Row of the table."""
    time, step, starts = np.arange(round(1e3 * SECONDS) + 1) * 1e-3, 1e-4, np.arange(FIRST, SECONDS - 1.0, EVERY)
    outer = np.zeros((round(SECONDS / step), 1))
    for number, at in enumerate(starts):
        outer[round(at / step) : round((at + PUSH) / step)] = (-1.0) ** number
    robot = joint.move(time, lambda at: motion(at)[:, None], outer=outer, step=step)[:, 0, 0][:: 1000 // rate]
    if noise == "encoder":
        measured = np.round(robot * COUNTS / (2.0 * np.pi)) * 2.0 * np.pi / COUNTS
    else:
        measured = robot + 1e-3 * np.random.default_rng(2).normal(size=len(robot))
    goals = motion(time)[:: 1000 // rate]
    preset = {"stiffness_preset": 0.3} if joint.motors == 2 else {}
    with TemporaryDirectory() as folder:
        scenario = wrong(joint).write(Path(folder))
        with asrsim.Twin(scenario, overrides=[f"step={1.0 / rate}", "duration=60"]) as twin:
            steps = [
                twin.step([q], {"joint_1": {"equilibrium_position": g, **preset}}) for q, g in zip(measured, goals, strict=True)
            ]
    at = np.array([one.time for one in steps])
    alarm = np.array([one.alarm[0] for one in steps])
    delays = [at[(at >= begin) & (at < begin + PUSH + 0.05) & alarm] - begin for begin in starts]
    found = [1e3 * own[0] for own in delays if len(own)]
    near = np.zeros(len(at), dtype=bool)
    for begin in starts:
        near |= (at >= begin) & (at < begin + PUSH + 0.4)
    false = int(np.diff((alarm & ~near).astype(int)).clip(0).sum())
    free = ~near & (at > FIRST - 2.0)
    threshold = np.median([one.threshold[0] for one, own in zip(steps, free, strict=True) if own])
    when = f"{np.median(found):.0f} ms" if found else "-"
    return f"| {joint.motors} | {rate} | {noise} | {threshold:.2f} | {len(found)} of {len(starts)} | {when} | {false} |"


if __name__ == "__main__":
    print("| motors | rate, Hz | noise | threshold, N m | pushes found | after | false alarms |")
    for joint in (SEA, QBMOVE):
        for rate in (250, 500, 1000):
            for noise in ("1 mrad", "encoder"):
                print(row(joint, rate, noise), flush=True)
