"""Actuators: each file declares the spring law of one actuator. `ACTUATORS` is the registry, which users can extend."""

from __future__ import annotations

from asrsim.actuators.awas import Awas
from asrsim.actuators.awas_ii import AwasII
from asrsim.actuators.base import Actuator, Antagonistic, max_deflection, saturate
from asrsim.actuators.bavs import Bavs
from asrsim.actuators.maccepa import Maccepa
from asrsim.actuators.modes import MODES, Mode
from asrsim.actuators.parameters import Parameter
from asrsim.actuators.qbmove import QbMove
from asrsim.actuators.quadratic_cam import QuadraticCam
from asrsim.actuators.sea import Sea
from asrsim.registry import Registry

ACTUATORS: Registry[type[Actuator]] = Registry("actuator", "asrsim.actuators", base=Actuator, label="name")
for _actuator in (Sea, QbMove, Bavs, AwasII, Maccepa, Awas, QuadraticCam):
    ACTUATORS.own(_actuator.name, _actuator)

__all__ = ["ACTUATORS", "MODES", "Actuator", "Antagonistic", "Mode", "Parameter", "max_deflection", "saturate"]
