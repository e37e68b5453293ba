"""Series elastic actuator: one motor, one spring (paper eq. 3 with the sign of eq. 2; Walk-Man SEA). The spring may stiffen or
soften with its deflection.
"""

from __future__ import annotations

from asrsim.actuators.base import Actuator, max_deflection, saturate
from asrsim.actuators.parameters import Parameter

DUFFING = "Duffing (1918): a spring with a cubic term"


class Sea(Actuator):
    """tau = k d + c d^3 with d = sat(theta - q), stiffness k and cubic coefficient c."""

    name = "sea"
    title = "Series elastic actuator"
    source = "Mengacci et al. (2021), eq. 3; released toolbox, sea_plugin"
    law = "tau = k d + c d^3, d = sat(theta - q); stiffness = k + 3 c d^2; c = 0 unless stated"
    motors = 1
    parameters = (
        Parameter(name="spring_stiffness", default=10.0, unit="N m/rad", doc="stiffness k of the spring", minimum=0.0),
        Parameter(
            name="spring_cubic",
            default=0.0,
            unit="N m/rad^3",
            source=DUFFING,
            optional=True,
            doc="coefficient c of the torque's cubic term; negative: the spring softens",
        ),
        max_deflection(0.8),
    )

    @staticmethod
    def elastic_torques(q: float, theta_1: float, theta_2: float, parameters: tuple[float, ...]) -> tuple[float, float]:
        k, cubic, limit = parameters
        d = saturate(theta_1 - q, limit)
        return (k + cubic * d * d) * d, 0.0

    @staticmethod
    def stiffness(q: float, theta_1: float, theta_2: float, parameters: tuple[float, ...]) -> float:
        k, cubic, limit = parameters
        d = saturate(theta_1 - q, limit)
        return k + 3.0 * cubic * d * d

    @staticmethod
    def elastic_energy(q: float, theta_1: float, theta_2: float, parameters: tuple[float, ...]) -> float:
        k, cubic, limit = parameters
        d = theta_1 - q
        s = saturate(d, limit)
        return k * s * (d - 0.5 * s) + cubic * s * s * s * (d - 0.75 * s)
