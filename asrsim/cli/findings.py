"""Findings of `asrsim check` in a file, as data; another module prints them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from asrsim.actuators import ACTUATORS, MODES
from asrsim.errors import AsrsimError, InputError, Problem
from asrsim.robot import ActuatorBlock, Robot, StepFigures, read_robot, step_figures, step_findings
from asrsim.robot.engine_text import usable_shapes

if TYPE_CHECKING:
    from asrsim.scenario import Scenario


@dataclass(frozen=True, kw_only=True)
class FileReport:
    """Findings in one file."""

    path: Path
    kind: str
    """Kind of the file: robot or scenario."""
    title: str = ""
    """Names of the variants, for a scenario."""
    robot: Robot | None = None
    step: float | None = None
    """Time step, s."""
    figures: tuple[StepFigures, ...] = ()
    substeps: Mapping[str, Any] | None = None
    """Substeps of a run and the quantities that determine them; None: a run is impossible."""
    errors: tuple[Problem, ...] = ()
    warnings: tuple[Problem, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """Findings as data for JSON; infinite numbers become the texts inf and -inf."""
        data: dict[str, Any] = {"file": str(self.path), "kind": self.kind}
        if self.title:
            data["variants"] = self.title
        if self.robot is not None:
            data["robot"] = self.robot.name
            data["links"] = len(self.robot.links)
            data["joints"] = [joint.name for joint in self.robot.moving_joints]
            data["passive_springs"] = {
                joint.name: {"stiffness": joint.spring_stiffness, "reference": joint.spring_reference}
                for joint in self.robot.moving_joints
                if joint.spring_stiffness
            }
            data["mimic"] = {joint.name: vars(joint.mimic) for joint in self.robot.moving_joints if joint.mimic is not None}
            data["actuators"] = [_block(block) for block in self.robot.actuators]
        if self.step is not None:
            data["step"] = self.step
            data["figures"] = [{key: number(value) for key, value in vars(entry).items()} for entry in self.figures]
        if self.substeps is not None:
            data["substeps"] = {key: number(value) for key, value in self.substeps.items()}
        data["errors"] = [problem.as_dict() for problem in self.errors]
        data["warnings"] = [problem.as_dict() for problem in self.warnings]
        return data


def robot_report(
    path: Path,
    *,
    step: float,
    xacro_arguments: Mapping[str, str] | None = None,
    package_paths: Mapping[str, Path] | None = None,
) -> FileReport:
    """Findings in a URDF or xacro file at a step in s, including those of a run with constant references."""
    from asrsim.scenario import check_against_robot, scenario_from_data

    try:
        robot = read_robot(path, xacro_arguments=xacro_arguments, package_paths=package_paths)
    except InputError as error:
        return FileReport(path=path, kind="robot", errors=error.problems, warnings=error.warnings)
    files = {name: str(folder) for name, folder in (package_paths or {}).items()}
    keys = {"robot": {"file": str(path), "arguments": xacro_arguments or {}, "packages": files}, "step": step, "duration": step}
    scenario = scenario_from_data(keys)
    errors = tuple(check_against_robot(scenario, robot)[0])
    if robot.faults:
        return FileReport(path=path, kind="robot", errors=errors, warnings=robot.warnings)
    substeps, unbuildable = (None, ()) if errors else _built(scenario, robot, path)
    figures = step_figures(robot, step=step)
    warnings = robot.warnings + step_findings(robot, figures, step=step)
    if substeps is not None:
        warnings += usable_shapes(robot, visuals=True, package_paths=package_paths)[1]
    return FileReport(
        path=path, kind="robot", robot=robot, step=step, figures=figures, substeps=substeps,
        errors=errors or unbuildable, warnings=warnings,
    )  # fmt: skip


def scenario_report(path: Path, *, step: float | None = None) -> FileReport:
    """Findings in a scenario file, its variants and their robots; the table shows the first variant."""
    from asrsim.scenario import apply_to_robot, check_against_robot, read_scenarios
    from asrsim.scenario.check import robot_of

    try:
        scenarios, errors = read_scenarios(path)
    except AsrsimError as error:
        return FileReport(path=path, kind="scenario", errors=problems_of(error, path))
    warnings: list[Problem] = []
    first = FileReport(path=path, kind="scenario")
    for scenario in scenarios:
        robot = None
        try:
            if not any(key == "robot" for key, *_ in scenario.unread):
                robot = robot_of(scenario)
        except AsrsimError as error:
            errors.extend(problems_of(error, path))
        wrong, notes = check_against_robot(scenario, robot, propose=True)
        errors.extend(wrong)
        if robot is None or wrong or scenario.unread:
            warnings.extend((*(robot.warnings if robot else ()), *notes))
            continue
        if step is not None:
            scenario = replace(scenario, step=step, duration=step * max(1, round(scenario.duration / step)))
        changed = apply_to_robot(scenario, robot)
        figures = step_figures(changed, step=scenario.step)
        warnings.extend((*changed.warnings, *notes, *step_findings(changed, figures, step=scenario.step)))
        substeps, unbuildable = _built(scenario, robot, path)
        errors.extend(unbuildable)
        if substeps is not None:
            warnings.extend(usable_shapes(robot, package_paths=scenario.package_paths)[1])
        if first.robot is None:
            first = replace(first, robot=changed, step=scenario.step, figures=figures, substeps=substeps)
    title = ", ".join(scenario.variant for scenario in scenarios)
    return replace(first, title=title, errors=unique(errors), warnings=unique(warnings))


def _built(scenario: Scenario, robot: Robot, path: Path) -> tuple[Mapping[str, Any] | None, tuple[Problem, ...]]:
    """Substeps of the run, and errors that appear only when the run is built: springs too stiff for any substep, bodies that
    the engine rejects.
    """
    from asrsim.simulation.prepare import prepare

    try:
        prepared = prepare(scenario, robot)
        prepared.make_engine().close()
    except AsrsimError as error:
        return None, problems_of(error, path)
    return vars(prepared.resolution), ()


def problems_of(error: AsrsimError, path: Path) -> tuple[Problem, ...]:
    """Problems of an error; an error without problems becomes a single problem."""
    return error.problems if isinstance(error, InputError) else (Problem(str(error), file=path),)


def unique(problems: list[Problem]) -> tuple[Problem, ...]:
    """Problems without repetitions (variants share most findings)."""
    seen: dict[str, Problem] = {}
    for problem in problems:
        seen.setdefault(str(problem), problem)
    return tuple(seen.values())


def number(value: object) -> object:
    """Value for JSON: infinite numbers become text."""
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return value


def _block(block: ActuatorBlock) -> dict[str, Any]:
    return {
        "actuator": block.actuator,
        "title": ACTUATORS.get(block.actuator).title,
        "joint": block.joint,
        "mode": block.mode,
        "mode_name": MODES[block.mode].name,
        "namespace": block.namespace,
        "sample_time": block.sample_time,
        "line": block.line,
        "parameters": [
            {key: number(entry) for key, entry in vars(value).items() if entry not in ("", None)}
            for value in block.parameters.values()
        ],
    }
