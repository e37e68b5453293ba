"""Series elastic actuator: one motor, one linear spring (paper eq. 3 with the sign of eq. 2; Walk-Man SEA)."""

from __future__ import annotations

from asrsim.actuators.base import Actuator, max_deflection, saturate
from asrsim.actuators.parameters import Parameter


class Sea(Actuator):
    """tau = k sat(theta - q)."""

    name = "sea"
    title = "Series elastic actuator"
    source = "Mengacci et al. (2021), eq. 3; released toolbox, sea_plugin"
    law = "tau = k sat(theta - q); stiffness = k"
    motors = 1
    parameters = (
        Parameter(name="spring_stiffness", default=10.0, unit="N m/rad", doc="stiffness k of the spring", minimum=0.0),
        max_deflection(0.8),
    )

    @staticmethod
    def elastic_torques(q: float, theta_1: float, theta_2: float, parameters: tuple[float, ...]) -> tuple[float, float]:
        k, limit = parameters
        return k * saturate(theta_1 - q, limit), 0.0

    @staticmethod
    def stiffness(q: float, theta_1: float, theta_2: float, parameters: tuple[float, ...]) -> float:
        return parameters[0]

    @staticmethod
    def elastic_energy(q: float, theta_1: float, theta_2: float, parameters: tuple[float, ...]) -> float:
        k, limit = parameters
        d = theta_1 - q
        s = saturate(d, limit)
        return k * s * (d - 0.5 * s)
