"""Every recorded quantity has the same bits from a snapshot, compiled or not, and in every process."""

import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

import asrsim
from asrsim.simulation.simulation import Simulation
from support.bits import Tape, assert_same, busy_keys
from support.random_runs import random_run
from validation.models import INSTALLED


def busy(folder, engine, *, seed=0, fixed=True):
    run = random_run(seed, fixed=fixed, friction=True, moving=3, duration=0.2)
    return asrsim.make_scenario(run.write(folder), engine=engine, **busy_keys(run))


@pytest.mark.parametrize("engine", INSTALLED)
def test_contacts_continue_from_a_snapshot(tmp_path, engine):
    """Boxes slide on the ground. The contact solver starts from the forces of the last step, which belong to the state."""
    scenario = busy(tmp_path, engine, seed=1)
    boxes = {
        f"box_{i}": {"shape": "box", "size": [0.3, 0.2, 0.1], "mass": 0.5, "position": [3 + 0.02 * i, 0, 0.05 + 0.1 * i]}
        for i in range(4)
    }
    world = asrsim.make_scenario(scenario.robot, duration=0.1, world={"ground": {"friction": 0.2}, "objects": boxes}).world
    scenario = replace(scenario, world=world, gravity=(1.0, 0.5, -9.81))
    tape = Tape()
    with Simulation(scenario, sinks=[tape], record=True, compiled=False) as simulation:
        simulation.advance_to(simulation.last // 2)
        simulation.flush()
        tape.chunks.clear()
        middle = simulation.snapshot()
        first, whole = tape.of(simulation), simulation.samples
        simulation.restore(middle)
        tape.chunks.clear()
        assert_same(first, tape.of(simulation))
        assert_same(whole, simulation.samples)
    assert np.ptp(first.bodies["box_3"][:, 0]) > 1e-3


@pytest.mark.parametrize(
    ("engine", "fixed"),
    [
        ("bullet", True),
        ("mujoco", False),
        # A loop takes seconds to compile, and these two have nearly the same code as those above.
        pytest.param("bullet", False, marks=pytest.mark.slow),
        pytest.param("mujoco", True, marks=pytest.mark.slow),
    ],
)
def test_compiled_has_the_bits_of_plain(tmp_path, engine, fixed):
    pytest.importorskip("numba")
    pytest.importorskip({"bullet": "pybullet"}.get(engine, engine))
    scenario = busy(tmp_path, engine, fixed=fixed)
    found = []
    for compiled in (False, True):
        tape = Tape()
        with Simulation(scenario, sinks=[tape], compiled=compiled) as simulation:
            found.append(tape.of(simulation))
    assert_same(*found)
    assert {"motor_work", "friction_loss", "damping_loss", "energy_residual"} <= found[0].values.keys()


def test_fresh_processes_have_the_same_bits():
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
