"""Compiled loop: equal to the plain loop bit for bit, used when it saves time, and never required."""

import os
import shutil
import subprocess
import sys
from collections import OrderedDict
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from asrsim.actuators import ACTUATORS, MODES, Actuator
from asrsim.actuators.parameters import Parameter
from asrsim.compiled import compiling
from asrsim.compiled.kernel_cache import cache_file
from asrsim.errors import SimulationError
from asrsim.scenario import Scenario
from asrsim.scenario.surroundings import World
from asrsim.signals import Constant, PulseTrain, Sinusoid, Step
from asrsim.simulation import native
from asrsim.simulation.core import SECONDS_TO_LOAD
from asrsim.simulation.run import simulate
from validation.models import Body, chain

pytest.importorskip("numba")

PULSES = PulseTrain(high=0.2, width=0.0313, period=0.0713)
"""Jumps on steps and between steps."""


def arm(*actuators, mass=0.4, effort=100.0, damping=0.0):
    """Upright chain with one actuator in each joint."""
    limits = f'<limit lower="-3" upper="3" effort="{effort!r}" velocity="100"/>'
    link = Body(mass=mass, reach=-0.08, inertia=5e-3 * mass, length=-0.1, limits=limits, damping=damping)
    return chain(*(replace(link, actuator=name, axis="0 1 0" if i % 2 else "1 0 0") for i, name in enumerate(actuators)))


def make_scenario(robot, mode, **changes):
    """Both references move, one of them in jumps, and an external torque pushes."""
    second = Constant(value=0.3) if MODES[mode].mapped else Sinusoid(amplitude=0.2, frequency=3.0)
    scenario = Scenario(
        name="c",
        robot=robot.path,
        duration=0.12,
        substeps=1,
        motor_substeps=1,
        modes={"*": mode},
        references={"*": dict(zip(MODES[mode].references, (PULSES, second), strict=False))},
        external_torques={"joint_1": Step(at=0.0505, after=0.05)},
    )
    return replace(scenario, **changes)


def both(robot, scenario):
    plain, fast = (simulate(replace(scenario, compiled=compiled), robot) for compiled in (False, True))
    return plain, fast


def assert_equal(plain, fast):
    assert plain.samples is not None
    assert fast.samples is not None
    assert plain.samples.values.keys() == fast.samples.values.keys()
    for name, values in plain.samples.values.items():
        assert np.array_equal(values, fast.samples.values[name], equal_nan=True), name
    assert np.array_equal(plain.counts.effort, fast.counts.effort)
    assert np.nanmax(np.abs(plain.samples.values["link_velocity"])) > 1e-3, "nothing moved"


@pytest.mark.slow
def test_every_actuator_and_mode_has_equal_bits():
    """One robot with all of them, so only one kernel is compiled."""
    kinds = [(actuator, mode) for actuator in ("sea", "qbmove", "bavs", "awas_ii") for mode in range(7)]
    robot, references = arm(None, *(actuator for actuator, _ in kinds), mass=0.01), {}
    for i, (actuator, mode) in enumerate(kinds, 2):
        first, *second = MODES[mode].references
        references[f"joint_{i}"] = {first: PULSES}
        if second:
            # The unit of an adjuster is m.
            references[f"joint_{i}"][second[0]] = Constant(value=0.02 if actuator == "awas_ii" else 0.2)
    modes = {f"joint_{i}": mode for i, (_, mode) in enumerate(kinds, 2)}
    assert_equal(*both(robot, make_scenario(robot, 6, references=references, modes=modes)))


@pytest.mark.parametrize(
    ("mode", "changes"),
    [
        pytest.param(6, {"motor_substeps": 5}, id="motor substeps"),
        pytest.param(3, {"stepping": "euler"}, id="euler"),
        pytest.param(6, {"engine": "mujoco", "world": World(ground=True)}, id="contacts"),
        *(pytest.param(mode, {"stepping": "toolbox"}, id=f"toolbox {mode}") for mode in (1, 4, 6)),
        pytest.param(
            6, {"engine": "bench", "motion": {f"joint_{i}": Sinusoid(amplitude=0.2, frequency=3.0) for i in (1, 2)}}, id="bench"
        ),
    ],
)
def test_damped_joints_with_effort_limits_have_equal_bits(mode, changes):
    robot = arm("qbmove", "sea", effort=0.02, damping=0.05)
    plain, fast = both(robot, make_scenario(robot, mode, **changes))
    assert_equal(plain, fast)
    assert plain.counts.effort.sum() > 0


TABLE = {"linear": lambda deflection: deflection}


class Tabled(Actuator):
    """Spring whose law looks up a dictionary of functions, which Numba cannot compile."""

    name, title, source, motors = "tabled", "a spring with a table", "this test", 1
    parameters = (Parameter(name="k", default=10.0, unit="N m/rad", doc="stiffness"),)

    @staticmethod
    def elastic_torques(q, theta_1, theta_2, parameters):
        return parameters[0] * TABLE["linear"](theta_1 - q), 0.0

    @staticmethod
    def stiffness(q, theta_1, theta_2, parameters):
        return parameters[0]


def test_a_law_that_only_python_can_run_stays_plain(monkeypatch):
    ACTUATORS.add("tabled", Tabled)
    robot = arm("tabled")
    scenario = make_scenario(robot, 6)
    with pytest.raises(SimulationError, match="cannot compile the laws of 'tabled'"):
        simulate(replace(scenario, compiled=True), robot)
    monkeypatch.setattr("asrsim.simulation.core.is_worth_compiling", lambda *_: True)
    run = simulate(scenario, robot)
    assert (run.status, run.compiled) == ("complete", False)
    assert [warning.code for warning in run.warnings] == ["slow-loop"]


def test_long_runs_are_compiled_and_short_runs_are_not(monkeypatch):
    """Twenty joints take half a second in Python for each 0.25 s of simulated time, as long as loading Numba and the kernel."""
    # The time to load counts as in a fresh process.
    monkeypatch.setattr("asrsim.simulation.core.SECONDS_WHEN_LOADED", SECONDS_TO_LOAD)
    robot = arm(*["sea"] * 20, mass=0.01)
    runs = [simulate(make_scenario(robot, 6, duration=duration, substeps=4), robot) for duration in (0.1, 1.0)]
    assert [run.compiled for run in runs] == [False, True]


def test_a_long_run_without_numba_warns_of_its_slow_loop(monkeypatch):
    robot = arm("sea")
    scenario = make_scenario(robot, 6)
    monkeypatch.setattr("asrsim.simulation.core.numba_available", lambda: False)
    monkeypatch.setattr("asrsim.simulation.run.numba_available", lambda: False)
    assert not simulate(scenario, robot).warnings
    monkeypatch.setattr("asrsim.simulation.core.is_worth_compiling", lambda *_: True)
    (warning,) = simulate(scenario, robot).warnings
    assert (warning.code, warning.hint) == ("slow-loop", "pip install numba")
    with pytest.raises(SimulationError, match="Numba is not installed"):
        simulate(replace(scenario, compiled=True), robot)


def test_a_kernel_serves_other_robots_with_the_same_actuators():
    robot, other = arm("sea"), arm("sea", None, "sea", damping=0.1)
    scenario = make_scenario(robot, 6, compiled=True)
    simulate(scenario, robot)
    # Other tests write into the same cache: only what this process has loaded counts.
    kept = set(compiling._loaded)
    assert kept
    simulate(replace(scenario, parameters={"joint_1": {"spring_stiffness": 20.0}}, motor_substeps=3), robot)
    simulate(make_scenario(other, 3, compiled=True), other)
    assert set(compiling._loaded) == kept


def test_joints_share_the_compiled_laws_of_an_actuator(monkeypatch):
    bound, law = [], native.bound_law
    monkeypatch.setattr(native, "bound_law", lambda *arguments: bound.append(arguments) or law(*arguments))
    robot = arm("sea", "qbmove", "sea")
    simulate(make_scenario(robot, 6, compiled=True), robot)
    assert len(bound) == 2


def test_a_changed_law_is_compiled_again(monkeypatch):
    robot = arm("sea")
    scenario = make_scenario(robot, 3)
    first, _ = both(robot, scenario)
    # A helper of the law, in another file than the law itself.
    monkeypatch.setattr("asrsim.actuators.sea.saturate", lambda value, limit: 0.5 * value)
    second, fast = both(robot, scenario)
    assert_equal(second, fast)
    assert not np.array_equal(first.samples.values["link_position"], second.samples.values["link_position"])  # type: ignore[union-attr]


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="owners and permissions of files")
@pytest.mark.parametrize("fault", ["folder of others", "writable folder", "linked folder", "linked file", "writable file"])
def test_code_that_other_users_can_write_is_not_loaded(tmp_path, monkeypatch, fault):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    kept = cache_file("0")
    assert kept is not None
    code = kept.parent / "__pycache__" / "kernel_0.step.nbi"
    code.touch(mode=0o600)
    assert cache_file("0") == kept
    if fault == "folder of others":
        monkeypatch.setattr(os, "geteuid", lambda: os.getuid() + 1)
    elif fault.startswith("linked"):
        real = kept.parent if fault == "linked folder" else code
        real.rename(tmp_path / "elsewhere")
        real.symlink_to(tmp_path / "elsewhere")
    else:
        (code if fault == "writable file" else code.parent).chmod(0o777)
    with pytest.warns(RuntimeWarning, match="other users may have changed"):
        assert cache_file("0") is None


def test_other_processes_load_what_one_has_compiled(tmp_path):
    """The other process has a copy of the cache, into which no test compiles at the same time."""
    robot = arm("sea")
    simulate(make_scenario(robot, 6, compiled=True), robot)
    folder, own = tmp_path / "asrsim" / "kernels", cache_file("0")
    assert own is not None
    shutil.copytree(own.parent, folder)
    kept = sorted(folder.glob("kernel_*.py"))
    script = "import test_core as t; robot = t.arm('sea'); t.simulate(t.make_scenario(robot, 6, compiled=True), robot)"
    path = os.pathsep.join(filter(None, sys.path))
    environment = {**os.environ, "PYTHONPATH": path, "PYTHONHASHSEED": "1", "XDG_CACHE_HOME": str(tmp_path)}
    subprocess.run([sys.executable, "-c", script], cwd=Path(__file__).parent, env=environment, check=True)
    assert sorted(folder.glob("kernel_*.py")) == kept != []


def doubled(value):
    return 2.0 * value


def test_a_damaged_cache_is_compiled_again(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    assert compiling.compile_function(doubled, (1.0,))(3.0) == 6.0
    kept = [path for path in Path(tmp_path / "cache").rglob("*") if path.suffix in (".nbi", ".nbc")]
    assert kept
    for path in kept:
        path.write_bytes(b"damaged")
    # As in another process: this one has already loaded the function.
    monkeypatch.setattr(compiling, "_loaded", OrderedDict())
    assert compiling.compile_function(doubled, (1.0,))(3.0) == 6.0
