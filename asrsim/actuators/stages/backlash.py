"""Backlash: play between each motor and its spring.

    x_s = x - min(max(x, -w / 2), w / 2)        x, x_s: deflections of the joint and of the spring, rad; w: backlash

The end of the spring has no mass, and rests in the play while the spring is undeflected. Therefore there is no impact and no
loss. Stages parallel to the spring act between motor and link, beside the play.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from asrsim.actuators.modes import Mode
from asrsim.actuators.parameters import Parameter
from asrsim.actuators.stages.base import NoMemory, Stage
from asrsim.records import constant


@dataclass(slots=True)
class BacklashConstants:
    """Constants of the play."""

    half: float = constant("half of the width of the play", "rad")


class Backlash(Stage):
    """The play of each spring."""

    name = "backlash"
    title = "Backlash between motors and springs"
    source = "dead zone: Nordin, Gutman (2002), with a massless spring"
    parameters = (
        Parameter(
            name="backlash",
            default=0.0,
            unit="rad",
            minimum=0.0,
            source=source,
            optional=True,
            doc="width w of the play between each motor and its spring",
        ),
    )
    Constants = BacklashConstants

    @classmethod
    def constants(cls, values: Mapping[str, float], motor: int, mode: Mode) -> BacklashConstants | None:
        width = values["backlash"]
        return BacklashConstants(0.5 * width) if width > 0.0 else None

    @staticmethod
    def place(memory: NoMemory, own: BacklashConstants, deflection: float) -> float:
        if deflection > own.half:
            return deflection - own.half
        if deflection < -own.half:
            return deflection + own.half
        return 0.0
