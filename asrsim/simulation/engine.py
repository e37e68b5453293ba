"""The engine of a scenario."""

from __future__ import annotations

from asrsim.engines import ENGINES
from asrsim.engines.base import Engine
from asrsim.errors import Problem, SimulationError
from asrsim.robot.model import Robot
from asrsim.scenario.data import Scenario

WARP = "mujoco_warp"
"""Name of the engine of worlds on a device of Warp."""


def make_engine(scenario: Scenario, robot: Robot) -> tuple[Engine, tuple[Problem, ...]]:
    """The scenario's engine, and its warnings. Raises SimulationError if the engine is not installed or ignores wrenches."""
    entry = ENGINES.get(scenario.engine)
    if not entry.available:
        installed = ", ".join(name for name in ENGINES.names() if ENGINES.get(name).available)
        message = f"the engine '{scenario.engine}' needs '{entry.module}', which is not installed; here are: {installed}"
        raise SimulationError(message)
    engine, warnings = entry.make(scenario, robot)
    if scenario.wrenches and not engine.takes_wrenches:
        engine.close()
        raise SimulationError(f"the engine '{scenario.engine}' takes no wrenches: the scenario's would have no effect")
    return engine, warnings
