"""The compiled loop: the plain one's bits, for every actuator and mode; chosen when it pays, and never needed."""

from __future__ import annotations

import os
from collections import OrderedDict
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from asrsim import compiling
from asrsim.actuators import MODES
from asrsim.actuators.user import load_plugin_file
from asrsim.errors import SimulationError
from asrsim.kernel_cache import cache_file
from asrsim.robot import load_robot
from asrsim.robot.model import Robot
from asrsim.scenario import Scenario
from asrsim.signals import Constant, PulseTrain, Signal, Sinusoid, Step
from asrsim.simulation.core import SECONDS_TO_LOAD
from asrsim.simulation.run import Run, simulate

pytest.importorskip("numba")

LINK = """<link name="l{i}"><inertial><origin xyz="0 0 0.08"/><mass value="0.4"/>
<inertia ixx="2e-3" iyy="2e-3" izz="2e-3" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j{i}" type="revolute"><origin xyz="0 0 0.1"/><parent link="l{before}"/><child link="l{i}"/><axis xyz="{axis}"/>
<limit lower="-3" upper="3" effort="{effort}" velocity="100"/><dynamics damping="{damping}"/></joint>"""
PLUGIN = """<gazebo><plugin name="p{i}" filename="lib{actuator}_plugin.so"><joint>j{i}</joint>
<operation_mode>{mode}</operation_mode><pub_eltau>true</pub_eltau><pub_state>true</pub_state><sub_ext_tau>false</sub_ext_tau>
</plugin></gazebo>"""
PLAIN_PYTHON = """
from asrsim.actuators import Actuator
from asrsim.actuators.base import max_deflection
from asrsim.actuators.parameters import Parameter


TABLE = {"linear": lambda deflection: deflection}


class Tabled(Actuator):
    name = "tabled"
    title = "A spring with a table that only Python can look up"
    source = "this test"
    motors = 1
    parameters = (Parameter(name="k", default=10.0, unit="N m/rad", doc="stiffness"), max_deflection(0.8))

    @staticmethod
    def elastic_torques(q, theta_1, theta_2, parameters):
        return parameters[0] * TABLE["linear"](theta_1 - q), 0.0

    @staticmethod
    def stiffness(q, theta_1, theta_2, parameters):
        return parameters[0]
"""


def make_robot(
    folder: Path, actuators: tuple[str | None, ...], mode: int, damping: float = 0.0, effort: float = 100.0, chain: bool = True
) -> Robot:
    parts = ['<link name="l-1"/>']
    for i, actuator in enumerate(actuators):
        axis = "0 1 0" if i % 2 else "1 0 0"
        parts.append(LINK.format(i=i, before=i - 1 if chain else -1, axis=axis, damping=damping, effort=effort))
        if actuator:
            parts.append(PLUGIN.format(i=i, actuator=actuator, mode=mode))
    path = folder / "robot.urdf"
    path.write_text(f'<robot name="r">{"".join(parts)}</robot>')
    return load_robot(path)


def make_scenario(robot: Robot, mode: int, **changes: object) -> Scenario:
    """Both references move, one of them in jumps that hit steps and miss them; a torque pushes."""
    first: Signal = PulseTrain(high=0.2, width=0.0313, period=0.0713)
    second: Signal = Constant(value=0.3) if MODES[mode].mapped else Sinusoid(amplitude=0.2, frequency=3.0)
    references = dict(zip(MODES[mode].references, (first, second), strict=False))
    scenario = Scenario(
        name="c", robot=Path(robot.path), duration=0.12, substeps=1, motor_substeps=1, references={"*": references},
        external_torques={"j0": Step(at=0.0505, after=0.05)},
    )  # fmt: skip
    return replace(scenario, **changes)  # type: ignore[arg-type]


def both(robot: Robot, scenario: Scenario) -> tuple[Run, Run]:
    plain, fast = (simulate(replace(scenario, compiled=compiled), robot) for compiled in (False, True))
    return plain, fast


def assert_equal(plain: Run, fast: Run) -> None:
    assert plain.samples is not None
    assert fast.samples is not None
    assert plain.samples.values.keys() == fast.samples.values.keys()
    for name, values in plain.samples.values.items():
        assert np.array_equal(values, fast.samples.values[name], equal_nan=True), name
    assert np.nanmax(np.abs(plain.samples.values["link_velocity"])) > 1e-3, "nothing moved"


@pytest.mark.slow
def test_equal_bits_of_every_actuator_in_every_mode(tmp_path: Path) -> None:
    """All on one robot, a joint each and one without actuator: one kernel to compile."""
    kinds = [(actuator, mode) for actuator in ("sea", "qbmove", "bavs", "awas_ii") for mode in range(7)]
    robot = make_robot(tmp_path, (None, *(actuator for actuator, _ in kinds)), 6, chain=False)
    scenario = make_scenario(robot, 6)
    references = {}
    for i, (actuator, mode) in enumerate(kinds, 1):
        first, *second = MODES[mode].references
        references[f"j{i}"] = {first: PulseTrain(high=0.2, width=0.0313, period=0.0713)}
        if second:
            # An adjuster's unit is m.
            references[f"j{i}"][second[0]] = Constant(value=0.02 if actuator == "awas_ii" else 0.2)
    modes = {f"j{i}": mode for i, (_, mode) in enumerate(kinds, 1)}
    assert_equal(*both(robot, replace(scenario, references=references, modes=modes)))


@pytest.mark.parametrize(("stepping", "mode"), [("leapfrog", 6), ("euler", 3)])
def test_equal_bits_with_damping_limits_and_motor_substeps(tmp_path: Path, mode: int, stepping: str) -> None:
    robot = make_robot(tmp_path, ("qbmove", "sea"), mode, damping=0.05, effort=0.1)
    scenario = make_scenario(robot, mode, motor_substeps=5, stepping=stepping)
    plain, fast = both(robot, scenario)
    assert_equal(plain, fast)
    assert plain.counts.effort.sum() > 0
    assert np.array_equal(plain.counts.effort, fast.counts.effort)


def test_a_law_that_only_python_can_run_stays_plain(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plugin = tmp_path / "tabled.py"
    plugin.write_text(PLAIN_PYTHON)
    load_plugin_file(plugin)
    robot = make_robot(tmp_path, ("tabled",), 6)
    scenario = make_scenario(robot, 6)
    with pytest.raises(SimulationError, match="cannot compile the laws of 'tabled'"):
        simulate(replace(scenario, compiled=True), robot)
    monkeypatch.setattr("asrsim.simulation.core.is_worth_compiling", lambda *_: True)
    run = simulate(scenario, robot)
    assert (run.status, run.compiled) == ("complete", False)
    assert [warning.code for warning in run.warnings] == ["slow-loop"]


def test_a_second_of_twenty_joints_is_worth_compiling_a_tenth_is_not(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Twenty joints take half a second in Python for each 0.25 s of simulated time, as long as loading Numba and the kernel."""
    # The time to load counts as in a fresh process.
    monkeypatch.setattr("asrsim.simulation.core.SECONDS_WHEN_LOADED", SECONDS_TO_LOAD)
    robot = make_robot(tmp_path, ("sea",) * 20, 6)
    runs = [simulate(make_scenario(robot, 6, duration=duration, substeps=4), robot) for duration in (0.1, 1.0)]
    assert [run.compiled for run in runs] == [False, True]


def test_a_long_run_without_numba_warns_of_its_slow_loop(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    robot = make_robot(tmp_path, ("sea",), 6)
    scenario = make_scenario(robot, 6)
    monkeypatch.setattr("asrsim.simulation.core.available", lambda: False)
    monkeypatch.setattr("asrsim.simulation.run.available", lambda: False)
    assert not simulate(scenario, robot).warnings
    monkeypatch.setattr("asrsim.simulation.core.is_worth_compiling", lambda *_: True)
    (warning,) = simulate(scenario, robot).warnings
    assert (warning.code, warning.hint) == ("slow-loop", "pip install numba")
    with pytest.raises(SimulationError, match="Numba is not installed"):
        simulate(replace(scenario, compiled=True), robot)


def test_equal_bits_on_the_bench(tmp_path: Path) -> None:
    robot = make_robot(tmp_path, ("qbmove",), 6)
    motion = {"j0": Sinusoid(amplitude=0.2, frequency=3.0)}
    assert_equal(*both(robot, make_scenario(robot, 6, engine="bench", motion=motion)))


@pytest.mark.parametrize("mode", [1, 4, 6])
def test_equal_bits_in_the_released_order(tmp_path: Path, mode: int) -> None:
    robot = make_robot(tmp_path, ("qbmove", "sea"), mode)
    assert_equal(*both(robot, make_scenario(robot, mode, stepping="toolbox")))


def kernels() -> list[Path]:
    folder = cache_file("0")
    return [] if folder is None else sorted(folder.parent.glob("*.py"))


def test_a_kernel_serves_other_robots_with_the_same_actuators(tmp_path: Path) -> None:
    robot = make_robot(tmp_path, ("sea",), 6)
    scenario = make_scenario(robot, 6, compiled=True)
    simulate(scenario, robot)
    kept = kernels()
    assert kept
    simulate(replace(scenario, parameters={"j0": {"spring_stiffness": 20.0}}), robot)
    simulate(replace(scenario, motor_substeps=3), robot)
    (tmp_path / "other").mkdir()
    other = make_robot(tmp_path / "other", ("sea", None, "sea"), 3, damping=0.1)
    simulate(make_scenario(other, 3, compiled=True), other)
    assert kernels() == kept


def test_a_changed_law_is_compiled_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    robot = make_robot(tmp_path, ("sea",), 3)
    scenario = make_scenario(robot, 3)
    first, _ = both(robot, scenario)
    # A helper of the law, in another file than the law itself.
    monkeypatch.setattr("asrsim.actuators.sea.saturate", lambda value, limit: 0.5 * value)
    second, fast = both(robot, scenario)
    assert_equal(second, fast)
    assert not np.array_equal(first.samples.values["link_position"], second.samples.values["link_position"])  # type: ignore[union-attr]


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="owners and permissions of files")
@pytest.mark.parametrize("fault", ["folder of others", "writable folder", "linked folder", "linked file", "writable file"])
def test_code_that_other_users_can_write_is_not_loaded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fault: str) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    kept = cache_file("0")
    assert kept is not None
    code = kept.parent / "__pycache__" / "kernel_0.step.nbi"
    code.touch(mode=0o600)
    assert cache_file("0") == kept
    if fault == "folder of others":
        monkeypatch.setattr(os, "geteuid", lambda: os.getuid() + 1)
    elif fault == "linked folder":
        kept.parent.rename(tmp_path / "elsewhere")
        kept.parent.symlink_to(tmp_path / "elsewhere")
    elif fault == "linked file":
        code.rename(tmp_path / "elsewhere")
        code.symlink_to(tmp_path / "elsewhere")
    else:
        (code if fault == "writable file" else code.parent).chmod(0o777)
    with pytest.warns(RuntimeWarning, match="other users may have changed"):
        assert cache_file("0") is None


def doubled(value: float) -> float:
    return 2.0 * value


def test_a_damaged_cache_is_done_without(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("numba")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    assert compiling.compile_function(doubled, (1.0,))(3.0) == 6.0
    kept = [path for path in Path(tmp_path / "cache").rglob("*") if path.suffix in (".nbi", ".nbc")]
    assert kept
    for path in kept:
        path.write_bytes(b"damaged")
    # Another process would find it so; this one holds what it has loaded.
    monkeypatch.setattr(compiling, "_loaded", OrderedDict())
    assert compiling.compile_function(doubled, (1.0,))(3.0) == 6.0
