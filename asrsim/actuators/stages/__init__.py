"""Stages: parts of an actuator beside its springs, one file each. `STAGES` is the registry, which users can extend."""

from __future__ import annotations

from asrsim.actuators.stages.backlash import Backlash
from asrsim.actuators.stages.base import Stage
from asrsim.actuators.stages.damper import Damper
from asrsim.actuators.stages.heating import Heating
from asrsim.actuators.stages.hysteresis import Hysteresis
from asrsim.quantities import QUANTITIES
from asrsim.registry import Registry


class Stages(Registry[type[Stage]]):
    """Table of the stages; the quantities of a stage are known from its registration on."""

    def add(self, name: str, entry: type[Stage], *, replace: bool = False) -> type[Stage]:
        """Register a stage. Raises InputError if the name is taken and `replace` is not set."""
        found = super().add(name, entry, replace=replace)
        QUANTITIES.update({quantity.name: quantity for quantity in entry.quantities})
        return found


STAGES = Stages("stage", entry_point_group="asrsim.stages", base=Stage)
for _stage in (Hysteresis, Damper, Backlash, Heating):
    STAGES.add(_stage.name, _stage)

__all__ = ["STAGES", "Stage"]
