"""After any sequence of operations, a simulation equals a fresh one with the operations since the last reset, bit for bit."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest

import asrsim
from asrsim.compiled.compiling import numba_available
from asrsim.samples import concatenate
from asrsim.simulation.prepare import prepare
from asrsim.simulation.prepared import Prepared
from asrsim.simulation.simulation import Simulation
from support.bits import Tape, assert_same, busy_keys
from support.random_runs import RandomRun, random_run
from validation.models import INSTALLED

Numbers = dict[str, dict[str, float]]


@dataclass
class Program:
    """Random operations on one simulation, and what brings a fresh simulation to the same state."""

    prepared: Prepared
    run: RandomRun
    source: np.random.Generator
    compiled: bool
    parameters: Numbers = field(default_factory=dict)
    """Parameters of all resets, which later resets keep."""
    start: dict[str, Any] = field(default_factory=dict)
    done: list[tuple[Any, ...]] = field(default_factory=list)
    """Operations since the last reset: a number of steps, or a reference with its value."""
    kept: list[tuple[Any, ...]] = field(default_factory=list)

    def __post_init__(self):
        self.tape = Tape()
        self.simulation = Simulation(self.prepared, sinks=[self.tape], compiled=self.compiled, record=True)

    def advance(self):
        steps = int(self.source.integers(1, 60))
        self.simulation.advance(steps)
        self.done.append((steps,))

    def set_reference(self):
        drive = self.source.choice(np.array(self.prepared.drives, dtype=object))
        known = (*(drive.mode.references if drive.mode else ()), "external_torque")
        value = None if self.source.random() < 0.2 else float(self.source.uniform(0.01, 0.3))
        given = (drive.name, str(self.source.choice(known)), value)
        self.simulation.set_reference(*given)
        self.done.append(given)

    def look(self):
        self.simulation.observe()
        self.simulation.flush()

    def keep(self):
        self.simulation.flush()
        self.kept.append((self.simulation.snapshot(), list(self.done), list(self.tape.chunks)))

    def go_back(self):
        if self.kept:
            snapshot, done, chunks = self.kept[self.source.integers(len(self.kept))]
            self.done, self.tape.chunks = list(done), list(chunks)
            self.simulation.restore(snapshot)

    def reset(self):
        names, chance = self.simulation.joints, self.source.random
        places = {name: float(self.source.uniform(-0.4, 0.4)) for name in names if chance() < 0.5}
        speeds = {name: float(self.source.uniform(-1.0, 1.0)) for name in names if chance() < 0.5}
        self.start = {"initial": places, "velocities": speeds} if chance() < 0.7 else {}
        parameters = self._other_numbers() if chance() < 0.5 else None
        self.simulation.reset(**self.start, parameters=parameters)
        for place, numbers in (parameters or {}).items():
            self.parameters.setdefault(place, {}).update(numbers)
        self.done, self.kept = [], []
        self.tape.chunks.clear()

    def _other_numbers(self):
        found: Numbers = {}
        for joint in self.run.joints:
            found[joint.name] = {"damping": float(self.source.uniform(0.0, 0.3))}
            if self.source.random() < 0.3:
                found[joint.name]["friction"] = float(self.source.choice([0.0, 0.05, 0.2]))
            found[joint.name] |= {key: value * float(self.source.uniform(0.8, 1.2)) for key, value in joint.parameters.items()}
        heavy = str(self.source.choice([link.name for link in self.prepared.robot.links if link.mass]))
        other = {"mass": float(self.source.uniform(0.5, 3.0))}
        if self.source.random() < 0.5:
            other |= {name: float(self.source.uniform(-0.1, 0.1)) for name in "xyz"}
        return found | {heavy: other}

    def _fresh(self):
        """Scenario with the start of the last reset and the same substeps."""
        scenario, found = self.prepared.scenario, self.prepared.resolution
        moved = replace(
            scenario,
            substeps=found.substeps,
            motor_substeps=found.motor_substeps,
            initial_positions={**scenario.initial_positions, **self.start.get("initial", {})},
            initial_velocities={**scenario.initial_velocities, **self.start.get("velocities", {})},
        )
        return prepare(moved, self.prepared.robot).vary(self.parameters)

    def check(self):
        """Compare with a fresh simulation that advances step by step."""
        self.simulation.flush()
        tape = Tape()
        with Simulation(self._fresh(), sinks=[tape], compiled=self.compiled) as fresh:
            for operation in self.done:
                if len(operation) > 1:
                    fresh.set_reference(*operation)
                    continue
                for _ in range(operation[0]):
                    fresh.advance()
            fresh.flush()
            for name, values in vars(self.simulation.observe()).items():
                np.testing.assert_array_equal(values, vars(fresh.observe())[name], err_msg=name)
            assert len(self.tape.chunks) > 0 or not tape.chunks
            if tape.chunks:
                assert_same(concatenate(self.tape.chunks), concatenate(tape.chunks), moves=False)
                assert_same(self.simulation.samples, concatenate(tape.chunks), moves=False)


OPERATIONS = (
    Program.advance,
    Program.advance,
    Program.set_reference,
    Program.look,
    Program.keep,
    Program.go_back,
    Program.reset,
)


def run_program(folder, engine, seed, *, compiled=False):
    source = np.random.default_rng([seed, 5])
    moving = int(source.integers(1, 5))
    run = random_run(seed, fixed=bool(source.random() < 0.6), friction=True, moving=moving, duration=0.1)
    keys = busy_keys(run) if source.random() < 0.7 else run.keys()
    robot = run.write(folder)
    if source.random() < 0.5:
        robot.write_text(robot.read_text(encoding="utf-8").replace('friction="0"', 'friction="0.1"'), encoding="utf-8")
    program = Program(prepare(asrsim.make_scenario(robot, engine=engine, **keys)), run, source, compiled)
    with program.simulation:
        for index in range(12):
            OPERATIONS[source.integers(len(OPERATIONS))](program)
            if index % 4 == 3:
                program.check()


@pytest.mark.parametrize("seed", [30, 37, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(24))])
@pytest.mark.parametrize("engine", INSTALLED)
def test_random_operations_have_the_bits_of_a_fresh_run(tmp_path, engine, seed):
    compiled = seed < 4 and numba_available()
    run_program(tmp_path, engine, seed, compiled=compiled)


@pytest.mark.parametrize("engine", INSTALLED)
def test_objects_fall_from_their_start_after_each_reset(tmp_path, engine):
    """A reset with other parameters may build another world, in which the ball falls from its start."""
    run = random_run(31, fixed=True, friction=False, moving=2, duration=0.1)
    world = {"objects": {"ball": {"shape": "sphere", "size": 0.05, "mass": 0.1, "position": [3, 3, 3]}}}
    prepared = prepare(asrsim.make_scenario(run.write(tmp_path), engine=engine, **{**run.keys(), "world": world}))
    heavy = next(link.name for link in prepared.robot.links if link.mass)
    with Simulation(prepared, record=True) as simulation:
        simulation.advance(20)
        for parameters in (None, {heavy: {"mass": 2.0}}, {run.joints[0].name: {"friction": 0.1}}):
            simulation.reset(parameters=parameters)
            simulation.advance(50)
            simulation.flush()
            samples = simulation.samples
            fallen = samples.bodies["ball"][:, 2] - 3.0
            np.testing.assert_allclose(fallen, -0.5 * 9.81 * samples.time**2, atol=3e-5)
