"""What the shell completes: variants and joints of the file that the line names already, actuators, engines."""

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
    """Variants of the scenario; nothing where it cannot be read."""
    from asrsim.errors import AsrsimError
    from asrsim.scenario import load_scenario

    try:
        found = [one.variant for one in load_scenario(str(ctx.params.get("scenario")))]
    except (AsrsimError, OSError):
        return []
    return [name for name in found if name.startswith(incomplete)]


def mountings(ctx: typer.Context, incomplete: str) -> list[str]:
    """Actuators, and joints of the robot with an actuator each: NAME or JOINT=NAME."""
    joint, separator, start = incomplete.rpartition("=")
    names = [f"{joint}{separator}{name}" for name in actuators(start)]
    return names if separator else [*names, *(f"{name}=" for name in _joints(ctx) if name.startswith(incomplete))]


def _joints(ctx: typer.Context) -> Iterator[str]:
    from asrsim.errors import AsrsimError
    from asrsim.robot import load_robot

    try:
        yield from (joint.name for joint in load_robot(Path(str(ctx.params.get("robot")))).moving_joints)
    except (AsrsimError, OSError):
        return
