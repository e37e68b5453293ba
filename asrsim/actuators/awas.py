"""AwAS: two springs on a lever, at an adjustable distance from the axis (Jafari et al. 2010)."""

from __future__ import annotations

from math import cos, sin

from asrsim.actuators.base import Actuator, max_deflection, saturate
from asrsim.actuators.parameters import Parameter


class Awas(Actuator):
    """tau = 2 k r^2 sin(d) cos(d), d = sat(theta - q).

    Two opposed springs of stiffness k act on the link's lever at the distance r from the axis. The second reference is r, in m.
    The motor that sets r moves at right angles to the springs' force, and has no dynamics in this model.
    """

    name = "awas"
    title = "AwAS (VSA with adjuster)"
    source = (
        "Jafari, Tsagarakis, Vanderborght, Caldwell (2010), A novel actuator with adjustable stiffness (AwAS), IROS, 4201-4206"
    )
    law = "d = sat(theta - q); tau = 2 k r^2 sin(d) cos(d); stiffness = 2 k r^2 cos(2 d)"
    motors = 1
    adjuster = True
    reference_2_unit = "m"
    typical_preset = 0.05
    preset_range = (0.02, 0.1)
    parameters = (
        Parameter(
            name="spring_stiffness",
            default=5000.0,
            unit="N/m",
            doc="stiffness k of each spring",
            minimum=0.0,
            source="chosen by asrsim for a stiffness of 4 to 100 N m/rad; the paper's law holds for any values",
        ),
        max_deflection(0.3),
    )

    @staticmethod
    def elastic_torques(q: float, theta_1: float, theta_2: float, parameters: tuple[float, ...]) -> tuple[float, float]:
        k, limit = parameters
        d = saturate(theta_1 - q, limit)
        return 2.0 * k * theta_2 * theta_2 * sin(d) * cos(d), 0.0

    @staticmethod
    def stiffness(q: float, theta_1: float, theta_2: float, parameters: tuple[float, ...]) -> float:
        k, limit = parameters
        return 2.0 * k * theta_2 * theta_2 * cos(2.0 * saturate(theta_1 - q, limit))

    @staticmethod
    def elastic_energy(q: float, theta_1: float, theta_2: float, parameters: tuple[float, ...]) -> float:
        k, limit = parameters
        d = theta_1 - q
        s = saturate(d, limit)
        return k * theta_2 * theta_2 * (sin(s) * sin(s) + 2.0 * sin(s) * cos(s) * (d - s))
