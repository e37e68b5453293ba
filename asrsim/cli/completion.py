"""Shell completion: variants and joints of the file or log on the command line, actuators, engines."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import typer


def actuators(incomplete: str) -> list[str]:
    """Names of actuators."""
    from asrsim.actuators import ACTUATORS

    return [name for name in ACTUATORS if name.startswith(incomplete)]


def engines(incomplete: str) -> list[str]:
    """Names of engines."""
    from asrsim.engines import ENGINES

    return [name for name in ENGINES if name.startswith(incomplete)]


def variants(ctx: typer.Context, incomplete: str) -> list[str]:
    """Variants of the scenario; empty if it cannot be read."""
    from asrsim.errors import AsrsimError
    from asrsim.scenario import load_scenario

    try:
        found = [one.variant for one in load_scenario(_named(ctx, "scenario"))]
    except (AsrsimError, OSError):
        return []
    return [name for name in found if name.startswith(incomplete)]


def mountings(ctx: typer.Context, incomplete: str) -> list[str]:
    """Actuators as NAME, and as JOINT=NAME for each joint with an actuator."""
    joint, separator, start = incomplete.rpartition("=")
    names = [f"{joint}{separator}{name}" for name in actuators(start)]
    return names if separator else [*names, *(f"{name}=" for name in _joints(ctx) if name.startswith(incomplete))]


def logged(ctx: typer.Context, incomplete: str) -> list[str]:
    """Joints of the first log on the command line; empty if it cannot be read."""
    from asrsim.errors import AsrsimError
    from asrsim.log import open_log
    from asrsim.runs.folder import find_logs

    try:
        joints = open_log(find_logs(Path(_named(ctx, "logs")))[0]).info.joints
    except (AsrsimError, OSError, IndexError):
        return []
    return [joint.name for joint in joints if joint.name.startswith(incomplete)]


def _named(ctx: typer.Context, parameter: str) -> str:
    """File on the command line. If an option still lacks its value, the file is among the unparsed words."""
    given = ctx.params.get(parameter) or ctx.args
    return str(given[0] if isinstance(given, list | tuple) and given else given or "")


def _joints(ctx: typer.Context) -> Iterator[str]:
    from asrsim.errors import AsrsimError
    from asrsim.robot import load_robot

    try:
        yield from (joint.name for joint in load_robot(Path(_named(ctx, "robot"))).moving_joints)
    except (AsrsimError, OSError):
        return
