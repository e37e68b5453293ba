"""Examination of a scenario: everything that can be wrong is checked here, once, and all problems are reported together.

Whatever works on a `Plan` trusts it: `prepare` builds the run, `asrsim.runs.execute` simulates, judges and writes it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from asrsim.errors import Problem, RobotError, ScenarioError
from asrsim.plugins import blame_laws
from asrsim.registry.engines import ENGINES
from asrsim.registry.steppings import Stepping, stepping_called
from asrsim.robot.doubts import warnings_of
from asrsim.robot.dynamics import RobotModel, robot_model
from asrsim.robot.model import Robot
from asrsim.samples import JointInfo
from asrsim.scenario import one_scenario
from asrsim.scenario.check import loop_warnings, misfits, robot_of
from asrsim.scenario.data import Scenario
from asrsim.scenario.doubts import doubts
from asrsim.scenario.overrides import Overrides
from asrsim.simulation.drives import SteppedJoint, make_drives
from asrsim.simulation.quantities import recorded_quantities
from asrsim.statics.sizing import weight_warnings


@dataclass(frozen=True, kw_only=True)
class Plan:
    """A scenario and its robot, examined together."""

    scenario: Scenario
    source: Robot
    """Robot of the file, without the scenario's changes."""
    robot: Robot
    """Robot with the scenario's actuators, modes, parameters and loops."""
    given: bool = False
    """Whether the caller gave the robot in place of the scenario's robot."""
    stepping: Stepping
    drives: tuple[SteppedJoint, ...]
    """The moving joints, with their drives and start."""
    joints: tuple[JointInfo, ...]
    """Description of the joints, in the order of logs."""
    model: RobotModel | None = field(repr=False, compare=False)
    """Kinematics and dynamics of the robot; None if the engine prescribes the motion of the links."""
    warnings: tuple[Problem, ...] = ()

    def on(self, **changes: Any) -> Plan:
        """This plan with other fields of the scenario that need no examination: engine, step, substeps, sampled signals."""
        scenario = replace(self.scenario, **changes)
        model = model_of(scenario, self.robot) if scenario.engine != self.scenario.engine else self.model
        return replace(self, scenario=scenario, drives=make_drives(self.robot, self.stepping, scenario), model=model)


@blame_laws()
def examine(
    scenario: str | Path | Scenario | Plan,
    robot: Robot | None = None,
    *,
    variant: str | None = None,
    overrides: Overrides = (),
    plugins: Sequence[str | Path] = (),
) -> Plan:
    """Check robot, actuators, signals, claims and recordings of a scenario.

    Args:
        scenario: Scenario file, or a scenario. A plan is returned as it is: nothing is examined twice.
        robot: Robot of the file, possibly changed, in place of the scenario's robot.
        variant, overrides: Of a scenario's file, as `asrsim.run` takes them.
        plugins: Python files with users' actuators, signals and so on, which are loaded first.

    Raises RobotError or ScenarioError with all problems, each with file, line, key, value and valid choices.
    """
    if isinstance(scenario, Plan):
        return scenario
    one = one_scenario(scenario, variant=variant, overrides=overrides, plugins=plugins)
    source = robot_of(one) if robot is None else robot
    plan, errors, _ = findings(one, source)
    if plan is None:
        raise (RobotError if source.faults else ScenarioError)(errors, warnings=warnings_of(source))
    return replace(plan, given=robot is not None)


def findings(
    scenario: Scenario, source: Robot | None, *, propose: bool = False
) -> tuple[Plan | None, tuple[Problem, ...], tuple[Problem, ...]]:
    """Plan, errors and warnings; the plan is None if there are errors. Checks that depend on an invalid value are skipped.

    source: robot of the file; None if it cannot be read. propose: propose parameters for an arm that its springs and motors do
    not hold, which takes some time.
    """
    robot, errors = misfits(scenario, source)
    if source is None or robot is None:
        return None, (*errors, *_wrong_claims(scenario)), () if source is None else warnings_of(source)
    stepping, sound = stepping_called(scenario.stepping), not errors and not scenario.unread
    drives = make_drives(robot, stepping, scenario) if sound else ()
    joints = described(scenario, drives)
    errors = [*errors, *_wrong_claims(scenario, joints)]
    if errors or not sound:
        return None, tuple(errors), warnings_of(source)
    model = model_of(scenario, robot)
    warnings = (
        *map(scenario.placed, warnings_of(robot)), *doubts(scenario, robot), *loop_warnings(scenario, source, robot),
        *(() if model is None else weight_warnings(scenario, robot, model, propose=propose)),
    )  # fmt: skip
    plan = Plan(
        scenario=scenario, source=source, robot=robot, stepping=stepping, drives=drives, joints=joints, model=model,
        warnings=warnings,
    )  # fmt: skip
    return plan, (), warnings


def model_of(scenario: Scenario, robot: Robot) -> RobotModel | None:
    """Kinematics and dynamics of the robot; None if the scenario's engine prescribes the motion of the links."""
    return None if ENGINES.get(scenario.engine).prescribed else robot_model(scenario, robot)


def described(scenario: Scenario, drives: Sequence[SteppedJoint]) -> tuple[JointInfo, ...]:
    """Description of the joints, in the order of the scenario's manager file, else of the robot."""
    joints = [
        JointInfo(
            name=drive.name,
            actuator=drive.actuator.name if drive.actuator else "rigid",
            mode=drive.mode.number if drive.mode else None,
            namespace=drive.block.namespace if drive.block else "",
            motors=drive.placed,
            prismatic=drive.joint.kind == "prismatic",
            quantities=recorded_quantities(drive),
        )
        for drive in drives
    ]
    order = {name: index for index, name in enumerate(scenario.joint_order)}
    return tuple(sorted(joints, key=lambda joint: order.get(joint.name, len(order))))


def _wrong_claims(scenario: Scenario, joints: Sequence[JointInfo] = ()) -> list[Problem]:
    """Problems of the scenario's claims and their recordings. joints: empty if they are unknown, as the robot has errors."""
    if not scenario.expect:
        return []
    # Most runs have no claims, and start faster without these imports.
    from asrsim.summary.claims import claim_problems

    return claim_problems(scenario.expect, joints, file=scenario.path)
