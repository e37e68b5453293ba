"""Series elastic actuator: one motor, one spring (paper eq. 3 with the sign of eq. 2; Walk-Man SEA). The spring may have play,
and may stiffen or soften with its deflection.
"""

from __future__ import annotations

from asrsim.actuators.base import Actuator, max_deflection, saturate
from asrsim.actuators.parameters import Parameter

PLAY = "Nordin and Gutman (2002), Controlling mechanical systems with backlash: a dead zone of a stiff shaft"
DUFFING = "Duffing (1918): a spring with a cubic term"


class Sea(Actuator):
    """tau = (k + c e^2) e with e the deflection sat(theta - q) beyond the play."""

    name = "sea"
    title = "Series elastic actuator"
    source = "Mengacci et al. (2021), eq. 3; released toolbox, sea_plugin"
    law = "tau = k sat(theta - q); stiffness = k; optional: tau = (k + c e^2) e, e = sat(theta - q) beyond half of the backlash"
    motors = 1
    parameters = (
        Parameter(name="spring_stiffness", default=10.0, unit="N m/rad", doc="stiffness k of the spring", minimum=0.0),
        Parameter(
            name="spring_cubic", default=0.0, unit="N m/rad^3", source=DUFFING, optional=True,
            doc="coefficient c of the torque's cubic term; negative: the spring softens",
        ),
        Parameter(
            name="backlash", default=0.0, unit="rad", minimum=0.0, source=PLAY, optional=True,
            doc="play between motor and link, in which the spring has no torque",
        ),
        max_deflection(0.8),
    )  # fmt: skip

    @staticmethod
    def elastic_torques(q: float, theta_1: float, theta_2: float, parameters: tuple[float, ...]) -> tuple[float, float]:
        k, cubic, backlash, limit = parameters
        d = saturate(theta_1 - q, limit)
        e = d - saturate(d, 0.5 * backlash)
        return (k + cubic * e * e) * e, 0.0

    @staticmethod
    def stiffness(q: float, theta_1: float, theta_2: float, parameters: tuple[float, ...]) -> float:
        k, cubic, backlash, limit = parameters
        d = saturate(theta_1 - q, limit)
        if abs(d) < 0.5 * backlash:
            return 0.0
        e = d - saturate(d, 0.5 * backlash)
        return k + 3.0 * cubic * e * e

    @staticmethod
    def elastic_energy(q: float, theta_1: float, theta_2: float, parameters: tuple[float, ...]) -> float:
        k, cubic, backlash, limit = parameters
        d = theta_1 - q
        s = saturate(d, limit)
        e = s - saturate(s, 0.5 * backlash)
        beyond = d - s
        return (0.5 * k + 0.25 * cubic * e * e) * e * e + (k + cubic * e * e) * e * beyond
