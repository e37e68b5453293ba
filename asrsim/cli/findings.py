"""Findings of `asrsim check` in a file, as data; `asrsim.cli.tables` prints the findings."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from asrsim.actuators import ACTUATORS, MODES
from asrsim.errors import AsrsimError, InputError, Problem
from asrsim.plain import mapped
from asrsim.robot import ActuatorBlock, Robot, read_robot
from asrsim.robot.doubts import warnings_of
from asrsim.robot.meshes import usable_shapes

if TYPE_CHECKING:
    from asrsim.scenario import Scenario
    from asrsim.simulation.prepare import Prepared


@dataclass(frozen=True, kw_only=True)
class FileReport:
    """Findings in one file."""

    path: Path
    kind: str
    """Kind of the file: robot or scenario."""
    title: str = ""
    """Names of the variants if the file is a scenario."""
    robot: Robot | None = None
    step: float | None = None
    """Time step, s."""
    substeps: Mapping[str, Any] | None = None
    """Number of substeps of a run and the quantities that determine this number; None: a run is impossible."""
    errors: tuple[Problem, ...] = ()
    warnings: tuple[Problem, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """Findings as data for JSON; infinite numbers become the texts inf and -inf."""
        data: dict[str, Any] = {"file": str(self.path), "kind": self.kind}
        if self.title:
            data["variants"] = self.title
        if self.robot is not None:
            moving = self.robot.moving_joints
            data |= {
                "robot": self.robot.name,
                "links": len(self.robot.links),
                "joints": [joint.name for joint in moving],
                "passive_springs": {
                    joint.name: {"stiffness": joint.spring_stiffness, "reference": joint.spring_reference}
                    for joint in moving
                    if joint.spring_stiffness
                },
                "actuators": [_block(block) for block in self.robot.actuators],
                "step": self.step,
            }
        if self.substeps is not None:
            data["substeps"] = self.substeps
        data["errors"] = self.errors
        data["warnings"] = self.warnings
        return mapped(data, number)  # type: ignore[no-any-return]


def robot_report(
    path: Path, xacro_arguments: Mapping[str, str] | None = None, package_paths: Mapping[str, Path] | None = None
) -> FileReport:
    """Findings in a URDF or xacro file, including the findings that a run with constant references would report."""
    from asrsim.scenario import scenario_from_data

    report = FileReport(path=path, kind="robot")
    try:
        robot = read_robot(path, xacro_arguments=xacro_arguments, package_paths=package_paths)
    except InputError as error:
        return replace(report, errors=error.problems, warnings=error.warnings)
    packages = {name: str(folder) for name, folder in (package_paths or {}).items()}
    keys = {"file": str(path), "arguments": xacro_arguments or {}, "packages": packages}
    return _examined(scenario_from_data({"robot": keys, "duration": 1e-3}), robot, report)


def scenario_report(path: Path) -> FileReport:
    """Findings in a scenario file, its variants and their robots; the table shows the first variant."""
    from asrsim.scenario import read_scenarios
    from asrsim.scenario.check import robot_of
    from asrsim.scenario.load import distinct

    report = FileReport(path=path, kind="scenario")
    try:
        scenarios, errors = read_scenarios(path)
    except AsrsimError as error:
        return replace(report, errors=problems_of(error, path))
    found = []
    for scenario in scenarios:
        robot = None
        try:
            if not any(key == "robot" for key, *_ in scenario.unread):
                robot = robot_of(scenario)
        except AsrsimError as error:
            errors.extend(problems_of(error, path))
        found.append(_examined(scenario, robot, report))
    return replace(
        next((one for one in found if one.robot is not None), report),
        title=", ".join(scenario.variant for scenario in scenarios),
        errors=tuple(distinct([*errors, *(problem for one in found for problem in one.errors)])),
        warnings=tuple(distinct(problem for one in found for problem in one.warnings)),
    )


def _examined(scenario: Scenario, robot: Robot | None, report: FileReport) -> FileReport:
    """Report with the findings in a scenario and its robot. For a robot file, missing references are not reported."""
    from asrsim.kinematics.sizing import weight_warnings
    from asrsim.scenario import apply_to_robot, check_against_robot
    from asrsim.scenario.signal_checks import undersampled
    from asrsim.simulation.resonance import resonance_doubts

    alone = report.kind == "robot"
    errors, notes = check_against_robot(scenario, robot)
    if robot is None or errors or scenario.unread:
        warnings = [*(warnings_of(robot) if robot else ()), *notes]
        return replace(report, errors=tuple(errors), warnings=tuple(warnings))
    changed = apply_to_robot(scenario, robot)
    warnings = [*map(scenario.placed, warnings_of(changed))]
    if not alone:
        warnings += [*notes, *weight_warnings(scenario, changed, propose=True)]
    prepared, unbuildable = _built(scenario, robot, report.path)
    if prepared is not None:
        warnings += usable_shapes(robot, visuals=alone, package_paths=scenario.package_paths)[1]
        warnings += undersampled(scenario, prepared.resolution.substeps)
        warnings += resonance_doubts(scenario, prepared.drives, prepared.model, prepared.resolution)
    substeps = None if prepared is None else vars(prepared.resolution)
    return replace(report, robot=changed, step=scenario.step, substeps=substeps, errors=unbuildable, warnings=tuple(warnings))


def _built(scenario: Scenario, robot: Robot, path: Path) -> tuple[Prepared | None, tuple[Problem, ...]]:
    """The run as it is built, and errors that appear only when the run is built: springs too stiff for any substep, bodies that
    the engine rejects, claims that cannot be evaluated.
    """
    from asrsim.simulation.prepare import prepare
    from asrsim.summary.claims import check_claims

    try:
        prepared = prepare(scenario, robot)
        prepared.make_engine().close()
        check_claims(scenario.expect, prepared.info.joints, file=scenario.path)
    except AsrsimError as error:
        return None, problems_of(error, path)
    return prepared, ()


def problems_of(error: AsrsimError, path: Path) -> tuple[Problem, ...]:
    """Problems that an error contains; an error without problems becomes a single problem."""
    return error.problems if isinstance(error, InputError) else (Problem(str(error), file=path),)


def number(value: object) -> object:
    """Value for JSON: infinite numbers become text."""
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return value


def _block(block: ActuatorBlock) -> dict[str, Any]:
    about = ("actuator", "joint", "mode", "namespace", "line")
    return {
        **{key: getattr(block, key) for key in about},
        "title": ACTUATORS.get(block.actuator).title,
        "mode_name": MODES[block.mode].name,
        "parameters": [
            {key: entry for key, entry in vars(value).items() if entry not in ("", None)} for value in block.parameters.values()
        ],
    }
