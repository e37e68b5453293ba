"""The same bits in every recorded quantity: however time is cut, from a snapshot, after a reset, compiled or not."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import asrsim
from asrsim.samples import Samples
from asrsim.scenario import Scenario
from asrsim.simulation.simulation import Simulation
from support.random_runs import random_run
from support.tape import Tape, assert_same
from validation.models import INSTALLED

WHOLE = (8192,)


def busy(folder: Path, engine: str, *, seed: int = 0, fixed: bool = True) -> Scenario:
    """Everything that acts at once: sensors, wrenches, damping by stiffness, jumps, friction of motors, limits of effort."""
    run = random_run(seed, fixed=fixed, friction=True, moving=3, duration=0.2)
    keys = run.keys()
    keys["effects"] = {"sensors": {"*": {"delay": 0.003, "rate": 250, "noise": 1e-4, "quantum": 1e-5}}}
    last = re.findall(r'<child link="(\w+)"', run.urdf)[-1]
    force = [{"step": {"at": 0.0503, "to": 1.0}}, 0, {"sinusoid": {"amplitude": 1.0, "frequency": 3.0}}]
    keys["wrenches"] = [{"link": last, "force": force, "torque": [0, 0.1, 0]}]
    keys["link_damping"] = {j.name: {"constant": 0.05, "ratio": 0.1, "inertia": 0.02} for j in run.joints if j.actuator}
    return asrsim.make_scenario(run.write(folder), engine=engine, **keys)


def record(scenario: Scenario, sizes: Sequence[int], *, compiled: bool = False, flushed: bool = False) -> Samples:
    """sizes: of the blocks that are advanced by, in turns; flushed: after each."""
    tape = Tape()
    with Simulation(scenario, sinks=[tape], compiled=compiled) as simulation:
        total, turn = simulation.total, 0
        while simulation.substep < total:
            simulation.advance_to(min(total, simulation.substep + sizes[turn % len(sizes)]))
            turn += 1
            if flushed:
                simulation.flush()
        return tape.of(simulation)


@pytest.mark.parametrize("fixed", [True, False])
@pytest.mark.parametrize("engine", INSTALLED)
def test_results_do_not_depend_on_the_steps_per_call(tmp_path: Path, engine: str, fixed: bool) -> None:
    scenario = busy(tmp_path, engine, fixed=fixed)
    whole = record(scenario, WHOLE)
    assert {"motor_work", "friction_loss", "damping_loss", "energy_residual"} <= whole.values.keys()
    assert_same(whole, record(scenario, (1,)))
    assert_same(whole, record(scenario, (10,)))
    assert_same(whole, record(scenario, (1, 3, 2, 64, 7), flushed=True))


@pytest.mark.parametrize("engine", INSTALLED)
def test_contacts_continue_from_a_snapshot(tmp_path: Path, engine: str) -> None:
    """A pile that slides on the ground: the solver's start is the last step's end."""
    scenario = busy(tmp_path, engine, seed=1)
    boxes = {
        f"box_{i}": {"shape": "box", "size": [0.3, 0.2, 0.1], "mass": 0.5, "position": [3 + 0.02 * i, 0, 0.05 + 0.1 * i]}
        for i in range(4)
    }
    world = asrsim.make_scenario(scenario.robot, duration=0.1, world={"ground": {"friction": 0.2}, "objects": boxes}).world
    scenario = replace(scenario, world=world, gravity=(1.0, 0.5, -9.81))
    tape = Tape()
    with Simulation(scenario, sinks=[tape], compiled=False) as simulation:
        simulation.advance_to(simulation.last // 2)
        simulation.flush()
        tape.chunks.clear()
        middle = simulation.snapshot()
        first = tape.of(simulation)
        simulation.restore(middle)
        tape.chunks.clear()
        assert_same(first, tape.of(simulation))
    assert np.ptp(first.bodies["box_3"][:, 0]) > 1e-3


@pytest.mark.parametrize(
    ("engine", "fixed"),
    [
        ("bullet", True),
        ("mujoco", False),
        # A loop takes seconds to compile, and these two share nearly all of it with those above.
        pytest.param("bullet", False, marks=pytest.mark.slow),
        pytest.param("mujoco", True, marks=pytest.mark.slow),
    ],
)
def test_compiled_has_the_bits_of_plain(tmp_path: Path, engine: str, fixed: bool) -> None:
    pytest.importorskip("numba")
    pytest.importorskip({"bullet": "pybullet"}.get(engine, engine))
    scenario = busy(tmp_path, engine, fixed=fixed)
    plain = record(scenario, WHOLE)
    assert_same(plain, record(scenario, WHOLE, compiled=True))
    assert_same(plain, record(scenario, (1, 3, 2, 64, 7), compiled=True, flushed=True))


def test_fresh_processes_have_the_same_bits() -> None:
    code = (
        "from validation.models import LOAD, chain, run; from dataclasses import replace\n"
        "arm = chain(*[replace(LOAD, actuator='qbmove', friction=0.01)] * 2)\n"
        "found = run(arm, mode=6, duration=0.1, references={'equilibrium_position': 0.3, 'stiffness_preset': 0.1})\n"
        "print(found.samples.values['link_position'][-1].tobytes().hex())"
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    outputs = {
        subprocess.check_output([sys.executable, "-c", code], text=True, env={**environment, "PYTHONHASHSEED": seed})
        for seed in ("1", "2")
    }
    assert len(outputs) == 1
