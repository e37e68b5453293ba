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
    from asrsim.simulation.examine import Examined


@dataclass(frozen=True, kw_only=True)
class FileReport:
    """Findings in one file."""

    path: Path
    kind: str
    """Kind of the file: `robot` or `scenario`."""
    title: str = ""
    """Names of the variants if the file is a scenario."""
    robot: Robot | None = None
    step: float | None = None
    """Time step, s."""
    substeps: Mapping[str, Any] | None = None
    """Number of substeps of a run, and the quantities from which this number was computed; None: a run is impossible."""
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
    """Findings in a URDF or xacro file, including the findings of preparing a run with constant references."""
    from asrsim.scenario import scenario_from_data
    from asrsim.simulation.examine import Examined, findings

    report = FileReport(path=path, kind="robot")
    try:
        robot = read_robot(path, xacro_arguments=xacro_arguments, package_paths=package_paths)
    except InputError as error:
        return replace(report, errors=error.problems, warnings=error.warnings)
    packages = {name: str(folder) for name, folder in (package_paths or {}).items()}
    keys = {"file": str(path), "arguments": xacro_arguments or {}, "packages": packages}
    scenario = scenario_from_data({"robot": keys, "duration": 1e-3})
    return _built(Examined(scenario, robot, *findings(scenario, robot)), report)


def scenario_report(path: Path) -> FileReport:
    """Findings in a scenario file, in its variants and in their robots. The tables describe the first variant."""
    from asrsim.scenario.load import distinct
    from asrsim.simulation.examine import read

    report = FileReport(path=path, kind="scenario")
    try:
        examined, errors = read(path, propose=True)
    except AsrsimError as error:
        return replace(report, errors=problems_of(error, path))
    found = [_built(one, report) for one in examined]
    return replace(
        next((one for one in found if one.robot is not None), report),
        title=", ".join(one.scenario.variant for one in examined),
        errors=tuple(distinct([*errors, *(problem for one in found for problem in one.errors)])),
        warnings=tuple(distinct(problem for one in found for problem in one.warnings)),
    )


def _built(found: Examined, report: FileReport) -> FileReport:
    """Report with the findings in a scenario, in its robot, and in the attempt to build the run. For a robot file, warnings
    about the scenario are left out, since no user wrote it.
    """
    from asrsim.scenario.check import loop_warnings
    from asrsim.simulation.prepare import build

    scenario, plan, alone = found.scenario, found.plan, report.kind == "robot"
    if plan is None:
        return replace(report, errors=found.errors, warnings=found.warnings)
    if alone:
        loops = (replace(one, file=report.path) for one in loop_warnings(scenario, plan.source, plan.robot))
        plan = replace(plan, warnings=(*map(scenario.placed, warnings_of(plan.robot)), *loops))
    report = replace(report, robot=plan.robot, step=scenario.step, warnings=plan.warnings)
    try:
        prepared = build(plan)
        prepared.make_engine().close()
    except AsrsimError as error:
        # The simulation cannot be built if, for example, a spring is too stiff for any number of substeps, or if the engine
        # rejects a body.
        return replace(report, errors=problems_of(error, report.path))
    shapes = usable_shapes(plan.source, visuals=alone, package_paths=scenario.package_paths)[1]
    return replace(report, substeps=vars(prepared.resolution), warnings=tuple(dict.fromkeys((*prepared.warnings, *shapes))))


def problems_of(error: AsrsimError, path: Path) -> tuple[Problem, ...]:
    """Problems that an error contains; an error without problems becomes a single problem."""
    return error.problems if isinstance(error, InputError) else (Problem(str(error), file=path, code="simulation"),)


def number(value: object) -> object:
    """Value for JSON, in which an infinite number becomes the text inf or -inf."""
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
