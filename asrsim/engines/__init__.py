"""Physics engines: they move the links under joint torques. Springs and motors are computed outside of the engines."""

from __future__ import annotations

from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING, Any

from asrsim.engines.base import ENGINES, Engine, EngineEntry

if TYPE_CHECKING:
    from asrsim.errors import Problem
    from asrsim.robot.model import Robot
    from asrsim.scenario.data import Scenario


def _make(name: str, scenario: Scenario, robot: Robot) -> tuple[Any, tuple[Problem, ...]]:
    """Engine and warnings by the function `make` of the engine's module, which is imported only now."""
    made: tuple[Any, tuple[Problem, ...]] = import_module(f"asrsim.engines.{name}").make(scenario, robot)
    return made


ENGINES.add(
    "bullet",
    EngineEntry(
        make=partial(_make, "bullet"),
        doc="PyBullet, with contacts; the default where it is installed",
        module="pybullet",
        faster="mujoco",
    ),
)
ENGINES.add(
    "mujoco", EngineEntry(make=partial(_make, "mujoco"), doc="MuJoCo, many times faster; contacts are softer", module="mujoco")
)
ENGINES.add(
    "bench", EngineEntry(make=partial(_make, "bench"), doc="a test bench: the links' motion is prescribed", prescribed=True)
)


def default_engine() -> str:
    """Name of the engine for a scenario without an engine: PyBullet if it is installed, else MuJoCo."""
    return "bullet" if ENGINES.get("bullet").available else "mujoco"


__all__ = ["ENGINES", "Engine", "EngineEntry", "default_engine"]
