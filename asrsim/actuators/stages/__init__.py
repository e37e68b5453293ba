"""Stages: parts of an actuator beside its springs, one file each. `STAGES` is the registry, which users can extend."""

from __future__ import annotations

from typing import Any

from asrsim.actuators.stages.backlash import Backlash
from asrsim.actuators.stages.base import Kick, Stage
from asrsim.actuators.stages.damper import Damper
from asrsim.actuators.stages.heating import Heating
from asrsim.actuators.stages.hysteresis import Hysteresis
from asrsim.errors import Problem
from asrsim.quantities import DERIVED, QUANTITIES
from asrsim.registry import Registry, is_declared

OF_JOINTS = frozenset((*QUANTITIES, *DERIVED))
"""Names of the quantities that every joint has, with or without stages."""
GROUP = "asrsim.stages"
"""Entry point group of the stages of installed packages."""


class Stages(Registry[type[Stage]]):
    """Table of the stages; when a stage is registered, its quantities become known to logs."""

    def loaded(self) -> tuple[type[Stage], ...]:
        """All registered stages, in the order of registration. The stages of a package act as soon as the package is
        installed."""
        if is_declared(GROUP):
            self.names()
        return super().loaded()

    def broken(self) -> tuple[Problem, ...]:
        """Problems of the stages of installed packages that are refused, or that cannot be loaded."""
        return super().broken() if is_declared(GROUP) else ()

    def _take(self, name: str, entry: type[Stage]) -> type[Stage]:
        QUANTITIES.update({quantity.name: quantity for quantity in entry.quantities})
        return super()._take(name, entry)

    def state(self) -> Any:
        """Copy of the registry's content, which `put` can restore."""
        return super().state(), dict(QUANTITIES)

    def put(self, state: Any) -> None:
        """Restore the content that `state` returned earlier."""
        entries, quantities = state
        super().put(entries)
        for name in QUANTITIES.keys() - quantities.keys():
            del QUANTITIES[name]


STAGES = Stages("stage", GROUP, base=Stage, label="name")
for _stage in (Hysteresis, Damper, Backlash, Heating):
    STAGES.own(_stage.name, _stage)

__all__ = ["OF_JOINTS", "STAGES", "Kick", "Stage"]
