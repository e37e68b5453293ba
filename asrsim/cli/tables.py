"""Tables and lines that `asrsim check` and `asrsim actuators` print for people."""

from __future__ import annotations

from collections.abc import Container, Iterable, Sequence
from typing import TYPE_CHECKING

from rich import markup
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.padding import Padding
from rich.table import Table

from asrsim.actuators import ACTUATORS, MODES, Actuator, Mode
from asrsim.cli.console import SHOWN, problem_lines, shown
from asrsim.cli.findings import FileReport
from asrsim.errors import Problem
from asrsim.quantities import linear_unit
from asrsim.robot import ActuatorBlock, ParameterValue, Robot, StepFigures
from asrsim.robot.tags import parameter_tags

if TYPE_CHECKING:
    from asrsim.actuators.checker import CheckReport


def escape(text: str) -> str:
    """A text of a file, with nothing in it that rich or a terminal obeys."""
    return markup.escape(shown(text))


def print_reports(reports: Sequence[FileReport], *, quiet: bool) -> None:
    """Tables (unless quiet) and problems of every file; unless quiet, one closing line."""
    console = Console(highlight=False)
    for report in reports:
        if not quiet:
            _print_head(console, report)
            if report.robot is not None:
                slides = {joint.name for joint in report.robot.moving_joints if joint.kind == "prismatic"}
                for blocks in _alike(report.robot.actuators, slides):
                    _print_blocks(console, blocks, slides)
                _print_passive(console, report.robot)
                if report.step is not None:
                    _print_figures(console, report.figures, report.step, slides)
        print_problems(console, report.errors, "error", "bold red")
        print_problems(console, report.warnings, "warning", "yellow")
    if quiet:
        return
    errors, warnings = sum(len(report.errors) for report in reports), sum(len(report.warnings) for report in reports)
    files = _count(len(reports), "file")
    colour = "bold red" if errors else "yellow" if warnings else "green"
    console.print(f"[{colour}]{files}: {_count(errors, 'error')}, {_count(warnings, 'warning')}[/]")


def print_problems(console: Console, problems: Sequence[Problem], word: str, style: str) -> None:
    """One line a problem; problems that differ in their place only share a line."""
    for line in problem_lines(problems):
        console.print(f"[{style}]{word}[/] {escape(line)}", soft_wrap=True)


def _print_head(console: Console, report: FileReport) -> None:
    parts = [f"[bold]{escape(str(report.path))}[/]"]
    if report.title:
        names = report.title.split(", ")
        parts.append(f"variants {escape(report.title)} (tables: {escape(names[0])})" if len(names) > 1 else escape(names[0]))
    if report.robot is not None:
        robot = report.robot
        parts.append(f"robot '{escape(robot.name)}'")
        parts.append(_count(len(robot.links), "link"))
        parts.append(_count(len(robot.moving_joints), "moving joint"))
        parts.append(_count(len(robot.actuators), "actuator"))
        rigid = _undriven(robot)
        if rigid:
            parts.append(f"not driven: {escape(', '.join(rigid[:SHOWN]))}{' ...' if len(rigid) > SHOWN else ''}")
    console.print(" · ".join(parts), soft_wrap=True)


def _print_passive(console: Console, robot: Robot) -> None:
    """What moves or holds joints beside actuators."""
    springs: dict[str, list[str]] = {}
    for joint in robot.moving_joints:
        if joint.spring_stiffness:
            per, at = ("N/m", "m") if joint.kind == "prismatic" else ("N m/rad", "rad")
            key = f"{joint.spring_stiffness:g} {per} to {joint.spring_reference:g} {at}"
            springs.setdefault(key, []).append(joint.name)
    for spring, names in springs.items():
        console.print(f"[bold cyan]passive spring[/], {spring}: {escape(', '.join(names))}", soft_wrap=True)
    followers = [f"{joint.name} = {joint.mimic}" for joint in robot.moving_joints if joint.mimic is not None]
    if followers:
        console.print(f"[bold cyan]mimic[/], not simulated: {escape('; '.join(followers))}", soft_wrap=True)


def _undriven(robot: Robot) -> list[str]:
    driven = {block.joint for block in robot.actuators}
    return [joint.name for joint in robot.moving_joints if joint.name not in driven]


def _alike(blocks: Iterable[ActuatorBlock], slides: Container[str]) -> list[list[ActuatorBlock]]:
    """Blocks with equal actuator, mode and parameters together, so that a robot of many arms fits a screen; prismatic joints,
    `slides`, have units of their own.
    """
    groups: dict[tuple[object, ...], list[ActuatorBlock]] = {}
    for block in blocks:
        values = tuple((name, value.value, value.origin) for name, value in block.parameters.items())
        groups.setdefault((block.actuator, block.mode, block.joint in slides, values), []).append(block)
    return list(groups.values())


def _print_blocks(console: Console, blocks: list[ActuatorBlock], slides: Container[str]) -> None:
    first = blocks[0]
    unit_of = linear_unit if first.joint in slides else str
    mode, actuator = MODES[first.mode], ACTUATORS.get(first.actuator)
    console.print()
    console.print(
        f"[bold cyan]{escape(actuator.title)}[/], mode {mode.number} {mode.name} [dim]({mode.doc})[/]", soft_wrap=True
    )
    joints = [block.joint + (f" (line {block.line})" if block.line else "") for block in blocks]
    console.print(f"{'joint' if len(blocks) == 1 else f'{len(blocks)} joints'}: {escape(', '.join(joints))}")
    table = Table(box=SIMPLE_HEAD, pad_edge=False, show_edge=False)
    table.add_column("parameter", overflow="fold")
    table.add_column("value", justify="right", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    table.add_column("from", overflow="fold")
    section = ""
    values = first.values()
    off = {one.name for one in actuator.all_parameters() if one.optional and not values.get(one.needs, 0.0)}
    for value in first.parameters.values():
        if value.name in off and value.origin == "default":
            continue
        part = _part(value.name)
        if section and part != section:
            table.add_section()
        section = part
        used = _is_used(part, value.name, mode)
        name = value.name if used else f"{value.name} *"
        style = "" if value.origin != "default" else "dim"
        table.add_row(
            escape(name), f"{value.value:.6g}", unit_of(value.unit), _origin(value, blocks), style=style if used else "dim"
        )
    console.print(table)
    if mode.motor and mode.controller and any(values[f"motor_{i}_torque_constant"] for i in range(1, actuator.motors + 1)):
        console.print(
            "[dim]controllers of electric motors give voltage: gains in V for N m (in A where the resistance is 0)[/]"
        )
    if not all(_is_used(_part(name), name, mode) for name in first.parameters):
        console.print(f"[dim]* not used in mode {mode.number}[/]")


def _part(name: str) -> str:
    return name.split("_")[0] if name.startswith(("motor_", "controller_")) else "spring"


def _is_used(part: str, name: str, mode: Mode) -> bool:
    if part == "motor":
        return mode.motor
    if part == "controller":
        return mode.controller and (mode.motor or name.startswith("controller_1"))
    return mode.spring


def _origin(value: ParameterValue, blocks: list[ActuatorBlock]) -> str:
    if value.origin == "tag":
        where = f", line {value.line}" if value.line else ""
        more = f" and {len(blocks) - 1} more" if len(blocks) > 1 and where else ""
        written = f" [dim]{escape(value.text)}[/]" if not _plain(value.text) else ""
        return f"[green]<{value.tag}>[/]{where}{more}{written}"
    if value.origin == "scenario":
        return "[magenta]scenario[/]"
    if value.origin == "mode default":
        return f"default of mode 1 <{value.tag}>"
    return f"default <{value.tag}>"


def _plain(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _print_figures(console: Console, figures: Sequence[StepFigures], step: float, slides: Container[str]) -> None:
    if not figures:
        return
    console.print()
    console.print(f"At a step of {step * 1e3:g} ms [dim](estimates at the zero pose, base fixed)[/]")
    table = Table(box=SIMPLE_HEAD, pad_edge=False, show_edge=False)
    table.add_column("joint")
    inertia, stiffness = (
        "\nor ".join(dict.fromkeys(linear_unit(unit) if entry.joint in slides else unit for entry in figures))
        for unit in ("kg m^2", "N m/rad")
    )
    for heading in (
        f"inertia\n{inertia.replace('^2', '²')}",
        "at rest\nHz",
        f"stiffness\n{stiffness}",
        "ω h\n< 2",
        "sub-\nsteps",
        "c h/I\n< 2",
        "gains\n< 2",
    ):
        table.add_column(heading, justify="right", no_wrap=True)
    for entry in figures:
        gain = max(entry.link_gain, entry.motor_gain)
        table.add_row(
            escape(entry.joint), f"{entry.inertia:.3g}", f"{entry.natural:.3g}" if entry.natural else "-",
            f"{entry.stiffness:.3g}" if entry.stiffness else "-",
            _limited(entry.spring), str(entry.substeps), _limited(entry.damping), _limited(gain),
        )  # fmt: skip
    console.print(table)
    console.print()


def _limited(value: float) -> str:
    if value == 0.0:
        return "-"
    return f"[red]{value:.3g}[/]" if value >= 2.0 else f"{value:.3g}"


def print_check_report(report: CheckReport) -> None:
    """Verdict of every check of an actuator's laws."""
    console = Console(highlight=False)
    console.print(f"[bold]{escape(report.title)}[/] ({escape(report.actuator)})")
    table = Table(box=SIMPLE_HEAD, pad_edge=False, show_edge=False)
    for heading in ("check", "verdict"):
        table.add_column(heading)
    table.add_column("worst", justify="right")
    table.add_column("limit", justify="right")
    table.add_column("what is asked")
    for check in report.checks:
        verdict = "[green]pass[/]" if check.passed else "[bold red]FAIL[/]"
        figure = f"{check.figure:.2g}" if check.figure is not None and check.limit is not None else ""
        limit = f"{check.limit:g}" if check.limit is not None else ""
        table.add_row(check.name, verdict, figure, limit, check.doc)
    console.print(table)
    for check in report.checks:
        if not check.passed:
            console.print(f"[bold red]{check.name}[/]: {escape(check.detail)}", soft_wrap=True)
    failed = sum(not check.passed for check in report.checks)
    verdict = "[green]all checks passed[/]" if not failed else f"[bold red]{_count(failed, 'check')} failed[/]"
    console.print(f"{escape(report.actuator)}: {verdict}")


def print_actuators(actuators: Sequence[type[Actuator]]) -> None:
    """One line an actuator."""
    console = Console(highlight=False)
    table = Table(box=SIMPLE_HEAD, pad_edge=False, show_edge=False)
    for heading in ("name", "what", "plugin file", "motors"):
        table.add_column(heading, no_wrap=heading == "plugin file", overflow="fold")
    for actuator in actuators:
        motors = f"{actuator.motors}{' + adjuster' if actuator.adjuster else ''}"
        table.add_row(actuator.name, actuator.title, f"lib{actuator.name}_plugin.so", motors)
    console.print(table)
    console.print("[dim]asrsim actuators NAME shows laws, parameters and sources.[/]")


def print_actuator(actuator: type[Actuator]) -> None:
    """Laws and parameters of one actuator."""
    console = Console(highlight=False)
    console.print(f"[bold cyan]{escape(actuator.title)}[/] ({actuator.name}, lib{actuator.name}_plugin.so)")
    console.print(f"source  {escape(actuator.source)}")
    if actuator.law:
        for part in actuator.law.split("; "):
            console.print(f"law     {escape(part)}")
    second = " + adjuster" if actuator.adjuster else ""
    console.print(f"motors  {actuator.motors}{second}; second reference in {actuator.reference_2_unit}")
    tags = parameter_tags(actuator)
    # What a parameter is stands below it: beside it there is no room on a terminal of 80 columns.
    console.print(f"\n[bold]{'parameter':<26}{'default':>8}  {'unit':<13}tag[/]")
    parameters = actuator.all_parameters()
    for parameter in sorted(parameters, key=lambda one: one.optional):
        if parameter.optional and parameter is next(one for one in parameters if one.optional):
            console.print("\n[bold]optional models, off at these defaults[/]")
        tag = escape(f"<{tags[parameter.name]}>")
        console.print(f"{parameter.name:<26}{parameter.default:>8.6g}  {parameter.unit:<13}{tag}", soft_wrap=True)
        note = f"{parameter.doc} ({parameter.unused})" if parameter.unused else parameter.doc
        console.print(Padding(f"[dim]{escape(note)}[/]", (0, 0, 0, 4)))
    console.print()
    sources = dict.fromkeys(parameter.source for parameter in parameters)
    console.print(f"defaults: {escape('; '.join(sources))}; in mode 1 <ctrl> gains are 0.8, 0, 0.2 and act on the link")


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"
