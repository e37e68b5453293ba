"""The engine of a scenario."""

from __future__ import annotations

import inspect

from asrsim.engines import ENGINES
from asrsim.engines.base import MEMBERS, Engine
from asrsim.errors import Problem, SimulationError, listed
from asrsim.registry import result_fault
from asrsim.robot.dynamics import RobotModel
from asrsim.robot.model import Robot
from asrsim.scenario.data import Scenario

WARP = "mujoco_warp"
"""Name of the engine of worlds on a device of Warp."""


def make_engine(scenario: Scenario, robot: Robot) -> tuple[Engine, tuple[Problem, ...]]:
    """The scenario's engine, and its warnings. Raises SimulationError if the engine is not installed, or ignores wrenches or
    weightless links, and InputError if a user's engine is incomplete or its equations contradict each other."""
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
    try:
        _check_fit(engine, scenario, robot)
    except BaseException:
        engine.close()
        raise
    return engine, warnings


def _check_fit(engine: Engine, scenario: Scenario, robot: Robot) -> None:
    """Raise SimulationError if the engine ignores wrenches or weightless links, and RobotError if a user's equations are
    wrong."""
    # Import this only here, since `import asrsim` must not import engines.
    from asrsim.engines.equations import EquationEngine

    if scenario.wrenches and not engine.takes_wrenches:
        raise SimulationError(
            f"the engine '{scenario.engine}' takes no wrenches: the wrenches of the scenario would have no effect"
        )
    weightless = [link.name for link in robot.links if link.weightless[0]] if any(scenario.gravity) else []
    # Engines may lack the member `takes_weightless`. Such an engine does not accept links on which gravity does not act.
    if weightless and not getattr(engine, "takes_weightless", False):
        raise SimulationError(
            f"the engine '{scenario.engine}' does not state `takes_weightless = True`, so gravity would act on the weightless "
            f"links {listed(weightless, 5)} (`weightless` in the scenario, <turnGravityOff> or <gravity> in the robot's file). "
            "docs/architecture.md, 'An engine of your own', shows what an engine does with them"
        )
    if isinstance(engine, EquationEngine):
        engine.test(scenario)


def model_of_engine(engine: Engine, model: RobotModel, scenario: Scenario, robot: Robot) -> RobotModel:
    """Model with the engine's own equations, if it declares them; else `model`, with the masses of the robot's file."""
    if ENGINES.get(scenario.engine).masses_of_file:
        return model
    # Import this only here, since the engines of asrsim do not need it.
    from asrsim.engines.equations import EquationEngine, EquationModel

    return EquationModel(engine, scenario, robot) if isinstance(engine, EquationEngine) else model
