"""Preparation of a scenario: examine it, build its actuators and its engine, determine the number of substeps."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from asrsim.engines import ENGINES, Engine
from asrsim.errors import InputError, Problem
from asrsim.plugins import blame_plugins
from asrsim.robot.model import Robot
from asrsim.scenario.data import Scenario
from asrsim.scenario.overrides import Overrides
from asrsim.scenario.signal_checks import undersampled
from asrsim.simulation.description import describe
from asrsim.simulation.drives import ranges_of, with_sensors
from asrsim.simulation.engine import WARP, make_engine, model_of_engine
from asrsim.simulation.equilibrium import at_equilibrium
from asrsim.simulation.examine import Plan, examine
from asrsim.simulation.inertia import masses_at_start
from asrsim.simulation.prepared import Prepared
from asrsim.simulation.resonance import resonance_doubts
from asrsim.simulation.substeps import resolution_of

ScenarioLike = str | Path | Scenario | Plan | Prepared
"""Input of a simulation: a file, scenario, plan or prepared scenario. Files and scenarios are examined. All inputs except
prepared scenarios are built.
"""


def prepare(
    scenario: ScenarioLike,
    robot: Robot | str | Path | None = None,
    *,
    variant: str | None = None,
    overrides: Overrides = (),
    plugins: Sequence[str | Path] = (),
    settable: bool = False,
) -> Prepared:
    """Examine a scenario, and build its actuators and engine; arguments as for `examine` and `build`. A prepared scenario is
    returned as it is. Raises RobotError, ScenarioError or UnresolvedSpringError.
    """
    if isinstance(scenario, Prepared):
        return scenario
    return build(examine(scenario, robot, variant=variant, overrides=overrides, plugins=plugins), settable=settable)


def prepare_worlds(
    scenario: ScenarioLike,
    *,
    engine: str | None = None,
    variant: str | None = None,
    overrides: Overrides = (),
    plugins: Sequence[str | Path] = (),
    settable: bool = False,
) -> Prepared:
    """Prepare a scenario for many worlds or a twin; other arguments and errors as for `prepare`. If neither caller nor scenario
    states an engine, MuJoCo is used, since it steps about ten times faster than PyBullet. engine: name of the engine; with
    `WARP`, the model of the links comes from MuJoCo. Raises InputError if the scenario is prepared for another engine.
    """
    if isinstance(scenario, Prepared):
        if engine not in (None, WARP, scenario.scenario.engine):
            message = f"the scenario is already prepared for the engine '{scenario.scenario.engine}'"
            raise InputError(message, key="engine", value=engine, code="engine")
        return scenario
    plan = examine(scenario, variant=variant, overrides=overrides, plugins=plugins)
    if engine == WARP or (engine is None and not plan.scenario.states_engine and ENGINES.get("mujoco").available):
        engine = "mujoco"
    return build(plan if engine in (None, plan.scenario.engine) else plan.on(engine=engine), settable=settable)


@blame_plugins()
def build(plan: Plan, *, settable: bool = False) -> Prepared:
    """Build the actuators and the engine of an examined scenario. Raises UnresolvedSpringError, and errors of the engine.

    The number of substeps is chosen for the scenario's references and for all values in its `reference_ranges`. settable:
    whether callers may set all references within the limits of the robot; the scenario then gets these limits as
    `reference_ranges`.
    """
    engine, warnings = make_engine(plan.scenario, plan.robot)
    try:
        return _built(plan, engine, warnings, settable=settable)
    except BaseException:
        engine.close()
        raise


def _built(plan: Plan, engine: Engine, warnings: tuple[Problem, ...], *, settable: bool) -> Prepared:
    """The plan, built with this engine and its warnings; see `build`."""
    planned, drives, model, masses = plan.scenario, plan.drives, plan.model, None
    if model is not None:
        model = model_of_engine(engine, model, planned, plan.robot)
    if settable:
        # Leave out infinite ranges. Only torques of joints without limits have them, and the number of substeps does not depend
        # on these torques.
        ranges = {
            joint: {name: pair for name, pair in own.items() if all(map(math.isfinite, pair))}
            for joint, own in ranges_of(planned, drives).items()
        }
        planned = replace(planned, reference_ranges=ranges)
    if planned.task is not None or any(planned.inverse_dynamics.values()):
        # Import this only here, since most short runs do not need it.
        from asrsim.kinematics import plan_references

        planned = plan_references(planned, plan.robot, model)
    if model is not None:
        if planned.initial_equilibrium:
            drives = at_equilibrium(planned, drives, model)
        masses = masses_at_start(drives, model)
    resolution = resolution_of(planned, drives, model)
    drives = with_sensors(drives, planned, planned.step / resolution.substeps)
    return Prepared(
        plan=plan,
        scenario=planned,
        robot=plan.robot,
        stepping=plan.stepping,
        drives=drives,
        resolution=resolution,
        info=describe(planned, plan, drives, resolution, engine.version),
        model=model,
        warnings=(
            *plan.warnings,
            *warnings,
            *undersampled(planned, resolution.substeps),
            *resonance_doubts(planned, drives, masses, resolution),
        ),
        _spare=[engine],
    )
