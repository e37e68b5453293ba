"""The engine of a scenario."""

from __future__ import annotations

import inspect

from asrsim.engines import ENGINES
from asrsim.engines.base import MEMBERS, Engine
from asrsim.errors import Problem, SimulationError
from asrsim.registry import result_fault
from asrsim.robot.dynamics import RobotModel
from asrsim.robot.model import Robot
from asrsim.scenario.data import Scenario

WARP = "mujoco_warp"
"""Name of the engine of worlds on a device of Warp."""


def make_engine(scenario: Scenario, robot: Robot) -> tuple[Engine, tuple[Problem, ...]]:
    """The scenario's engine, and its warnings. Raises SimulationError if the engine is not installed or ignores wrenches,
    and InputError if a user's engine is incomplete."""
    entry = ENGINES.get(scenario.engine)
    if not entry.available:
        installed = ", ".join(name for name in ENGINES.names() if ENGINES.get(name).available)
        message = (
            f"the engine '{scenario.engine}' needs '{entry.module}', which is not installed; installed engines: {installed}"
        )
        raise SimulationError(message)
    made = entry.make(scenario, robot)
    if not isinstance(made, tuple) or len(made) != 2:
        message = f"`make` of the engine '{scenario.engine}' must return an engine and a tuple of warnings; it returns {made!r}"
        raise result_fault(entry.make, message)
    engine, warnings = made
    for name in MEMBERS:
        if inspect.getattr_static(engine, name, MEMBERS) is MEMBERS:
            message = f"the engine '{scenario.engine}' must have the member `{name}`; {type(engine).__name__} lacks it"
            if type(engine).__mro__[1] is not object and "__init__" in vars(type(engine)):
                message += (
                    ". If a base class sets this member, `__init__` of the engine must call super().__init__(scenario, robot)"
                )
            raise result_fault(entry.make, message)
    if scenario.wrenches and not engine.takes_wrenches:
        engine.close()
        raise SimulationError(
            f"the engine '{scenario.engine}' takes no wrenches: the wrenches of the scenario would have no effect"
        )
    return engine, warnings


def model_of_engine(engine: Engine, model: RobotModel, scenario: Scenario, robot: Robot) -> RobotModel:
    """Model with the engine's own equations, if it declares them; else `model`, with the masses of the robot's file."""
    if ENGINES.get(scenario.engine).masses_of_file:
        return model
    # Imported only here: the engines of asrsim do not need it.
    from asrsim.engines.equations import EquationEngine, EquationModel

    return EquationModel(engine, scenario, robot) if isinstance(engine, EquationEngine) else model
