"""Fixtures that several tests share: a tiny robot with its scenario, and the command line as a user meets it."""

from __future__ import annotations

import gc
import os
import sys
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, settings

from support.tiny import PENDULUM, SCENARIO, Tiny

# On a busy machine, an example may take long without a fault of the code.
settings.register_profile("any_machine", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("any_machine")


# Without stored bytecode, pytest rewrites every test again, and processes that tests start compile the package again.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

# Several threads of BLAS in each of several processes wait for each other; this can take ten times the time of one thread.
# NumPy reads the number when it is imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

SHARED = Path(__file__).parents[2] / "shared"
LONGEST = ("test_examples.py",)


def pytest_collection_finish() -> None:
    """Exempt the loaded modules from garbage collection, which would otherwise take a twentieth of the tests' time."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(50_000, 20, 100)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark tests that use the fixture `shared`. Start the longest tests first, so that no worker runs them alone at the end."""
    for item in items:
        if "shared" in getattr(item, "fixturenames", ()):
            item.add_marker("shared")
    items.sort(key=lambda item: item.path.name not in LONGEST)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """With `-n auto`, each worker begins with a part of the tests as it stands, and takes from the others at its end: a fixture
    of a module, such as a browser or a fit, is made by one worker instead of by all."""
    from xdist.scheduler import WorkStealingScheduling

    return WorkStealingScheduling(config, log) if config.getoption("dist") == "load" else None


@pytest.fixture(autouse=True)
def _registries(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Remove what a test registers, also by loading plugin files, at the end of the test."""
    from asrsim.actuators import ACTUATORS
    from asrsim.actuators.stages import STAGES
    from asrsim.engines import ENGINES
    from asrsim.exports import PROGRAMS
    from asrsim.identification import CAUSES
    from asrsim.live import TRANSPORTS
    from asrsim.metrics import MEASURES
    from asrsim.plots import FIGURES
    from asrsim.quantities import QUANTITIES
    from asrsim.recordings import READERS
    from asrsim.signals import SIGNALS
    from asrsim.sweeps.samplers import SAMPLERS

    for registry in (ACTUATORS, CAUSES, ENGINES, FIGURES, MEASURES, PROGRAMS, READERS, SAMPLERS, SIGNALS, STAGES, TRANSPORTS):
        monkeypatch.setattr(registry, "_entries", {name: registry.get(name) for name in registry.names()})
    # Stages add the quantities that they log.
    known = dict(QUANTITIES)
    yield
    for name in [*QUANTITIES]:
        if name not in known:
            del QUANTITIES[name]


@pytest.fixture(scope="session")
def shared() -> Path:
    """Folder `shared` beside the project, with real robots and recordings. Without the folder, the test is skipped."""
    if not SHARED.is_dir():
        pytest.skip("there is no folder 'shared' beside the project")
    return SHARED


@pytest.fixture
def tiny(tmp_path: Path) -> Tiny:
    """A pendulum with a step of its equilibrium position."""
    robot, scenario = tmp_path / "pendulum.urdf", tmp_path / "step.yaml"
    robot.write_text(PENDULUM)
    scenario.write_text(SCENARIO)
    return Tiny(tmp_path, robot, scenario)


@dataclass(frozen=True)
class Outcome:
    """Exit code and output of a command."""

    code: int
    out: str
    err: str


Command = Callable[..., Outcome]


@pytest.fixture
def asrsim_command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Command:
    """Function that runs `asrsim` with arguments, in this process, in the folder `tmp_path`."""
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
    """Skip a test that needs PyBullet where PyBullet is not installed."""
    try:
        return (yield)
    except ModuleNotFoundError as error:
        if error.name != "pybullet" or sys.modules.get("pybullet", error) is None:
            raise
        pytest.skip("PyBullet is not installed here")
