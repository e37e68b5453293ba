"""`asrsim check`: reads robots and scenarios without running them, and prints their content, warnings and errors."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from asrsim.cli.options import Arguments, Json, Packages, Plugins, folders, load_plugins, pairs

if TYPE_CHECKING:
    from asrsim.cli.findings import FileReport

DEFAULT_STEP = 1e-3
"""Step for the figures of a robot without scenario, s."""
SUFFIXES = {".yaml": True, ".yml": True, ".json": True, ".urdf": False, ".xacro": False, ".xml": False}
"""Suffix -> whether the file is a scenario (True) or a robot; other files are recognised by their first character."""


def check(
    files: Annotated[
        list[Path] | None, typer.Argument(metavar="[FILE]...", help="URDF, xacro and scenario files.", show_default=False)
    ] = None,
    step: Annotated[
        float | None, typer.Option(help="Time step in s for the stability checks.", show_default="1e-3, or the scenario's")
    ] = None,
    actuator: Annotated[str | None, typer.Option(help="Check this actuator's laws instead of files.")] = None,
    plugin: Plugins = None,
    argument: Arguments = None,
    package: Packages = None,
    json: Json = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print problems only, no tables.")] = False,
) -> None:
    """Check robots and scenarios: parameters with their origin, warnings and errors with file and line.

    Example: asrsim check examples/urdf/dof2_vertical.urdf examples/scenarios/sine_2dof.yaml

    Example: asrsim check --actuator my_vsa --plugin examples/plugins/my_vsa.py
    """
    from asrsim.cli import findings
    from asrsim.cli.console import json_errors

    with json_errors(json):
        load_plugins(plugin)
    if step is not None and not step > 0.0:
        raise typer.BadParameter("must be larger than 0 s", param_hint="--step")
    if actuator is not None:
        with json_errors(json):
            _check_actuator(actuator, json)
    if not files:
        if actuator is not None:
            return
        raise typer.BadParameter("name a file, or an actuator with --actuator", param_hint="FILES")
    arguments, packages = pairs(argument, "--arg"), folders(package, "--package")
    reports = []
    for path in files:
        if _is_scenario(path):
            reports.append(findings.scenario_report(path, step=step))
        else:
            reports.append(
                findings.robot_report(path, step=step or DEFAULT_STEP, xacro_arguments=arguments, package_paths=packages)
            )
    _print(reports, json=json, quiet=quiet)
    if any(report.errors for report in reports):
        raise typer.Exit(1)


def _is_scenario(path: Path) -> bool:
    known = SUFFIXES.get(path.suffix.lower())
    if known is None and path.is_file():
        with path.open("rb") as stream:
            return not stream.read(4096).removeprefix(b"\xef\xbb\xbf").lstrip().startswith(b"<")
    return bool(known)


def _check_actuator(name: str, as_json: bool) -> None:
    from asrsim.actuators import ACTUATORS
    from asrsim.actuators.checker import check_actuator

    report = check_actuator(ACTUATORS.get(name))
    if as_json:
        from dataclasses import asdict

        from asrsim.cli.console import say_json

        say_json({**asdict(report), "passed": report.passed})
    else:
        from asrsim.cli.tables import print_check_report

        print_check_report(report)
    if not report.passed:
        raise typer.Exit(1)


def _print(reports: list[FileReport], *, json: bool, quiet: bool) -> None:
    if json:
        from asrsim.cli.console import say_json

        say_json({"ok": not any(report.errors for report in reports), "files": [report.as_dict() for report in reports]})
        return
    from asrsim.cli.tables import print_reports

    print_reports(reports, quiet=quiet)
