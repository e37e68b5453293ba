"""Fixtures that several tests share: a tiny robot with its scenario, and the command line as a user meets it."""

from __future__ import annotations

import gc
import sys
from collections.abc import Callable, Generator
from dataclasses import dataclass
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

# How long an example takes is the machine's affair: a busy one is no fault of the code.
settings.register_profile("any_machine", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("any_machine")

PENDULUM = """<?xml version="1.0"?>
<robot name="pendulum">
  <link name="world"/>
  <joint name="elbow" type="revolute">
    <parent link="world"/>
    <child link="arm"/>
    <axis xyz="0 1 0"/>
    <limit effort="50" velocity="100" lower="-3" upper="3"/>
    <dynamics damping="0.2" friction="0"/>
  </joint>
  <link name="arm">
    <inertial>
      <origin xyz="0 0 -0.1"/>
      <mass value="0.5"/>
      <inertia ixx="1e-3" ixy="0" ixz="0" iyy="1e-3" iyz="0" izz="1e-3"/>
    </inertial>
  </link>
  <gazebo>
    <plugin name="elbow_drive" filename="libsea_plugin.so">
      <joint>elbow</joint>
      <operation_mode>3</operation_mode>
      <pub_eltau>true</pub_eltau>
      <pub_state>true</pub_state>
      <sub_ext_tau>false</sub_ext_tau>
      <spring_k>10</spring_k>
    </plugin>
  </gazebo>
</robot>
"""
"""One joint with an SEA of 10 N m/rad: I = 6e-3 kg m^2, 0.5 kg at 0.1 m, which hangs at 0."""

SCENARIO = """\
robot: pendulum.urdf
duration: 1.5
references:
  elbow:
    equilibrium_position: {step: {at: 0.1, to: 0.5}}
"""

SHARED = Path(__file__).parents[2] / "shared"
LONGEST = ("test_tutorial.py", "test_examples_command.py")


def pytest_collection_finish() -> None:
    """What is loaded by now stays: going through all of it again and again is a twentieth of the tests' time."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(50_000, 20, 100)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Tests that use the fixture `shared` get the mark of that name. The longest tests go first, so that no worker is left
    alone with one of them at the end."""
    for item in items:
        if "shared" in getattr(item, "fixturenames", ()):
            item.add_marker("shared")
    items.sort(key=lambda item: item.path.name not in LONGEST)


@pytest.fixture(autouse=True)
def _registries(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a test registers (plugin files do, in this process) ends with it: no test sees another's actuators."""
    from asrsim.actuators import ACTUATORS
    from asrsim.engines import ENGINES
    from asrsim.live import TRANSPORTS
    from asrsim.metrics import MEASURES
    from asrsim.signals import SIGNALS
    from asrsim.simulation.steppings import STEPPINGS

    for registry in (ACTUATORS, ENGINES, MEASURES, SIGNALS, STEPPINGS, TRANSPORTS):
        monkeypatch.setattr(registry, "_entries", {name: registry.get(name) for name in registry.names()})


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder `shared` beside the project, with real robots and recordings; where it is missing, the test is skipped."""
    if not SHARED.is_dir():
        pytest.skip("there is no folder 'shared' beside the project")
    return SHARED


@dataclass(frozen=True)
class Tiny:
    """A folder with a robot and a scenario."""

    folder: Path
    robot: Path
    scenario: Path


@pytest.fixture
def tiny(tmp_path: Path) -> Tiny:
    """A pendulum with a step of its equilibrium position."""
    robot, scenario = tmp_path / "pendulum.urdf", tmp_path / "step.yaml"
    robot.write_text(PENDULUM)
    scenario.write_text(SCENARIO)
    return Tiny(tmp_path, robot, scenario)


@dataclass(frozen=True)
class Outcome:
    """What a command gave."""

    code: int
    out: str
    err: str


Command = Callable[..., Outcome]


@pytest.fixture
def asrsim_command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Command:
    """Runs `asrsim` with arguments, in this process, from `tmp_path`."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")

    def call(*arguments: object) -> Outcome:
        from asrsim.cli.app import main

        monkeypatch.setattr(sys, "argv", ["asrsim", *map(str, arguments)])
        capsys.readouterr()
        with pytest.raises(SystemExit) as end:
            main()
        captured = capsys.readouterr()
        return Outcome(int(end.value.code or 0), captured.out, captured.err)

    return call


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, object, object]:
    """A test that asks for PyBullet where it has no wheels is skipped."""
    try:
        return (yield)
    except ModuleNotFoundError as error:
        if error.name != "pybullet" or sys.modules.get("pybullet", error) is None:
            raise
        pytest.skip("PyBullet is not installed here")
