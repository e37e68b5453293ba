"""`asrsim actuators`: lists the actuators with laws, parameters, units, defaults and sources."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from asrsim.cli.command import Done, command
from asrsim.cli.console import say
from asrsim.cli.options import Texts, argument, option

if TYPE_CHECKING:
    from asrsim.actuators import Actuator


@command(None)
def actuators(
    name: Annotated[str | None, argument("NAME", "Show this actuator in full.")] = None,
    urdf: Annotated[
        Texts,
        option("Print the URDF block that mounts the actuator on this joint; may be repeated.", "--urdf", metavar="JOINT"),
    ] = None,
    mode: Annotated[int, option("Operation mode of the block.", "--mode", min=0, max=8)] = 6,
) -> Done:
    """List the actuators, or describe one actuator: laws, parameters with units, defaults, URDF tags and sources.

    Example: asrsim actuators qbmove

    Example: asrsim actuators qbmove --urdf joint_1 --mode 6
    """
    from asrsim.actuators import ACTUATORS

    if urdf and name is None:
        raise typer.BadParameter("name the actuator: asrsim actuators NAME --urdf JOINT", param_hint="--urdf")
    chosen = [ACTUATORS.get(entry) for entry in (ACTUATORS.names() if name is None else (name,))]
    from asrsim.cli.tables import print_actuator, print_actuators
    from asrsim.robot.mounting import block_text

    def text() -> None:
        if urdf:
            say("\n".join(block_text(joint, chosen[0].name, mode) for joint in urdf))
        elif name is not None:
            print_actuator(chosen[0])
        else:
            print_actuators(chosen)

    return Done(data=[_as_dict(actuator) for actuator in chosen], text=text)


def _as_dict(actuator: type[Actuator]) -> dict[str, Any]:
    from asrsim.cli.findings import number
    from asrsim.robot.tags import parameter_tags

    tags = parameter_tags(actuator)
    about = ("name", "title", "source", "law", "motors", "adjuster", "reference_2_unit")
    described = ("name", "unit", "doc", "source", "unused", "optional")
    return {
        **{key: getattr(actuator, key) for key in about},
        "plugin": f"lib{actuator.name}_plugin.so",
        "parameters": [
            {
                **{key: getattr(parameter, key) for key in described},
                "tag": tags[parameter.name],
                "default": number(float(parameter.default)),
            }
            for parameter in actuator.all_parameters()
        ],
    }
