"""Physics engines: they move the links under joint torques. Springs and motors are computed outside of the engines."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from asrsim.engines.base import ENGINES, Engine, EngineEntry, Model

if TYPE_CHECKING:
    from asrsim.errors import Problem
    from asrsim.robot.model import Robot
    from asrsim.scenario.data import Scenario

Made = tuple[Any, "tuple[Problem, ...]"]


def _bullet(scenario: Scenario, robot: Robot) -> Made:
    from asrsim.engines.bullet import make_bullet

    return make_bullet(scenario, robot)


def _mujoco(scenario: Scenario, robot: Robot) -> Made:
    from asrsim.engines.mujoco import make_mujoco

    return make_mujoco(scenario, robot)


def _bench(scenario: Scenario, robot: Robot) -> Made:
    from asrsim.engines.bench import BenchEngine

    return BenchEngine(scenario, robot), ()


ENGINES.add(
    "bullet",
    EngineEntry(
        make=_bullet, doc="PyBullet, with contacts; the default where it is installed", module="pybullet", faster="mujoco"
    ),
)
ENGINES.add("mujoco", EngineEntry(make=_mujoco, doc="MuJoCo, many times faster; contacts are softer", module="mujoco"))
ENGINES.add("bench", EngineEntry(make=_bench, doc="a test bench: the links' motion is prescribed", prescribed=True))


def default_engine() -> str:
    """Name of the engine for a scenario without an engine: PyBullet if it is installed, else MuJoCo."""
    return "bullet" if ENGINES.get("bullet").available else "mujoco"


__all__ = ["ENGINES", "Engine", "EngineEntry", "Model", "default_engine"]
