"""Examination of a scenario: all checks run here, once, and all problems are reported together.

Code that receives a `Plan` does not check it again: `prepare` builds the run, `asrsim.runs.execute` simulates, judges and
writes it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

from asrsim.actuators.stages import STAGES
from asrsim.errors import Problem, RobotError, ScenarioError
from asrsim.plugins import blame_plugins
from asrsim.registry.engines import ENGINES
from asrsim.registry.steppings import Stepping, stepping_called
from asrsim.robot.doubts import warnings_of
from asrsim.robot.dynamics import RobotModel, robot_model
from asrsim.robot.model import Robot
from asrsim.samples import JointInfo
from asrsim.scenario import read_scenarios
from asrsim.scenario.check import loop_warnings, misfits, robot_of
from asrsim.scenario.data import Scenario
from asrsim.scenario.doubts import doubts
from asrsim.scenario.load import distinct, several_variants
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
    """The moving joints, with their drives and initial states."""
    joints: tuple[JointInfo, ...]
    """Description of the joints, in the order of logs."""
    model: RobotModel | None = field(repr=False, compare=False)
    """Kinematics and dynamics of the robot; None if the engine prescribes the motion of the links."""
    warnings: tuple[Problem, ...] = ()

    def on(self, **changes: Any) -> Plan:
        """This plan with other values of scenario fields that need no examination: engine, step, substeps, sampled signals."""
        scenario = replace(self.scenario, **changes)
        model = model_of(scenario, self.robot) if scenario.engine != self.scenario.engine else self.model
        return replace(self, scenario=scenario, model=model)


DRIVING = ("actuators", "locked", "modes", "parameters", "robot", "stepping")
"""Keys of the scenario that determine the joints and their drives."""


Beside = Callable[[Sequence[Scenario]], Iterable[Problem]]
"""Function that returns further problems of the variants, which are reported together with the problems that the examination
finds.
"""


class Examined(NamedTuple):
    """Result of the examination of one variant of a scenario."""

    scenario: Scenario
    source: Robot | None
    """Robot of the file; None if it cannot be read."""
    plan: Plan | None
    """Plan of the variant; None if there are errors."""
    errors: tuple[Problem, ...]
    warnings: tuple[Problem, ...]


def examine(
    scenario: str | Path | Scenario | Plan,
    robot: Robot | str | Path | None = None,
    *,
    variant: str | None = None,
    overrides: Overrides = (),
    plugins: Sequence[str | Path] = (),
    beside: Beside | None = None,
) -> Plan:
    """Check a scenario of one variant: keys, robot, actuators, signals, claims and recordings.

    Args:
        scenario: Scenario file, or a scenario. A plan is returned as it is: nothing is examined twice.
        robot: Robot in place of the scenario's robot: a file, or a robot that has been read from a file and possibly changed.
        variant, overrides: Variant and overrides of a scenario file, as in `asrsim.run`.
        plugins: Python files with users' actuators, signals and so on, which are loaded first.
        beside: Function that returns further problems, such as those of the folder for results. The function is called only if
            the examination finds problems.

    Raises RobotError or ScenarioError with all problems, each with file, line, key, value and valid choices.
    """
    if isinstance(scenario, Plan):
        return scenario
    found, problems = read(scenario, robot, variants=(variant,), overrides=overrides, plugins=plugins, one=True)
    return _plans(found, problems, robot, beside)[0]


def examine_all(
    scenario: str | Path | Scenario,
    robot: Robot | str | Path | None = None,
    *,
    variants: Sequence[str] = (),
    overrides: Overrides = (),
    plugins: Sequence[str | Path] = (),
    beside: Beside | None = None,
) -> tuple[Plan, ...]:
    """Plans of all variants of a scenario, or of the named `variants`; arguments and errors as for `examine`. The problems of
    all variants are reported together.
    """
    found, problems = read(scenario, robot, variants=variants or (None,), overrides=overrides, plugins=plugins)
    return _plans(found, problems, robot, beside)


@blame_plugins()
def read(
    scenario: str | Path | Scenario,
    robot: Robot | str | Path | None = None,
    *,
    variants: Sequence[str | None] = (None,),
    overrides: Overrides = (),
    plugins: Sequence[str | Path] = (),
    one: bool = False,
    propose: bool = False,
) -> tuple[list[Examined], tuple[Problem, ...]]:
    """Result of the examination of each variant, and the problems of the scenario file; arguments as for `examine`.

    variants: names of the variants; None: all variants. one: whether a file with several variants is a problem. propose:
    whether parameters are proposed for an arm that its springs and motors cannot carry; this takes some time. Raises
    ScenarioError for a file that contains no scenario, or lacks a variant.
    """
    given, file = (robot, None) if isinstance(robot, Robot) else (None, robot)
    parts = [read_scenarios(scenario, variant=name, overrides=overrides, robot=file, plugins=plugins) for name in variants]
    scenarios, problems = [one for part, _ in parts for one in part], [problem for _, part in parts for problem in part]
    if one and len(scenarios) > 1:
        raise ScenarioError([*distinct(problems), several_variants(scenarios)])
    found, robots = [], _Robots()
    for own in scenarios:
        source, errors = (given, ()) if given is not None else robots.of(own)
        plan, more, warnings = findings(own, source, propose=propose)
        found.append(Examined(own, source, plan, (*errors, *more), warnings))
    return found, tuple(distinct(problems))


class _Robots:
    """Robots of scenarios; variants with the same robot share it."""

    def __init__(self) -> None:
        self._read: dict[Any, tuple[Robot | None, tuple[Problem, ...]]] = {}

    def of(self, scenario: Scenario) -> tuple[Robot | None, tuple[Problem, ...]]:
        """Robot of the file that the scenario names, or None and the reasons why it cannot be read."""
        if any(key == "robot" for key, *_ in scenario.unread):
            return None, ()
        named = {**scenario.xacro_arguments}, {**scenario.package_paths}
        key = scenario.robot, scenario.locked, *(tuple(table.items()) for table in named)
        if key not in self._read:
            try:
                self._read[key] = robot_of(scenario), ()
            except RobotError as error:
                self._read[key] = None, error.problems
        return self._read[key]


def _plans(
    found: Sequence[Examined], problems: Sequence[Problem], robot: Robot | str | Path | None, beside: Beside | None
) -> tuple[Plan, ...]:
    """Plans without problems. Raises ScenarioError, or RobotError if the robot's file has errors."""
    errors = [problem for one in found for problem in one.errors]
    plans = [replace(one.plan, given=isinstance(robot, Robot)) for one in found if one.plan is not None]
    if problems or len(plans) < len(found):
        of_robot = not problems and any(one.source is None or one.source.faults for one in found)
        errors += [] if beside is None else beside([one.scenario for one in found])
        warnings = distinct(warning for one in found if one.plan is None for warning in one.warnings)
        raise (RobotError if of_robot else ScenarioError)(distinct([*problems, *errors]), warnings=warnings)
    return tuple(plans)


def findings(
    scenario: Scenario, source: Robot | None, *, propose: bool = False
) -> tuple[Plan | None, tuple[Problem, ...], tuple[Problem, ...]]:
    """Plan, errors and warnings; the plan is None if there are errors. Checks that depend on an invalid value are skipped.

    source: robot of the file; None if it cannot be read. propose: whether parameters are proposed for an arm that its springs
    and motors do not hold; this takes some time.
    """
    robot, faults, errors = misfits(scenario, source)
    known = robot is not None and not faults and not any(key in DRIVING for key, *_ in scenario.unread)
    drives = make_drives(robot, stepping_called(scenario.stepping), scenario) if robot is not None and known else ()
    joints = described(scenario, drives)
    errors = [*map(scenario.placed, (*faults, *errors)), *_wrong_claims(scenario, joints)]
    if errors or source is None or robot is None or scenario.unread:
        found = () if source is None else warnings_of(source)
        # Do not warn that the robot's file has no actuators if the scenario states actuators, even with invalid values.
        equipped = bool(scenario.actuators) or any(key == "actuators" for key, *_ in scenario.unread)
        kept = (one for one in found if not (equipped and one.code == "no-actuators"))
        return None, tuple(errors), (*STAGES.broken(), *kept)
    model = model_of(scenario, robot)
    warnings = (
        *STAGES.broken(),
        *map(scenario.placed, warnings_of(robot)),
        *doubts(scenario, robot),
        *loop_warnings(scenario, source, robot),
        *(() if model is None else weight_warnings(scenario, robot, model, propose=propose)),
    )
    plan = Plan(
        scenario=scenario,
        source=source,
        robot=robot,
        stepping=stepping_called(scenario.stepping),
        drives=drives,
        joints=joints,
        model=model,
        warnings=warnings,
    )
    return plan, (), warnings


def model_of(scenario: Scenario, robot: Robot) -> RobotModel | None:
    """Kinematics and dynamics of the robot; None if the scenario's engine prescribes the motion of the links."""
    return None if ENGINES.get(scenario.engine).prescribed else robot_model(scenario, robot)


def described(scenario: Scenario, drives: Sequence[SteppedJoint]) -> tuple[JointInfo, ...]:
    """Description of the joints, in the order of the scenario's manager file, or of the robot if the scenario has no such
    file."""
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
    """Problems of the scenario's claims and their recordings. joints: joints of the robot; empty if they are unknown, since the
    robot has errors.
    """
    if not scenario.expect:
        return []
    # Import this only for claims. Most runs have no claims, and start faster without these imports.
    from asrsim.summary.claims import claim_problems

    return claim_problems(scenario.expect, joints, file=scenario.path)
