"""Tables, pictures and pages hold what they held when somebody last looked at them: every word, limit, colour and number;
and what the functions behind them gave.

`ASRSIM_RECORD=1 python -m pytest tests/test_seen.py` records them anew: read the difference before you keep it.
"""

from __future__ import annotations

import io
import json
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image
from seen import differences, figure_lines, page_lines, picture_lines, steady
from short_lab import ShortLab

pytestmark = pytest.mark.once

EXAMPLES = Path(__file__).parents[1] / "examples"
RECORDED = Path(__file__).parent / "seen"
RICH = """\
robot: arm.urdf
duration: 0.1
log_rate: 500
seed: 3
engine: mujoco
compiled: false
initial: {joint_1: 0.1, joint_2: {position: 0.1, velocity: 0.2, motor_positions: [0.2, 0.0], motor_velocities: [0, 0]}}
references:
  "*": {stiffness_preset: 0.2}
  joint_1: {equilibrium_position: {playback: {file: lab.csv, column: joint_1.reference_1, interpolation: linear}}}
  joint_2: {equilibrium_position: {sum: [{step: {at: 0.01, to: 0.2}}, {sinusoid: {amplitude: 0.1, frequency: 20}}]}}
external_torques: {joint_1: {pulse_train: {high: 0.1, width: 0.01, period: 0.03}}}
wrenches: [{link: link_2, force: [{step: {at: 0.02, to: 1}}, null, 0.1], point: [0.05, 0, 0], frame: link}]
effects:
  commands: {joint_1: {delay: 0.003, rate: 200, quantum: 0.001, noise: 0.001}}
  sensors: {joint_2: {delay: 0.001, noise: 0.0001}}
link_damping: {joint_1: {constant: 0.1, ratio: 0.1, inertia: 0.01}}
world:
  ground: {friction: 0.5, height: -0.02}
  objects:
    ball: {shape: sphere, size: 0.05, mass: 0.1, position: [1, 1, 0.1]}
    crate: {shape: box, size: [0.1, 0.1, 0.1], mass: 0.2, position: [0.4, 0.1, 0.04], colour: [1, 0, 0, 1]}
expect:
  - {joint: joint_1, quantity: link_position, measure: maximum, comparison: <, value: 0.01}
  - {joint: joint_2, quantity: link_position, measure: final, value: 0.1, tolerance: 2, variant: soft}
  - {body: ball, quantity: z, measure: final, value: 0, tolerance: 500}
variants:
  soft: {}
  stiff: {references: {"*": {stiffness_preset: 0.4}}}
"""
TASK = """\
robot: arm.urdf
duration: 0.2
engine: mujoco
compiled: false
task:
  link: link_2
  point: [0.1, 0, 0]
  poses: [{time: 0, position: [0.2, 0.0, 0.0]}, {time: 0.15, position: [0.18, 0.05, 0.0]}]
  joints: [joint_1, joint_2]
  gravity_compensation: true
  motor_droop: true
  preset: 0.3
  tolerance: 1
"""
LEARN = """\
robot: arm.urdf
duration: 0.2
engine: mujoco
compiled: false
references: {"*": {stiffness_preset: 0.3}}
ilc:
  trajectory:
    joint_1: {minimum_jerk: {duration: 0.2, to: 0.1}}
    joint_2: {minimum_jerk: {duration: 0.2, to: 0.1}}
  law: filtered
  gain: 0.5
  filter: {cutoff: 5, order: 2}
  tolerance: 0.0001
  max_iterations: 2
  patience: 2
  transfer: {draws: 2, seed: 1, spread: {mass: 0.05, delay: 0.002, parameters: {spring_k_1: 0.1}}}
"""
CHIRP = """\
robot: arm.urdf
duration: 2
engine: mujoco
compiled: false
modes: 3
references:
  "*": {stiffness_preset: 0.3}
  joint_1: {equilibrium_position: {chirp: {amplitude: 0.1, from: 1, to: 15, duration: 2}}}
"""
FIT = """\
scenario: play.yaml
experiments: [lab.csv]
free: {joint_1.damping: {start: 0.1, low: 0, high: 1}}
compare: [joint_1.link_position]
noise: {joint_1.link_position: 0.001}
hold_out: 0.2
starts: 1
"""
STUDY = """\
scenario: chirp.yaml
set: {duration: 0.1}
over: {link_1.mass: [0.3, 0.4], joint_1.damping: "uniform(0.1, 0.2)"}
samples: 2
signals: [joint_1.link_position]
"""
GRID = """\
scenario: play.yaml
set: {duration: 0.01}
over: {link_1.mass: "0.3:0.4:2", joint_1.damping: "0.1:0.2:3"}
"""
SHARES = """\
scenario: play.yaml
set: {duration: 0.01}
over: {link_1.mass: "uniform(0.3, 0.4)", joint_1.damping: "uniform(0.1, 0.2)"}
design: saltelli
samples: 2
logs: true
"""
PLAY = """\
robot: arm.urdf
duration: 0.1
engine: mujoco
compiled: false
modes: 3
references: {joint_2: {equilibrium_position: 0.1}}
"""


def lab() -> str:
    """A recording of both joints as a laboratory has it."""
    time = np.arange(0.0, 0.1, 0.002)
    columns = {
        "time [s]": time, "joint_1.link_position": 0.1 + 0.3 * time, "joint_2.link_position": 0.1 + 0.8 * np.sin(9 * time),
        "joint_1.reference_1": 0.3 * np.sin(25 * time),
    }  # fmt: skip
    rows = [",".join(columns), *(",".join(f"{value:.6g}" for value in row) for row in zip(*columns.values(), strict=True))]
    return "\n".join(rows) + "\n"


def bench() -> str:
    """A motion of a test bench."""
    rows = [f"{0.001 * i:.3f},{0.1 * np.sin(0.05 * i):.6f},{5 * np.cos(0.05 * i):.6f},0.1" for i in range(60)]
    return "\n".join(["time,joint_1.position,joint_1.velocity,joint_1.reference_1", *rows]) + "\n"


FILES = {
    "rich.yaml": RICH,
    "task.yaml": TASK,
    "learn.yaml": LEARN,
    "chirp.yaml": CHIRP,
    "fit.yaml": FIT,
    "play.yaml": PLAY,
    "study.yaml": STUDY,
    "grid.yaml": GRID,
    "shares.yaml": SHARES,
    "lab.csv": lab(),
    "bench.csv": bench(),
}
SESSIONS: dict[str, tuple[str, ...]] = {
    "check": ("check arm.urdf rich.yaml", "check arm.urdf --json -q", "check plain.urdf", "actuators", "actuators qbmove"),
    "run": ("run rich.yaml -o run --report",),
    "certify": ("run play.yaml -o run --certify --report --no-plot",),
    "picture": ("run rich.yaml -o run --no-plot -q", "render run --frames 2 --size 120", "render run/soft --gif --size 60"),
    "compare": (
        "run rich.yaml -o run --no-plot -q", "plot run --experiment lab.csv -o overlay",
        "plot run/soft --experiment stiff=lab.csv --experiment lab.csv --layout both --start 0.01 --end 0.08 -o both",
    ),
    "frequency": ("run chirp.yaml -o chirp -q", "plot chirp --bode -o bode"),
    "task": ("run task.yaml -o task",),
    "learn": ("ilc learn.yaml -o learn --transfer --processes 1 --keep-logs all",),
    "robot": (
        "ilc learn.yaml -o robot --guess-only", "run robot/guess.yaml -o one --no-plot -q",
        "ilc learn.yaml -o robot --next one/log.mcap", "ilc learn.yaml -o robot --next one/log.mcap --json",
    ),
    "bench": ("bench arm.urdf bench.csv -o bench_out.csv",),
    "identify": ("identify fit.yaml -o fit", "identify fit.yaml --check -o fit_check"),
    "sweep": (
        "sweep study.yaml -o sweep -j 1", "sweep grid.yaml -o grid -j 1 --no-report",
        "sweep shares.yaml -o shares -j 1 --no-report", "sweep shares --run 3 -o again --no-plot -q",
    ),
    "live": ("live rich.yaml --variant soft --on none --speed max --duration 0.02 -o live",),
    "start": (
        "init arm.urdf -o one.yaml --no-schema", "init plain.urdf -a qbmove -o two.yaml --no-schema",
        "init arm.urdf -e lab.csv -o three.yaml --no-schema",
    ),
    "json": (
        "check rich.yaml --json", "run rich.yaml -o run --no-plot --json", "rerun run/soft --json -o again",
        "plot run/soft -o pictures --json", "render run/soft -o film --frames 2 --json",
        "report run --json", "live rich.yaml --variant soft --on none --speed max --duration 0.02 -o live --json",
        "identify fit.yaml --check --json", "sweep grid.yaml -o grid -j 1 --no-report --json",
        "ilc learn.yaml -o learn --json",
    ),
    **{f"figure_{number}": (f"reproduce {number} -o figure --processes 1",) for number in (8, 11, 12, 13, 14, 15)},
}  # fmt: skip
READ = ("*.yaml", "*.html", "*.gif", "*.json", "bench_out.csv", "learned.csv", "metrics.csv", "film*.png")
"""What is read of the files that commands wrote."""


def session(name: str, folder: Path, call: Callable[..., object], monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Everything that the commands of a session show."""
    for file, text in FILES.items():
        (folder / file).write_text(text)
    (folder / "arm.urdf").write_text((EXAMPLES / "urdf" / "dof2_horizontal.urdf").read_text())
    (folder / "plain.urdf").write_text((EXAMPLES / "urdf" / "plain_arm.urdf").read_text())
    shown: list[str] = []
    drawn: list[str] = []
    empty = io.BytesIO()
    Image.new("RGB", (1, 1)).save(empty, "png")

    def savefig(figure: Figure, stream: io.BytesIO, **options: object) -> None:
        drawn.extend(figure_lines(figure))
        stream.write(empty.getvalue())

    monkeypatch.setattr(Figure, "savefig", savefig)
    monkeypatch.setattr("asrsim.reproduce.lab.Lab", ShortLab)
    monkeypatch.setattr("asrsim.reproduce.teaching.DRAWS", 2)
    monkeypatch.setattr("asrsim.reproduce.pictures.FRAMES", 2)
    # Whether processes help depends on how busy the machine is.
    monkeypatch.setattr("asrsim.identification.pool.LONG", np.inf)
    monkeypatch.setattr("asrsim.sweeps.pictures.LINES", 1)
    monkeypatch.setattr("asrsim.sweeps.pictures.MOST", 2)
    for command in SESSIONS[name]:
        before = set(folder.rglob("*"))
        drawn.clear()
        outcome = call(*command.split())
        shown += [f"$ asrsim {command}", *steady(outcome.out + outcome.err, folder), f"exit {outcome.code}", *drawn]
        for path in sorted(set(folder.rglob("*")) - before):
            if any(path.match(pattern) for pattern in READ) and "logs" not in path.parts:
                shown += [f"--- {path.relative_to(folder).as_posix()}", *_file(path, folder)]
    return shown


def _file(path: Path, folder: Path) -> list[str]:
    if path.suffix in (".png", ".gif"):
        return picture_lines(path) if path.stat().st_size > 200 else []
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".html":
        return [line for one in page_lines(text) for line in steady(one, folder)]
    if path.suffix == ".json":
        text = json.dumps(json.loads(text), indent=1)
    lines = steady(text, folder)
    return lines if path.suffix != ".csv" else [*lines[:3], *lines[3::17]]


@pytest.mark.parametrize("name", SESSIONS)
def test_what_users_see(name: str, tmp_path: Path, asrsim_command, monkeypatch: pytest.MonkeyPatch) -> None:
    shown = session(name, tmp_path, asrsim_command, monkeypatch)
    path = RECORDED / f"{name}.txt"
    assert not [line for line in shown if "could not be run" in line or line.startswith("Usage:")]
    if "ASRSIM_RECORD" in os.environ:
        path.write_text("\n".join(shown) + "\n", encoding="utf-8")
    found = differences(shown, path.read_text(encoding="utf-8").splitlines())
    assert not found, "\n".join(found[:20])
