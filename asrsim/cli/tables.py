"""Tables and lines printed by `asrsim check` and `asrsim actuators`."""

from __future__ import annotations

import textwrap
from collections.abc import Container, Iterable, Sequence
from typing import TYPE_CHECKING

from asrsim.actuators import ACTUATORS, MODES, Actuator, Mode
from asrsim.cli.console import SHOWN, line_width, problem_lines, say, say_table, styled
from asrsim.cli.findings import FileReport
from asrsim.errors import Problem, counted, listed
from asrsim.quantities import linear_unit
from asrsim.robot import ActuatorBlock, ParameterValue, Robot
from asrsim.robot.tags import parameter_tags
from asrsim.tables import from_rows

if TYPE_CHECKING:
    from asrsim.actuators.checker import CheckReport


def print_reports(reports: Sequence[FileReport], *, quiet: bool) -> None:
    """Print the tables and a closing line (neither if quiet), and always the problems of every file."""
    for report in reports:
        if not quiet:
            _print_head(report)
            if report.robot is not None:
                slides = {joint.name for joint in report.robot.moving_joints if joint.kind == "prismatic"}
                for blocks in _alike(report.robot.actuators, slides):
                    _print_blocks(blocks, slides)
                _print_passive(report.robot)
                if report.substeps is not None:
                    number, motors, rate = (report.substeps[key] for key in ("substeps", "motor_substeps", "omega_h"))
                    say(f"{counted(number, 'substep')} per step, {motors} motor substeps in each; ω h = {rate:.2g}", "dim")
        print_problems(report.errors, "error")
        print_problems(report.warnings, "warning")
    if quiet:
        return
    errors, warnings = sum(len(report.errors) for report in reports), sum(len(report.warnings) for report in reports)
    text = f"{counted(len(reports), 'file')}: {counted(errors, 'error')}, {counted(warnings, 'warning')}"
    say(text, "bold red" if errors else "yellow" if warnings else "green")


def print_problems(problems: Sequence[Problem], word: str) -> None:
    """Print problems. word: error or warning."""
    for line in problem_lines(problems):
        say(f"{styled(word, 'bold red' if word == 'error' else 'yellow')} {line}")


def _print_head(report: FileReport) -> None:
    parts = [styled(str(report.path), "bold")]
    if report.title:
        names = report.title.split(", ")
        parts.append(f"variants {report.title} (tables: {names[0]})" if len(names) > 1 else names[0])
    if report.robot is not None:
        robot, driven = report.robot, {block.joint for block in report.robot.actuators}
        counts = {"link": robot.links, "moving joint": robot.moving_joints, "actuator": robot.actuators}
        parts += [f"robot '{robot.name}'", *(counted(len(items), noun) for noun, items in counts.items())]
        rigid = [joint.name for joint in robot.moving_joints if joint.name not in driven and joint.name not in robot.followers]
        if rigid:
            parts.append(f"not driven: {listed(rigid, SHOWN)}")
    say(" · ".join(parts))


def _print_passive(robot: Robot) -> None:
    """Print passive springs, couplings of joints, rotors and links without gravity."""
    weightless = [link.name for link in robot.links if not link.gravity]
    if weightless:
        say(f"{styled('no gravity', 'bold cyan')} on {listed(weightless, SHOWN)}")
    for joint in robot.moving_joints:
        if joint.mimic:
            law = f"{joint.multiplier:g} {joint.mimic}" + (f" {joint.offset:+g}" if joint.offset else "")
            say(f"{styled('coupled', 'bold cyan')}, {joint.name} follows {joint.mimic}: {joint.name} = {law}")
        elif joint.name in robot.followers:
            master = robot.moving_joints[int(robot.couplings.master[robot.moving_joints.index(joint)])].name
            say(f"{styled('closed chain', 'bold cyan')}, {joint.name} follows {master}")
        if joint.armature:
            unit = "kg" if joint.kind == "prismatic" else "kg m^2"
            say(f"{styled('rotor', 'bold cyan')}, {joint.armature:.4g} {unit} at the joint: {joint.name}")
        if joint.spring_stiffness:
            per, at = ("N/m", "m") if joint.kind == "prismatic" else ("N m/rad", "rad")
            spring = f"{joint.spring_stiffness:g} {per} to {joint.spring_reference:g} {at}"
            say(f"{styled('passive spring', 'bold cyan')}, {spring}: {joint.name}")


def _alike(blocks: Iterable[ActuatorBlock], slides: Container[str]) -> list[list[ActuatorBlock]]:
    """Groups of the actuator blocks with equal actuator, mode and parameters. A group is printed as one table, so that a robot
    with many arms fits on a screen. Blocks of prismatic joints (`slides`) form separate groups, since their units differ.
    """
    groups: dict[tuple[object, ...], list[ActuatorBlock]] = {}
    for block in blocks:
        values = tuple((name, value.value, value.origin) for name, value in block.parameters.items())
        groups.setdefault((block.actuator, block.mode, block.joint in slides, values), []).append(block)
    return list(groups.values())


def _print_blocks(blocks: list[ActuatorBlock], slides: Container[str]) -> None:
    first = blocks[0]
    unit_of = linear_unit if first.joint in slides else str
    mode, actuator = MODES[first.mode], ACTUATORS.get(first.actuator)
    say()
    say(f"{styled(actuator.title, 'bold cyan')}, mode {mode.number} {mode.name} {styled(f'({mode.doc})', 'dim')}")
    joints = [block.joint + (f" (line {block.line})" if block.line else "") for block in blocks]
    say(f"{'joint' if len(blocks) == 1 else f'{len(blocks)} joints'}: {', '.join(joints)}")
    rows: list[tuple[str, ...]] = []
    styles, section, values = [], "spring", first.values()
    off = {one.name for one in actuator.all_parameters() if one.optional and not values.get(one.needs, 0.0)}
    for value in first.parameters.values():
        if value.name in off and value.origin == "default":
            continue
        part = _part(value.name)
        used = _is_used(part, value.name, mode)
        if rows and part != section:
            rows.append(("",) * 4)
            styles.append("")
        section = part
        name = value.name if used else f"{value.name} *"
        rows.append((name, f"{value.value:.6g}", unit_of(value.unit), _origin(value)))
        styles.append("" if used and value.origin != "default" else "dim")
    say_table(from_rows(("parameter", "value", "unit", "from"), rows, right=(1,)), styles)
    if not all(_is_used(_part(name), name, mode) for name in first.parameters):
        say(f"* not used in mode {mode.number}", "dim")


def _part(name: str) -> str:
    return name.split("_")[0] if name.startswith(("motor_", "controller_")) else "spring"


def _is_used(part: str, name: str, mode: Mode) -> bool:
    if part == "motor":
        return mode.motor
    if part == "controller":
        return mode.controller and (mode.motor or name.startswith("controller_1"))
    return mode.spring


def _origin(value: ParameterValue) -> str:
    if value.origin == "tag":
        return f"<{value.tag}>" + (f", line {value.line}" if value.line else "")
    return value.origin if value.origin == "scenario" else f"{value.origin} <{value.tag}>"


def print_check_report(report: CheckReport) -> None:
    """Print the verdict of every check of an actuator's laws."""
    say(f"{styled(report.title, 'bold')} ({report.actuator})")
    rows = []
    for check in report.checks:
        limit = f"{check.limit:g}" if check.limit is not None else ""
        figure = f"{check.figure:.2g}" if check.figure is not None and limit else ""
        rows.append((check.name, "pass" if check.passed else "FAIL", figure, limit, check.doc))
    styles = ["" if check.passed else "bold red" for check in report.checks]
    say_table(from_rows(("check", "verdict", "worst", "limit", "requirement"), rows, right=(2, 3)), styles)
    for check in report.checks:
        if not check.passed:
            say(f"{styled(check.name, 'bold red')}: {check.detail}")
    failed = sum(not check.passed for check in report.checks)
    verdict = styled(f"{counted(failed, 'check')} failed", "bold red") if failed else styled("all checks passed", "green")
    say(f"{report.actuator}: {verdict}")


def print_actuators(actuators: Sequence[type[Actuator]]) -> None:
    """Print one line per actuator."""
    rows = [
        (one.name, f"lib{one.name}_plugin.so", f"{one.motors}{' + adjuster' if one.adjuster else ''}", one.title)
        for one in actuators
    ]
    say_table(from_rows(("name", "plugin file", "motors", "what"), rows))
    say("asrsim actuators NAME shows laws, parameters and sources.", "dim")


def print_actuator(actuator: type[Actuator]) -> None:
    """Print laws and parameters of one actuator."""
    say(f"{styled(actuator.title, 'bold cyan')} ({actuator.name}, lib{actuator.name}_plugin.so)")
    say(f"source  {actuator.source}")
    for part in actuator.law.split("; ") if actuator.law else ():
        say(f"law     {part}")
    second = " + adjuster" if actuator.adjuster else ""
    say(f"motors  {actuator.motors}{second}; second reference in {actuator.reference_2_unit}")
    tags = parameter_tags(actuator)
    # Print the note of a parameter below its row, since the row has no room for it in a terminal of 80 columns.
    say()
    say(f"{'parameter':<26}{'default':>8}  {'unit':<13}tag", "bold")
    parameters = actuator.all_parameters()
    for parameter in sorted(parameters, key=lambda one: one.optional):
        if parameter.optional and parameter is next(one for one in parameters if one.optional):
            say()
            say("optional models, off at these defaults", "bold")
        say(f"{parameter.name:<26}{parameter.default:>8.6g}  {parameter.unit:<13}<{tags[parameter.name]}>")
        note = f"{parameter.doc} ({parameter.unused})" if parameter.unused else parameter.doc
        for line in textwrap.wrap(note, line_width(), initial_indent="    ", subsequent_indent="    "):
            say(line, "dim")
    say()
    sources = dict.fromkeys(parameter.source for parameter in parameters)
    say(f"defaults: {'; '.join(sources)}; in mode 1 <ctrl> gains are 0.8, 0, 0.2 and act on the link")
