"""Kernels kept by two processes and loaded by a third: each runs its own robot's law."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections import OrderedDict
from pathlib import Path

import numpy as np
import pytest

from asrsim import compiling
from support.tiny import PENDULUM

PLUGIN = """
from asrsim.actuators import Actuator
from asrsim.actuators.base import max_deflection, saturate
from asrsim.actuators.parameters import Parameter


class Own(Actuator):
    name = "own"
    title = "own"
    source = "this test"
    motors = 1
    parameters = (Parameter(name="k", default=10.0, unit="N m/rad", doc="stiffness"), max_deflection(0.8))

    @staticmethod
    def elastic_torques(q, theta_1, theta_2, parameters):
        return {factor} * parameters[0] * saturate(theta_1 - q, parameters[1]), 0.0

    @staticmethod
    def stiffness(q, theta_1, theta_2, parameters):
        return {factor} * parameters[0]
"""
RUNNER = """
import json, sys
from asrsim.actuators.user import load_plugin_file
import asrsim
from asrsim.simulation.run import simulate
found = []
for robot, plugin, motor_substeps, compiled in json.loads(sys.argv[1]):
    keys = {}
    if plugin:
        load_plugin_file(plugin)
        keys["actuators"] = {"elbow": {"type": "own", "mode": 5, "parameters": {"motor_1_friction_torque": 0.1}}}
    result = simulate(asrsim.make_scenario(
        robot, duration=0.2, modes=5, motor_substeps=motor_substeps, substeps=1, compiled=compiled,
        references={"elbow": {"reference_1": {"sinusoid": {"amplitude": 0.5, "frequency": 3}}}}, **keys,
    ))
    assert result.compiled == compiled
    found.append(result.samples.values["link_position"][:, 0].tolist())
print(json.dumps(found))
"""
Job = tuple[str, str, int, bool]


def in_a_process(cache: Path, *jobs: Job) -> np.ndarray:
    """Positions (jobs, n) of runs in a process of their own."""
    done = subprocess.run(
        [sys.executable, "-c", RUNNER, json.dumps(jobs)], env=os.environ | {"XDG_CACHE_HOME": str(cache)}, capture_output=True,
        text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return np.array(json.loads(done.stdout))


@pytest.mark.slow
def test_three_processes_and_one_cache(tmp_path: Path) -> None:
    """Two robots that differ in the number of motor substeps, and two laws of one name: four kernels of four processes."""
    pytest.importorskip("numba")
    robot = tmp_path / "robot.urdf"
    robot.write_text(PENDULUM.replace("<spring_k>10</spring_k>", ""), encoding="utf-8")
    plain = tmp_path / "plain.urdf"
    plain.write_text(robot.read_text()[: robot.read_text().index("<gazebo>")] + "</robot>", encoding="utf-8")
    jobs: list[Job] = [(str(robot), "", substeps, True) for substeps in (3, 5)]
    for name, factor in (("soft", 1.0), ("stiff", 4.0)):
        plugin = tmp_path / f"{name}.py"
        plugin.write_text(PLUGIN.format(factor=factor), encoding="utf-8")
        jobs.append((str(plain), str(plugin), 3, True))
    cache = tmp_path / "cache"
    for job in jobs:
        in_a_process(cache, job)
    kernels = len(list(cache.rglob("*.nbc")))
    assert kernels >= len(jobs)
    for pair in (jobs[:2], jobs[1::-1]):
        loaded = in_a_process(cache, *pair)
        exact = in_a_process(cache, *((*job[:3], False) for job in pair))
        np.testing.assert_array_equal(loaded, exact)
        assert np.abs(loaded[0] - loaded[1]).max() > 1e-6, "the two differ"
    # A name stands for one law in a process: each is loaded beside another robot's kernel.
    for job in jobs[2:]:
        loaded = in_a_process(cache, jobs[0], job)
        exact = in_a_process(cache, (*jobs[0][:3], False), (*job[:3], False))
        np.testing.assert_array_equal(loaded, exact)
    assert len(list(cache.rglob("*.nbc"))) == kernels, "all came from the cache"


def test_the_names_of_a_kernel_tell_what_it_does(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Without compiling: the functions of two kernels that differ in one constant deep inside share no name."""
    numba = pytest.importorskip("numba")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    names: list[set[str]] = []

    class Dispatcher:
        signatures = ((),)

        def __init__(self, function: object) -> None:
            self.overloads = {(): self}
            self.entry_point = function

    def njit(*given: object, **options: object) -> object:
        def note(function: object) -> object:
            names[-1].add(str(function.__qualname__))  # type: ignore[attr-defined]
            return Dispatcher(function)

        if given and callable(given[0]) and not isinstance(given[0], tuple):
            names[-1].add(str(given[0].__qualname__))  # type: ignore[attr-defined]
            return given[0]
        return note

    monkeypatch.setattr(numba, "njit", njit)

    def make(constant: float) -> object:
        def inner(x: float) -> float:
            return x * constant

        return inner

    def outer(x: float) -> float:
        return bound(x)  # type: ignore[name-defined]  # noqa: F821

    for constant in (2.0, 3.0, 2.0):
        names.append(set())
        monkeypatch.setattr(compiling, "_loaded", OrderedDict())
        compiling.compile_function(outer, (1.0,), names={"bound": make(constant)})
    assert len(names[0]) == 2, "the function and what it calls"
    assert not names[0] & names[1]
    assert names[0] == names[2]
