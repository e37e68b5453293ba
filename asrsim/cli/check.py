"""`asrsim check`: reads robots and scenarios without running them, and prints their content, warnings and errors."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated

import typer

from asrsim.cli.command import Done, command
from asrsim.cli.options import Arguments, Files, Packages, argument, folders, option, pairs

SUFFIXES = {".yaml": True, ".yml": True, ".json": True, ".urdf": False, ".xacro": False, ".xml": False}
"""Whether files with this suffix are scenarios (True) or robots (False). Other files are recognised by their first
character."""


@command("Print problems only, no tables.")
def check(
    files: Annotated[Files, argument("[FILE]...", "URDF, xacro and scenario files.")] = None,
    actuator: Annotated[str | None, option("Check this actuator's laws instead of files.")] = None,
    stage: Annotated[str | None, option("Check the laws of this stage of actuators instead of files.")] = None,
    strict: Annotated[bool, option("Treat warnings as errors: exit code 1 if there is a warning.", "--strict")] = False,
    arg: Arguments = None,
    package: Packages = None,
    *,
    quiet: bool,
) -> Done:
    """Check robots and scenarios: parameters with their origin, warnings and errors with file and line.

    The command also lists parts of installed packages that asrsim cannot use.

    Example: asrsim check examples/urdf/dof2_vertical.urdf examples/scenarios/sine_2dof.yaml

    Example: asrsim check --strict examples/urdf/dof2_vertical.urdf

    Example: asrsim check --actuator my_vsa --plugin examples/plugins/my_vsa.py

    Example: asrsim check --stage clutch --plugin examples/plugins/my_clutch.py
    """
    from asrsim.cli import findings
    from asrsim.cli.tables import print_check_report, print_problems, print_reports
    from asrsim.registry.groups import faults_of_packages

    if len([one for one in (files, actuator, stage) if one]) > 1:
        raise typer.BadParameter("cannot be checked together", param_hint="files, --actuator and --stage")
    if actuator is not None or stage is not None:
        from asrsim.actuators import ACTUATORS
        from asrsim.actuators.checker import check_actuator
        from asrsim.actuators.stage_checker import check_stage
        from asrsim.actuators.stages import STAGES

        laws = check_stage(STAGES.get(stage)) if stage is not None else check_actuator(ACTUATORS.get(actuator or ""))
        return Done(
            data={**asdict(laws), "passed": laws.passed}, always=lambda: print_check_report(laws), code=int(not laws.passed)
        )
    if not files:
        raise typer.BadParameter("name a file, an actuator with --actuator, or a stage with --stage", param_hint="FILES")
    if (arg or package) and all(map(_is_scenario, files)):
        raise typer.BadParameter("is for robot files only; a scenario states it under `robot`", param_hint="--arg or --package")
    arguments, packages = pairs(arg, "--arg"), folders(package, "--package")
    reports = [
        findings.scenario_report(path) if _is_scenario(path) else findings.robot_report(path, arguments, packages)
        for path in files
    ]
    broken = list(faults_of_packages())
    if strict:
        reports = [replace(report, errors=(*report.errors, *report.warnings), warnings=()) for report in reports]

    def printed() -> None:
        print_problems(broken, "error" if strict else "warning")
        print_reports(reports, quiet=quiet)

    good = not any(report.errors for report in reports) and not (strict and broken)
    return Done(
        data={"ok": good, "files": reports, **({"packages": broken} if broken else {})},
        always=printed,
        code=int(not good),
    )


def _is_scenario(path: Path) -> bool:
    known = SUFFIXES.get(path.suffix.lower())
    if known is None and path.is_file():
        with path.open("rb") as stream:
            return not stream.read(4096).removeprefix(b"\xef\xbb\xbf").lstrip().startswith(b"<")
    return bool(known)
